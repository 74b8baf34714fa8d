//! The command `cobscope objects`.

use crate::cli::run;

#[test]
fn the_nodes_that_have_objects() {
    let output = run(&["objects", "fixtures/canopen/guarding.log"], "");
    assert_eq!(output.stdout, "node 1/01 on can0: 2 objects (--node 1)\n");
}

#[test]
fn an_absent_node_is_reported() {
    let output = run(&["objects", "--node", "9", "fixtures/canopen/guarding.log"], "");
    assert_eq!((output.code, output.stdout.as_str()), (0, ""));
    assert!(
        output.stderr.contains("guarding.log: node 9/09 sent no frame; nodes present: 1/01"),
        "{}",
        output.stderr
    );
}

#[test]
fn an_absent_bus_is_reported_with_the_present_ones() {
    const CAPTURE: &str = "fixtures/canopen/guarding.log";
    let texts = |by: &str| format!("cobscope: {CAPTURE}: unknown bus 5 in {by}; buses present: can0\n");
    for (words, by) in [
        (&["objects", "--node", "5:1", CAPTURE][..], "--node"),
        (&["why", "--node", "5:1", CAPTURE], "--node"),
        (&["decode", "--node", "5:1=rexroth-sydfec", CAPTURE], "--node"),
        (&["check", "--fail-on", "never", "--node", "5:1=rexroth-sydfec", CAPTURE], "--node"),
        (&["stats", "--bitrate", "5:250k", CAPTURE], "--bitrate"),
        (&["convert", "-f", "candump", "--node", "5:1=rexroth-sydfec", CAPTURE, "-"], "--node"),
    ] {
        let output = run(words, "");
        assert_eq!((output.code, output.stderr), (0, texts(by)), "{words:?}");
    }
    assert_eq!(run(&["objects", "--node", "can0:1", CAPTURE], "").stderr, "");
}

#[test]
fn a_node_without_profile_chooses_only_where_one_is_chosen() {
    const CAPTURE: &str = "fixtures/canopen/guarding.log";
    for (command, only) in [
        ("decode", "--filter 'bus == \"can0\" && node == 5'"),
        ("view", "--filter 'bus == \"can0\" && node == 5'"),
        ("live", "--filter 'bus == \"can0\" && node == 5'"),
        ("convert", "--only-node can0:5"),
        ("stats", "decode --filter 'bus == \"can0\" && node == 5'"),
        ("check", "decode --filter 'bus == \"can0\" && node == 5'"),
    ] {
        let output = run(&[command, "--node", "can0:5", CAPTURE], "");
        let stated = format!(
            "cobscope: --node can0:5: profile missing; --node can0:5=PROFILE assigns one, {only} selects the node\n"
        );
        assert_eq!((output.code, output.stderr, output.stdout.as_str()), (2, stated, ""), "{command}");
    }
    let hint = run(&["decode", "--filter", "bus == \"can0\" && node == 1", CAPTURE], "");
    assert_eq!((hint.code, hint.stdout.is_empty()), (0, false), "{}", hint.stderr);
    for command in ["objects", "why"] {
        assert!(
            run(&[command, "--help"], "").stdout.contains("Choose a node: 5, can0:5, sa:0x80"),
            "{command}"
        );
    }
}

#[test]
fn a_node_is_one_device() {
    let of = |second: &str| {
        let words =
            ["objects", "--node", "1=rexroth-sydfec", "--node", second, "fixtures/canopen/guarding.log"];
        run(&words, "")
    };
    let stated = "cobscope: --node 1=rexroth-vpcd: conflicts with --node 1=rexroth-sydfec\n";
    assert_eq!((of("0x01=rexroth-vpcd").code, of("1=rexroth-vpcd").stderr.as_str()), (2, stated));
    // An option for one bus overrides one for all buses.
    assert_eq!(of("can0:1=rexroth-vpcd").code, 0);
    assert_eq!(of("1=rexroth-sydfec").code, 0);
}

#[test]
fn values_with_their_origin() {
    // 100C is written as F4 01 = 500 and confirmed by frame 3; 100D as 03, confirmed by frame 5.
    let output = run(&["objects", "--node", "0x01", "fixtures/canopen/guarding.log"], "");
    let lines: Vec<&str> = output.stdout.lines().collect();
    assert_eq!(lines[0], "node 1/01 on can0: 2 objects");
    let words = |line: &str| line.split_whitespace().map(str::to_owned).collect::<Vec<_>>().join(" ");
    assert_eq!(words(lines[1]), "100C:00 Guard time 500 ms written {3} 0.002 s F4 01");
    assert_eq!(words(lines[2]), "100D:00 Life time factor 3 written {5} 0.004 s 03");
}

#[test]
fn as_it_was_at_a_frame_or_a_time() {
    let values = |at: &str| {
        let output = run(
            &["objects", "--node", "2", "--at", at, "-f", "json", "fixtures/canopen/pdo_mapping.log"],
            "",
        );
        assert_eq!(output.code, 0, "{}", output.stderr);
        let lines =
            output.stdout.lines().map(|line| serde_json::from_str::<serde_json::Value>(line).unwrap());
        lines
            .filter(|object| object["object"] == "0x1A00:00")
            .map(|object| object["value"].clone())
            .collect::<Vec<_>>()
    };
    // 1A00:00 is written as 0 (frame 11), 2 (17), 0 (24) and 2 (30).
    assert_eq!(values("#10"), Vec::<serde_json::Value>::new());
    assert_eq!(values("#11"), [0]);
    assert_eq!(values("#20"), [2]);
    assert_eq!(values("#24"), [0]);
    assert_eq!(values("60"), [2]);
}

#[test]
fn a_time_in_a_capture_without_times_is_refused() {
    let output = run(&["objects", "--at", "1.5"], "can0 701#00\n");
    assert_eq!(output.code, 3);
    assert!(output.stderr.contains("no timestamps"), "{}", output.stderr);
    assert_eq!(run(&["objects", "--node", "200"], "").code, 2);
}

#[test]
fn columns_stay_where_they_are() {
    let file = "fixtures/machine/machine.log";
    let output = run(&["objects", "--bus", "fixtures/machine/machine.bus.toml", "--node", "32", file], "");
    let lines: Vec<Vec<char>> = output.stdout.lines().skip(1).map(|line| line.chars().collect()).collect();
    assert!(lines.len() > 9, "{}", output.stdout);
    for line in &lines {
        // 1028:01 has the longest name, 45 letters; values are cut at 24, and that of 100A:00 is longer.
        let verb: String = line[7 + 2 + 45 + 2 + 24 + 2..].iter().take(8).collect();
        assert!(verb == "read    " || verb == "written ", "{verb:?} in {}", output.stdout);
    }
    assert!(output.stdout.contains("\"APP-_S6m1_M_R131_CANOP…  read "), "{}", output.stdout);
}
