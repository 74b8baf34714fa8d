//! The option `--bus FILE`.

use std::fs;
use std::path::PathBuf;

use crate::cli::run;
use crate::support::workspace;

/// A bus file with this text, named after its test.
fn file(name: &str, text: &str) -> PathBuf {
    let folder = PathBuf::from(env!("CARGO_TARGET_TMPDIR"));
    let path = folder.join(name);
    fs::write(&path, text).unwrap();
    path
}

fn decode(bus: &str, text: &str, input: &str) -> String {
    let path = file(bus, text);
    let output = run(&["decode", "--bus", path.to_str().unwrap()], input);
    assert_eq!(output.code, 0, "{}", output.stderr);
    output.stdout
}

#[test]
fn names_stand_beside_node_ids_on_their_bus() {
    let text = "[node.5]\nname = \"pump\"\n[bus.can1.node.5]\nname = \"clamp\"\n";
    let input = "(1700000000.0) can0 705#00\n(1700000000.1) can1 705#00\n";
    let output = decode("names.toml", text, input);
    assert!(output.contains("5/05 pump") && output.contains("can1 5/05 clamp"), "{output}");
}

#[test]
fn an_identifier_of_29_bits_becomes_a_pdo_with_values() {
    // 6041:00, 16 bits, least significant byte first: 0x0237.
    let text = "[[id]]\nid = 0x18FF0005\nservice = \"tpdo1\"\nnode = 5\n\
                [[node.5.object]]\nobject = \"1A00:00\"\nvalue = 1\n\
                [[node.5.object]]\nobject = \"1A00:01\"\nvalue = 0x60410010\n";
    let output = decode("pdo.toml", text, "(1700000000.0) can0 18FF0005#3702\n");
    assert!(output.contains("TPDO1") && output.contains("6041:00") && output.contains("567"), "{output}");
}

#[test]
fn a_bit_rate_makes_the_load() {
    // 300 frames of 48 bits in 2.99 s: 4,816 bit/s; 100 in a second: 4,800 bits.
    let path = file("rate.toml", "[bus.can0]\nbitrate = 10000\n");
    let lines = (0..300).map(|n| format!("({}.{:02}0000) can0 555#\n", 1_700_000_000 + n / 100, n % 100));
    let output = run(&["stats", "--bus", path.to_str().unwrap(), "-"], &lines.collect::<String>());
    assert!(
        output.stdout.contains("mean load 48.1 % of 10 kbit/s, worst second 48.0 %"),
        "{}",
        output.stdout
    );
}

#[test]
fn a_mistake_gives_4_and_its_place() {
    let path = file("mistake.toml", "[node.5]\nnmae = \"pump\"\n");
    let name = path.to_str().unwrap();
    for command in ["decode", "objects", "stats"] {
        let output = run(&[command, "--bus", name, "fixtures/canopen/emcy.log"], "");
        assert_eq!(output.code, 4);
        let expected = format!(
            "cobscope: {name}:2:1: unknown field `nmae`, expected one of `name`, `object`, `device`, `dcf`, `eds`, `unit`, `tx_area`, `rx_area`, `spn_conversion`, `state`\n  \
             2 | nmae = \"pump\"\n    | ^^^^\n"
        );
        assert_eq!(output.stderr, expected);
    }
    let missing = run(&["decode", "--bus", "no/such.toml", "fixtures/canopen/emcy.log"], "");
    assert_eq!((missing.code, missing.stderr.contains("no/such.toml: cannot be read")), (4, true));
}

/// An example of docs/bus-file.md, by its position.
fn example(place: usize) -> String {
    let document = fs::read_to_string(workspace().join("docs/bus-file.md")).unwrap();
    let block = document.split("```toml\n").nth(place).unwrap();
    block.split("```").next().unwrap().to_owned()
}

/// Asserts that docs/bus-file.md contains a line.
fn is_shown(line: &str) {
    let document = fs::read_to_string(workspace().join("docs/bus-file.md")).unwrap();
    assert!(document.contains(line), "{line}");
}

#[test]
fn the_document_s_example_is_a_bus_file() {
    let output = decode("example.toml", &example(1), "(1700000000.0) can0 720#00\n");
    assert!(output.contains("32/20 boom"), "{output}");
}

#[test]
fn a_device_of_the_bus_file() {
    // RE 30027-Z: 5208:02 = 00FA = 250 bar; 1FA0 = 8096 of 16383 = 49.4 %; 2000 = 8192 of 16383 × 250 bar.
    let input = "(1.0) can0 082#\n(1.1) can0 602#4008520200000000\n(1.101) can0 582#4B085202FA000000\n\
                 (1.2) can0 182#08A01F0020\n";
    let output = decode("device.toml", &example(3), input);
    let line = output.lines().find(|line| line.contains("TPDO1")).unwrap();
    assert!(line.contains("angle 49.4 %") && line.contains("p 125.0 bar"), "{line}");
    is_shown(line);
    let unknown = file("no_device.toml", "[node.2]\ndevice = \"sydfec\"\n");
    let output = run(&["decode", "--bus", unknown.to_str().unwrap()], input);
    assert_eq!(output.code, 4);
    assert!(output.stderr.contains("no_device.toml:2:10: unknown profile 'sydfec'"), "{}", output.stderr);
}

#[test]
fn a_unit_of_the_bus_file() {
    // 1388 = 5000 thousandths.
    let input = "(1.0) can0 601#4001660100000000\n(1.1) can0 581#4301660188130000\n";
    let output = decode("unit.toml", &example(5), input);
    assert!(output.contains("6601:01 Position actual value 1 = 5.000 mm ok"), "{output}");
}

#[test]
fn areas_of_the_bus_file() {
    // 00014D5A = 85338 / 327.67 = 260.4 bar; the discrete inputs follow in bytes 4 and 5, the status in 6 and 7.
    let input = "(1.0) can0 1BF#5A4D010000010000\n(1.1) can0 23F#5A4D0100FF7F0000\n";
    let output = decode("areas.toml", &example(6), input);
    let line = output.lines().find(|line| line.contains("TPDO1")).unwrap();
    assert!(line.contains("p A 260.4 bar, Discrete inputs 0100h enable"), "{line}");
    is_shown(line);
    // 00007FFF = 32767 / 327.67 = 100.0 %.
    assert!(output.contains("p 260.4 bar, angle 100.0 %"), "{output}");
    let path = file("area.toml", "[node.63]\ndevice = \"rexroth-vpcd\"\ntx_area = [\"2F10\"]\n");
    let wrong = run(&["decode", "--bus", path.to_str().unwrap()], input);
    assert_eq!(wrong.code, 4);
    is_shown(&wrong.stderr.replace(path.to_str().unwrap(), "machine.toml"));
}

#[test]
fn a_bus_missing_in_the_capture_is_reported() {
    let path = file("unknown.toml", "[bus.can7]\nbitrate = 250000\n");
    let output = run(&["decode", "--bus", path.to_str().unwrap()], "(1700000000.0) can0 705#00\n");
    assert_eq!(output.code, 0);
    assert!(
        output.stderr.contains("unknown bus can7") && output.stderr.contains("buses present: can0"),
        "{}",
        output.stderr
    );
}

/// Compares the blocks of the section "Expectations": a bus file, and the output of `check`.
#[test]
fn the_expectations_of_the_manual_are_judged_as_it_says() {
    let manual = fs::read_to_string(workspace().join("docs/bus-file.md")).unwrap();
    let section = manual.split("## Expectations").nth(1).unwrap();
    let text = section.split("```toml\n").nth(1).unwrap().split("```").next().unwrap();
    let stated = section.split("```\n").find(|block| block.starts_with("error ")).unwrap();
    let path = file("expectations.toml", text);
    let output = run(&["check", "--bus", path.to_str().unwrap(), "fixtures/devices/sydfec.log"], "");
    assert_eq!(output.code, 1, "{}", output.stderr);
    for line in stated.lines() {
        assert!(output.stdout.lines().any(|printed| printed == line), "{line}\n{}", output.stdout);
    }
}

#[test]
fn an_expectation_that_is_none_gives_4_and_the_place_in_it() {
    let text = "[[expect]]\nid = \"x\"\nkind = \"never\"\nwhen = 'kind == pdo && nod == 5'\nreason = \"r\"\n";
    let path = file("expect.toml", text);
    let name = path.to_str().unwrap();
    let output = run(&["check", "--bus", name, "fixtures/canopen/emcy.log"], "");
    assert_eq!((output.code, output.stdout.as_str()), (4, ""));
    let expected = format!(
        "cobscope: {name}:4:24: unknown field 'nod'; did you mean node?\n  \
         4 | when = 'kind == pdo && nod == 5'\n    |                        ^^^\n"
    );
    assert_eq!(output.stderr, expected);
}

/// Exit code, stdout and stderr of a command with a bus file.
fn texts(command: &str, name: &str, bus: &str) -> (i32, String, String) {
    let path = PathBuf::from(env!("CARGO_TARGET_TMPDIR")).join(format!("bus_file_{name}.toml"));
    fs::write(&path, bus).unwrap();
    let path = path.to_str().unwrap();
    let output = run(&[command, "--bus", path, "fixtures/devices/sydfec.log"], "");
    (output.code, output.stdout, output.stderr.replace(path, "bus.toml"))
}

#[test]
fn a_profile_that_is_not_there_is_shown_with_its_place() {
    let (code, _, stderr) =
        texts("decode", "misnamed", "[node.2]\nname = \"pump\"\ndevice = \"rexroth-sydfek\"\n");
    let expected = "cobscope: bus.toml:3:10: unknown profile 'rexroth-sydfek'; did you mean 'rexroth-sydfec'?\n  \
                    3 | device = \"rexroth-sydfek\"\n    |          ^^^^^^^^^^^^^^^^\n";
    assert_eq!((code, stderr.as_str()), (4, expected));
}

#[test]
fn types_are_described_in_plain_words() {
    for (bus, expected) in [
        ("[expect]\nid = 'a'\n", "bus.toml:1:1: found a table, expected [[expect]]\n"),
        ("[bus.can0]\nbitrate = 'fast'\n", "2:11: found \"fast\", expected a whole number\n"),
        ("bus = 5\n", "1:7: found a whole number, expected a table\n"),
        (
            "[[expect]]\nid = 'a'\nkind = 'never'\nreason = 'r'\nseconds = 'x'\n",
            "5:11: found \"x\", expected a number\n",
        ),
    ] {
        let (code, _, stderr) = texts("check", "types", bus);
        let expected = expected.replace("found a whole number, ", "found 5, ");
        assert!(code == 4 && stderr.contains(&expected), "{bus}: {stderr}");
        assert!(
            !stderr.contains("struct") && !stderr.contains("f64") && !stderr.contains("invalid type"),
            "{stderr}"
        );
    }
}

#[test]
fn an_expectation_of_what_is_not_there_says_what_is_like_it() {
    let bus = "[node.2]\nname = 'pump'\ndevice = 'rexroth-sydfec'\n\
               [[expect]]\nid = 'a'\nkind = 'bounds'\nsignal = 'Pressure actual valeu'\nmax = 90\nreason = 'r'\n\
               [[expect]]\nid = 'b'\nkind = 'never'\nwhen = 'node_name == \"pumps\"'\nreason = 'r'\n\
               [[expect]]\nid = 'c'\nkind = 'never'\nwhen = 'kind == emcy'\nbus = 'can9'\nreason = 'r'\n\
               [[expect]]\nid = 'd'\nkind = 'never'\nwhen = 'signals.name == \"Presure actual value\"'\nreason = 'r'\n";
    let (_, stdout, stderr) = texts("check", "alike", bus);
    for line in [
        "a is not exercised: signal 'Pressure actual valeu' did not occur; did you mean 'Pressure actual value'?",
        "b is not exercised: unknown node name 'pumps'; did you mean 'pump'?",
        "c is not exercised: no bus 'can9' in the capture",
        "d is not exercised: signal 'Presure actual value' did not occur; did you mean 'Pressure actual value'?",
    ] {
        assert!(stdout.contains(&format!("quality  {line}\n")), "{line}: {stdout}{stderr}");
    }
}

#[test]
fn a_tolerance_that_switches_its_check_off_is_refused() {
    let of = |tolerance: &str| {
        let when = "[[expect]]\nid = 'a'\nkind = 'every'\nwhen = 'kind == sync'\nseconds = 1\nreason = 'r'\n";
        texts("check", "tolerance", &format!("{when}tolerance = {tolerance}\n"))
    };
    for tolerance in ["1", "1.5", "\"100 %\"", "\"250 %\""] {
        let (code, _, stderr) = of(tolerance);
        let wrong = "bus.toml:7:13: the tolerance is not shorter than the period";
        assert!(code == 4 && stderr.contains(wrong), "{tolerance}: {stderr}");
    }
    for tolerance in ["0.99", "\"99 %\"", "0.0"] {
        assert_ne!(of(tolerance).0, 4, "{tolerance}");
    }
}
