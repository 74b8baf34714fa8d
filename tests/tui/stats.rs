//! The command `cobscope stats`.

use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::fs;
use std::process::Command;

use serde_json::Value;

use crate::check::folder;
use crate::cli::{run, run_in};
use crate::support::{self, workspace};

fn figures(capture: &str) -> Value {
    let output = run(&["stats", "-f", "json", capture], "");
    assert_eq!(output.code, 0, "{}", output.stderr);
    serde_json::from_str(&output.stdout).unwrap()
}

/// A candump log of one frame, `count` times.
fn every_millisecond(count: u32, frame: &str) -> String {
    let mut log = String::new();
    for n in 0..count {
        writeln!(log, "({}.{:06}) can0 {frame}", 1_700_000_000 + n / 1000, n % 1000 * 1000).unwrap();
    }
    log
}

#[test]
fn how_a_capture_begins() {
    // All three nodes boot first in the one; node 1 of the other sends heartbeats before its only boot-up.
    let begins = |capture: &str| figures(capture)["buses"][0]["begins"].clone();
    let powered = begins("fixtures/rules/clean/canopen.log");
    assert_eq!(powered, serde_json::json!({"at": "power-on", "running": [], "starting": [2, 5, 32]}));
    let running = begins("fixtures/stories/wandfluh-md2/brown-out.log");
    assert_eq!(running, serde_json::json!({"at": "operation", "running": [1], "starting": []}));
    let text = run(&["stats", "fixtures/rules/clean/canopen.log"], "").stdout;
    assert!(
        text.contains("\n          begins before power-on: nodes 2/02, 5/05, 32/20 starting\n"),
        "{text}"
    );
}

#[test]
fn a_lost_node_and_its_heartbeat() {
    // fixtures/README.md: node 2 every 100 ms, silent from 1.0 to 4.0 s and from 4.9 s to its boot-up.
    let all = figures("fixtures/canopen/heartbeat_lost.log");
    assert_eq!(all["frames"], 102);
    let nodes = all["buses"][0]["nodes"].as_array().unwrap();
    let node = nodes.iter().find(|node| node["node"] == 2).unwrap();
    assert_eq!(
        (&node["boots"], &node["lost"], &node["sdo"]["complete"]),
        (&Value::from(1), &2.into(), &1.into())
    );
    assert_eq!(node["heartbeat_ms"]["min"], 100.0);
    assert_eq!(node["heartbeat_ms"]["max"], 3000.0);
    assert_eq!(all["buses"][0]["canopen"], true);
}

#[test]
fn transfers_by_outcome_and_code() {
    // fixtures/canopen/sdo_abort.expected.txt: twelve transfers, all aborted, one of them with node 3, which sent nothing
    // until the client aborted after 0.3 s (frames 28 and 29).
    let all = figures("fixtures/canopen/sdo_abort.log");
    let nodes = all["buses"][0]["nodes"].as_array().unwrap();
    assert_eq!(nodes.iter().map(|node| node["sdo"]["aborted"].as_u64().unwrap()).sum::<u64>(), 11);
    assert_eq!(nodes[0]["sdo"]["abort_codes"]["0x06020000"], 2);
    let text = run(&["stats", "fixtures/canopen/sdo_abort.log"], "").stdout;
    assert!(text.contains("\n  3/03         0        0            1      0        –"), "{text}");
}

#[test]
fn synthetic_timestamps_and_missing_error_frames_are_reported() {
    let lines = every_millisecond(1_200, "705#05");
    let text = run(&["stats", "-"], &lines).stdout;
    assert!(text.contains("timestamps synthetic (every 1.000 ms)"), "{text}");
    assert!(text.contains("no error frames"), "{text}");
    assert!(text.contains("unknown without the bit rate"), "{text}");
}

#[test]
fn load_needs_a_bit_rate() {
    // 1,000 frames per second of 0x555 without data, 48 bits each: 48 kbit/s are 19 % of 250.
    let lines = every_millisecond(3_000, "555#");
    let text = run(&["stats", "--bitrate", "250k", "-"], &lines).stdout;
    assert!(text.contains("mean load 19.2 % of 250 kbit/s, worst second 19.2 %"), "{text}");
    assert_eq!(run(&["stats", "--bitrate", "fast", "-"], "").code, 2);
}

#[test]
fn a_truck_is_no_canopen_network() {
    let path = support::corpus().join("nmea2000/canboat__can0-1.pcap");
    if !path.exists() {
        return support::skip("corpus", "no captures of other projects");
    }
    let all = figures(path.to_str().unwrap());
    assert_eq!(all["frames"], 49_928);
    assert_eq!(all["buses"][0]["canopen"], false);
    assert_eq!(all["buses"][0]["nodes"].as_array().unwrap().len(), 0);
}

#[test]
fn the_tables_of_a_guarded_node() {
    // fixtures/canopen/guarding.log: one boot-up and 17 responses as 701, 20 requests every 500 ms from 0.5
    // s; three requests between the responses at 6.502 and 8.502 have no response. NMT at 2.4 and 9.4 s. SDO
    // in frames 2 to 5, 1 ms each; the second request is 1 ms after the first response.
    let text = run(&["stats", "fixtures/canopen/guarding.log"], "").stdout;
    let tables = text.split_once("master").unwrap().1;
    let expected = "    NMT start 1
          NMT stop 1
          guarding requests 20

 ID/hex  name  NMT      boots  lost  heartbeat ms (min to max)  worst from  EMCY  active
   1/01        stopped      1     1  –                                         0       0
   1/01  guarding: 17 responses to 20 requests; every 500.0 ms (500.0 to 500.0, worst from 0.500 s)

 SDO server    ok  aborted  no response  other   ms p50     p90     p99     max   think ms p50
  1/01         2        0            0      0    1.000   1.000   1.000   1.000          1.000

 ID     meaning                 frames  ms min    mean     max  worst from
 000    NMT                          2  7000.0  7000.0  7000.0     2.400 s
 581    SDO response of 1            2   2.000   2.000   2.000     0.002 s
 601    SDO request to 1             2   2.000   2.000   2.000     0.001 s
 701    NMT error control of 1      18   500.0   588.3  2000.0     6.502 s
 701 R  NMT error control of 1      20   500.0   500.0   500.0     0.500 s
 R: remote frames
";
    assert_eq!(tables, expected);
}

#[test]
fn stopped_messages_are_reported() {
    // Every 100 ms until 1.0 s; node 6 until 3.0 s.
    let line = |n: u32, id: u32| format!("({}.{}00000) can0 {id:03X}#05\n", 1_700_000_000 + n / 10, n % 10);
    let lines: String =
        (0..=30).map(|n| if n <= 10 { line(n, 0x705) + &line(n, 0x706) } else { line(n, 0x706) }).collect();
    let text = run(&["stats", "-"], &lines).stdout;
    let silent: Vec<&str> = text.lines().filter(|line| line.ends_with("silent since 1.000 s")).collect();
    assert_eq!(silent.len(), 2, "{text}");
    assert!(silent[0].contains("5/05") && silent[1].contains("705"), "{text}");
}

#[test]
fn pdos_and_active_errors_of_a_node() {
    // fixtures/canopen/pdo_mapping.expected.txt: TPDO1 as 182, then as 1A5; TPDO2 as 282.
    let text = run(&["stats", "fixtures/canopen/pdo_mapping.log"], "").stdout;
    assert!(text.contains("   2/02  PDOs: TPDO1 182, TPDO1 1A5, TPDO2 282\n"), "{text}");
    // One error raised, none cleared.
    let raised = "(1700000000.0) can0 705#05\n(1700000000.1) can0 085#3081110000000000\n";
    let output = run(&["stats", "-f", "json", "-"], raised);
    let all: Value = serde_json::from_str(&output.stdout).unwrap();
    let node = &all["buses"][0]["nodes"][0];
    assert_eq!((&node["emcy_active"], &node["emcy_codes"]["0x8130"]), (&Value::from(1), &Value::from(1)));
}

/// Frames per service as counted by tshark; `None` if it is missing.
fn counts_of_tshark(capture: &str) -> Option<BTreeMap<String, u64>> {
    if Command::new("tshark").arg("-v").output().is_err() {
        support::skip("tshark", "the program is missing");
        return None;
    }
    let python = support::python().unwrap_or_else(|| "python3".into());
    if Command::new(&python).arg("--version").output().is_err() {
        support::skip("python", "the program is missing");
        return None;
    }
    let script = workspace().join("tests/oracles/canopen_counts.py");
    let output = Command::new(python).arg(script).arg(capture).output().unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let text = String::from_utf8(output.stdout).unwrap();
    let mut counts = BTreeMap::new();
    for (name, count) in text.lines().filter_map(|line| line.split_once(' ')) {
        // tshark does not track transfers, and counts a boot-up as a heartbeat.
        let name = match name {
            _ if name.starts_with("sdo-ccs") => "request",
            _ if name.starts_with("sdo-scs") => "response",
            "heartbeat" | "boot-up" => "error-control",
            "not-canopen" => continue,
            other => other,
        };
        *counts.entry(name.to_owned()).or_default() += count.parse::<u64>().unwrap();
    }
    Some(counts)
}

#[test]
fn counts_are_those_of_tshark() {
    let corpus = support::corpus().join("canopen");
    for name in ["canopen-lens__sample_amr_2wheel.log", "canopen-message-interpreter__pcan2.pcapng"] {
        let path = corpus.join(name);
        if !path.exists() {
            return support::skip("corpus", "no captures of other projects");
        }
        let capture = path.to_str().unwrap();
        let Some(theirs) = counts_of_tshark(capture) else { return };
        let mut ours = BTreeMap::new();
        for id in figures(capture)["buses"][0]["ids"].as_array().unwrap() {
            let what = id["what"].as_str().unwrap().split(' ').take(2).collect::<Vec<_>>();
            let name = match what.as_slice() {
                ["SDO", "request"] => "request".to_owned(),
                ["SDO", "response"] => "response".to_owned(),
                ["NMT", "error"] => "error-control".to_owned(),
                ["NMT" | "SYNC" | "TIME" | "EMCY", ..] => what[0].to_lowercase(),
                [pdo, "of"] if pdo.contains("PDO") => pdo.to_lowercase(),
                _ => continue,
            };
            // tshark does not decode remote frames as CANopen.
            if id["remote"] == false {
                *ours.entry(name).or_default() += id["frames"].as_u64().unwrap();
            }
        }
        assert_eq!(ours, theirs, "{name}");
    }
}

#[test]
fn identifiers_of_j1939_are_named_by_their_group() {
    let text = run(&["stats", "fixtures/j1939/mixed.log"], "").stdout;
    // AVC of valve 0 is a broadcast (PDU2), the request is from F1 to 80, EEFF80 is for the global address.
    for (id, what) in [
        ("0CFE30F1", "FE30 AVC valve 0 of F1  "),
        ("18EA80F1", "EA00 request, F1 to 80  "),
        ("18EEFF80", "EE00 address claimed, 80 to all  "),
        ("18DA20F1", "ISO-TP F1 to 20  "),
        ("705", "NMT error control of 5  "),
    ] {
        let mut rows = text.lines().filter_map(|line| line.trim_start().strip_prefix(id));
        assert!(rows.any(|rest| rest.trim_start().starts_with(what)), "{id}: {what}\n{text}");
    }
    // 64 addresses without any evidence: not a J1939 network.
    let lines = (0..64).map(|n| format!("({n}.0) can0 18FF00{n:02X}#00\n")).collect::<Vec<_>>().concat();
    let text = run(&["stats", "-"], &lines).stdout;
    assert!(!text.contains("FF00 "), "{text}");
}

/// SYNC every 10 ms; `text` adds further lines at the end.
fn syncs(count: u32, step: u32, text: &str) -> String {
    use std::fmt::Write as _;
    let mut log = String::from("(1.000000) can0 705#05\n");
    for n in 0..count {
        let micros = 1_000_000 + n * step + n % 2 * 100;
        writeln!(log, "({}.{:06}) can0 080#", micros / 1_000_000, micros % 1_000_000).unwrap();
    }
    log + text
}

#[test]
fn jitter_needs_real_times_without_silence() {
    let of = |log: &str| run(&["stats", "-"], log).stdout;
    // Intervals 10.1 and 9.9 ms.
    let jitter = of(&syncs(100, 10_000, ""));
    assert!(jitter.contains(", jitter ±0.1"), "{jitter}");
    // The last interval is a silence of 8 s, longer than three times the mean.
    let silence = of(&syncs(100, 10_000, "(10.000000) can0 080#\n"));
    assert!(silence.contains("SYNC 101") && !silence.contains("jitter"), "{silence}");
    // One frame every 10 ms: 1,000 equal steps are synthetic.
    let synthetic = (0..1_200)
        .map(|n| {
            format!(
                "({}.{:03}) can0 {}\n",
                1 + n / 100,
                n % 100 * 10,
                if n % 7 == 0 { "705#05" } else { "080#" }
            )
        })
        .collect::<Vec<String>>()
        .concat();
    let synthetic = of(&synthetic);
    assert!(synthetic.contains("timestamps synthetic") && !synthetic.contains("jitter"), "{synthetic}");
}

#[test]
fn steps_below_a_microsecond_have_a_unit() {
    let fine = "(1.000000001) can0 705#05\n(2.000000002) can0 705#05\n(3.000000004) can0 705#05\n";
    let text = run(&["stats", "-"], fine).stdout;
    assert!(text.contains("timestamps in steps of 1 ns"), "{text}");
}

/// CiA 304: an SRDO is a pair, data on an odd identifier and the inverted data on the next one.
#[test]
fn an_srdo_is_a_pair() {
    let of =
        |lines: &str| run(&["stats", "-"], &format!("(1.0) can0 705#05\n(2.0) can0 705#05\n{lines}")).stdout;
    let lone = of("(2.1) can0 10A#0102\n(2.2) can0 10A#0102\n");
    assert!(lone.contains("10A") && !lone.contains("srdo"), "{lone}");
    let neighbours = of("(2.1) can0 10A#0102\n(2.2) can0 10B#FEFD\n");
    assert!(!neighbours.contains("srdo"), "{neighbours}");
    let pair = of("(2.1) can0 109#0102\n(2.2) can0 10A#FEFD\n");
    assert_eq!(pair.matches("srdo").count(), 2, "{pair}");
}

#[test]
fn an_error_code_has_the_name_the_device_gives_it() {
    let log = "(1.0) can0 702#05\n(2.0) can0 082#0583010000000000\n(3.0) can0 702#05\n";
    let of = |arguments: &[&str]| run(&[&["stats"], arguments, &["-"]].concat(), log).stdout;
    assert!(of(&[]).contains("EMCY 8305 undefined in CiA 301: 1"), "{}", of(&[]));
    let known = of(&["--node", "2=danfoss-pve-ci"]);
    assert!(known.contains("EMCY 8305 spool position error: 1"), "{known}");
}

#[test]
fn only_what_lies_between_the_bounds_is_counted() {
    let log = every_millisecond(10, "123#00");
    let counted = |bounds: &[&str]| {
        let output = run(&[&["stats", "-f", "json", "-"], bounds].concat(), &log);
        assert_eq!(output.code, 0, "{}", output.stderr);
        let all: Value = serde_json::from_str(&output.stdout).unwrap();
        (all["frames"].as_u64().unwrap(), output.stderr)
    };
    assert_eq!(counted(&["--from", "0.002", "--to", "0.004"]), (3, String::new()));
    assert_eq!(counted(&["--from", "#3"]), (8, String::new()));
    let (frames, stated) = counted(&["--from", "9"]);
    assert_eq!(
        (frames, stated.as_str()),
        (0, "cobscope: -: --from is after the last frame, #10 at 0.009 s\n")
    );
    assert_eq!(run(&["stats", "--from", "5", "--to", "3", "-"], &log).code, 2);
}

#[test]
fn no_frame_selected_is_no_property_of_the_capture() {
    // An SDO transfer of 1 ms in a capture with timestamps; the events of no frame of its own are selected.
    let log = "(1.000000) can0 705#00\n(1.010000) can0 605#4018100100000000\n\
               (1.011000) can0 585#4318100101000000\n(1.100000) can0 705#05\n";
    let of = |options: &[&str]| run(&[&["stats", "-"], options].concat(), log).stdout;
    let late = of(&["--from", "900"]);
    assert_eq!(late.lines().nth(1), Some("capture   no frame selected"), "{late}");
    let transfers = of(&["--filter", "kind == sdo-transfer"]);
    assert!(transfers.contains("capture   no frame selected\n\nbus can0  CANopen\n"), "{transfers}");
    assert!(transfers.contains("\n  5/05         1        0 "), "{transfers}");
    for text in [late, transfers] {
        for words in ["without timestamps", "0 frames", "error frames", "begins"] {
            assert!(!text.contains(words), "{words}: {text}");
        }
    }
}

#[test]
fn messages_that_look_like_canopen_are_presumed() {
    // SYNC and TPDO1 of node 2 are decoded, marked ?; the EMCY is not, because nothing confirms CANopen.
    let log = "(1700000000.000000) can0 080#\n(1700000000.001000) can0 182#0899190000\n\
               (1700000000.500000) can0 082#FF01800000000000\n(1700000001.000000) can0 080#\n\
               (1700000001.001000) can0 182#0899190000\n";
    let hint = "          no heartbeat, NMT command or SDO response; --protocol canopen, --node ID=PROFILE or a bus \
                file with the nodes (convert --bus-file writes one) confirms CANopen\n";
    let text = run(&["stats", "-"], log).stdout;
    assert!(text.contains("bus can0  CANopen presumed, not confirmed\n"), "{text}");
    assert!(
        text.contains(hint) && text.contains("  1 frame of no known or confirmed service, 0 malformed\n")
    );
    for confirmed in [&["--protocol", "canopen"], &["--node", "2=rexroth-sydfec"]] {
        let text = run(&[&["stats", "-"], &confirmed[..]].concat(), log).stdout;
        assert!(text.contains("bus can0  CANopen\n"), "{text}");
        assert!(!text.contains("confirms CANopen") && !text.contains("service,"), "{text}");
    }
    // The same identifiers with a heartbeat need no hint.
    let text = run(&["stats", "-"], &format!("{log}(1700000001.002000) can0 702#05\n")).stdout;
    assert!(text.contains("bus can0  CANopen\n") && !text.contains("confirms CANopen"), "{text}");
}

#[test]
fn unnamed_uds_is_detected_by_its_responses() {
    // Two requests for a session (10 03) with their responses (50 03 …).
    let log = "(1700000000.000000) can0 6E0#0210030000000000\n(1700000000.010000) can0 6E8#065003003201F400\n\
               (1700000001.000000) can0 6E0#0210030000000000\n(1700000001.010000) can0 6E8#065003003201F400\n";
    let hint = "6E8 responds to 6E0 like a UDS server (2 times); to decode, add to a bus file (--bus): uds = [{ \
                request = \"6E0\", response = \"6E8\" }]";
    let text = run(&["stats", "-"], log).stdout;
    assert!(text.contains("bus can0  no CANopen, J1939 or UDS messages\n"), "{text}");
    assert!(
        text.contains(&format!("          4 frames of no known service, 0 malformed\n          {hint}\n"))
    );
    assert!(run(&["why", "-"], log).stdout.contains(&format!("CANopen: no CANopen message; {hint}\n")));
    assert!(run(&["decode", "-"], log).stdout.contains(&format!("NOTE   {hint} {{4}}\n")));

    let folder = tempfile::tempdir().unwrap();
    let bus = folder.path().join("bus.toml");
    // The line is valid TOML as it is.
    fs::write(&bus, hint.split_once("(--bus): ").unwrap().1).unwrap();
    let text = run(&["stats", "--bus", bus.to_str().unwrap(), "-"], log).stdout;
    assert!(text.contains("bus can0  UDS\n") && !text.contains("of no known service"), "{text}");
}

/// Reads of 1000:00, 1018:01 and 1008:00 and a write of 1017:00 on identifiers of PDOs of node 35.
const DIALOGUE: &str = "\
(100.000000) can0 723#05
(100.001000) can0 223#4000100000000000
(100.002300) can0 1A3#4300100091010300
(100.004100) can0 223#4018100100000000
(100.005200) can0 1A3#4318100119030000
(100.007000) can0 223#2B171000E8030000
(100.008300) can0 1A3#6017100000000000
(100.010000) can0 223#4009100000000000
(100.011000) can0 1A3#4309100031303030
";

#[test]
fn entries_of_an_sdo_dialogue_can_be_pasted_into_a_bus_file() {
    let place = folder("sdo-dialogue");
    fs::write(place.join("a.log"), DIALOGUE).unwrap();
    for command in ["stats", "why"] {
        let output = run_in(&place, &[command, "a.log"], "");
        let (_, entries) =
            output.stdout.split_once("with the node-ID of the server:\n").expect(&output.stdout);
        let is_entry = |line: &&str| line.contains("[[id]]") || line.contains(" = ");
        let entries: Vec<&str> = entries.lines().take_while(is_entry).collect();
        assert_eq!(entries.len(), 8, "{command}: {}", output.stdout);
        fs::write(place.join("bus.toml"), entries.join("\n")).unwrap();
        let decoded = run_in(&place, &["decode", "--bus", "bus.toml", "-f", "jsonl", "a.log"], "");
        let transfers =
            decoded.stdout.lines().filter(|line| line.contains("\"kind\":\"sdo-transfer\"")).count();
        assert_eq!((decoded.code, transfers), (0, 4), "{command}: {}{}", decoded.stdout, decoded.stderr);
        let output = run_in(&place, &[command, "-f", "json", "a.log"], "");
        let text = r#""bus_file":"[[id]]\nid = \"223\"\nservice = \"sdo-request\"\nnode = 35\n[[id]]"#;
        let report: Value = serde_json::from_str(&output.stdout).unwrap();
        assert!(report.to_string().contains(text), "{command}: {report}");
    }
    // Two exchanges may be chance.
    let two: Vec<&str> = DIALOGUE.split_inclusive('\n').take(5).collect();
    let two = two.concat();
    fs::write(place.join("two.log"), two).unwrap();
    for command in ["stats", "why"] {
        let output = run_in(&place, &[command, "two.log"], "");
        assert!(!output.stdout.contains("[[id]]"), "{command}: {}", output.stdout);
    }
}
