//! Device files: `--eds`, the bus file, folders of profiles, `profiles import` and `check`, `objects --want`.

use std::fs;
use std::path::PathBuf;

use serde_json::Value;

use crate::cli::{Output, run};
use crate::support::workspace;

const EDS: &str = "fixtures/device_files/valve.eds";
const DCF: &str = "fixtures/device_files/valve.dcf";

/// A heartbeat, so that the bus is CANopen; then TPDO1 of node 5 on 1C5, as in the EDS: 2000:00 = 1000,
/// 2002:00 = 20, and RPDO1: 2001:00 = -2.
const PDOS: &str =
    "(1700000000.0) can0 705#05\n(1700000000.1) can0 1C5#E80314\n(1700000000.2) can0 205#FEFF\n";

/// Node 5 reports its identity: vendor-ID 0A01, product code 5.
const IDENTITY: &str = "(1699999999.0) can0 605#4018100100000000\n(1699999999.1) can0 585#43181001010A0000\n\
    (1699999999.2) can0 605#4018100200000000\n(1699999999.3) can0 585#4318100205000000\n";

/// A new folder named after its test, with files.
fn folder(name: &str, files: &[(&str, String)]) -> PathBuf {
    let folder = PathBuf::from(env!("CARGO_TARGET_TMPDIR")).join(name);
    let _ = fs::remove_dir_all(&folder);
    fs::create_dir_all(&folder).unwrap();
    for (name, text) in files {
        fs::write(folder.join(name), text).unwrap();
    }
    folder
}

fn fixture(path: &str) -> String {
    fs::read_to_string(workspace().join(path)).unwrap()
}

fn ok(arguments: &[&str], input: &str) -> Output {
    let output = run(arguments, input);
    assert_eq!(output.code, 0, "{}", output.stderr);
    output
}

/// Events of a kind as JSON.
fn events(arguments: &[&str], input: &str, kind: &str) -> Vec<Value> {
    let output = ok(&[&["decode", "-f", "jsonl"], arguments].concat(), input);
    let all = output.stdout.lines().map(|line| serde_json::from_str::<Value>(line).unwrap());
    all.filter(|event| event["kind"] == kind).collect()
}

#[test]
fn an_eds_gives_identifiers_layouts_and_names() {
    let output = ok(&["decode", "--eds", &format!("5={EDS}"), "-"], PDOS);
    assert!(
        output.stdout.contains("TPDO1 E8 03 14: Spool position 1000?, Temperature 20?"),
        "{}",
        output.stdout
    );
    assert!(output.stdout.contains("RPDO1 FE FF: Spool set point -2?"), "{}", output.stdout);
    assert_eq!(output.stderr, "");
    let pdos = events(&["--eds", &format!("can0:0x05={EDS}"), "-"], PDOS, "pdo");
    let signal = &pdos[0]["signals"][0];
    assert_eq!(
        (&signal["origin"], &signal["assumed"], &signal["value"]),
        (&"eds".into(), &true.into(), &1000.into())
    );
    assert_eq!(pdos[0]["device"], "example-valve");
    // Without the EDS, 1C5 is only a PDO of node 69.
    let without = ok(&["decode", "-"], PDOS).stdout;
    assert!(without.contains("69/45") && !without.contains("Spool"), "{without}");
    // The EDS does not apply to other buses.
    assert!(!ok(&["decode", "--eds", &format!("can1:5={EDS}"), "-"], PDOS).stdout.contains("Spool"));
}

#[test]
fn what_a_dcf_wants_is_a_layout_until_the_wire_shows_another() {
    // TPDO1 is 2002:00 only. Then the number of entries and the entry 2000:00 are read.
    let text = format!(
        "{PDOS}(1700000002.0) can0 605#40001A0000000000\n(1700000002.1) can0 585#4F001A0001000000\n\
         (1700000002.2) can0 605#40001A0100000000\n(1700000002.3) can0 585#43001A0110000020\n\
         (1700000002.4) can0 1C5#E803\n"
    );
    let pdos = events(&["--eds", &format!("5={DCF}"), "-"], &text, "pdo");
    let tpdos: Vec<_> =
        pdos.iter().filter(|pdo| pdo["pdo"] == "TPDO1").map(|pdo| &pdo["signals"][0]).collect();
    assert_eq!(
        (&tpdos[0]["id"], &tpdos[0]["origin"], &tpdos[0]["assumed"]),
        (&"0x2002:00".into(), &"dcf".into(), &true.into())
    );
    assert_eq!((&tpdos[1]["id"], &tpdos[1]["origin"]), (&"0x2000:00".into(), &"wire".into()));
    assert_eq!(tpdos[1]["assumed"], Value::Null);
}

#[test]
fn a_bus_file_names_device_files_beside_it() {
    for key in ["eds", "dcf"] {
        let bus = format!("[bus.can0.node.5]\n{key} = \"files/valve.eds\"\n");
        let folder = folder(&format!("eds_bus_{key}"), &[("bus.toml", bus)]);
        fs::create_dir(folder.join("files")).unwrap();
        fs::write(folder.join("files/valve.eds"), fixture(EDS)).unwrap();
        let path = folder.join("bus.toml");
        let output = ok(&["decode", "--bus", path.to_str().unwrap(), "-"], PDOS);
        assert!(output.stdout.contains("Spool position 1000?"), "{}", output.stdout);
    }
}

#[test]
fn a_profile_goes_before_a_device_file() {
    let profile = "id = \"mine\"\ntitle = \"Mine\"\nextends = [\"cia301\"]\n\n[[object]]\nindex = 0x2000\n\
        name = \"Position\"\ntype = \"INTEGER16\"\nunit = \"%\"\nscale = 0.1\n";
    let folder = folder("eds_profile", &[("mine.toml", profile.to_owned())]);
    let eds = format!("5={EDS}");
    let folder = folder.to_str().unwrap();
    let arguments = ["decode", "--profiles", folder, "--node", "5=mine", "--eds", &eds, "-"];
    let output = ok(&arguments, PDOS);
    assert!(
        output.stdout.contains("TPDO1 E8 03 14: Position 100.0 %?, Temperature 20?"),
        "{}",
        output.stdout
    );
}

#[test]
fn problems_of_a_file_are_printed_and_do_not_stop() {
    let output = ok(&["decode", "--eds", "5=fixtures/device_files/defects.eds", "-"], PDOS);
    let lines: Vec<_> = output.stderr.lines().collect();
    // 33 problems in total (defects.eds.expected.txt).
    assert_eq!(lines.len(), 6, "{}", output.stderr);
    assert!(
        lines[0]
            .starts_with("cobscope: fixtures/device_files/defects.eds:3: \"this line has no equals sign\"")
    );
    assert_eq!(
        lines[5],
        "cobscope: fixtures/device_files/defects.eds: 28 more problems (cobscope profiles check fixtures/device_files/defects.eds)"
    );
    let twice = ok(&["decode", "--eds", &format!("6={DCF}"), "--eds", &format!("5={DCF}"), "-"], PDOS);
    assert_eq!(
        twice.stderr,
        format!(
            "cobscope: {DCF}: for node 5; used for node 6\ncobscope: -: node 6/06 sent no frame; nodes present: 5/05\n"
        )
    );
}

#[test]
fn a_file_that_is_none_gives_4() {
    for (file, message) in
        [("no/such.eds", "no/such.eds: cannot be read"), ("LICENSE", "LICENSE: not an EDS, DCF or XDD")]
    {
        let output = run(&["decode", "--eds", &format!("5={file}"), "-"], PDOS);
        assert_eq!((output.code, output.stdout.as_str()), (4, ""));
        assert!(output.stderr.contains(message), "{}", output.stderr);
    }
    assert_eq!(run(&["decode", "--eds", "128=a.eds", "-"], PDOS).code, 2);
    assert_eq!(run(&["decode", "--eds", "5", "-"], PDOS).code, 2);
}

#[test]
fn device_files_of_a_folder_are_recognised_by_what_a_node_says() {
    let folder = folder(
        "eds_folder",
        &[("Valve.EDS", fixture(EDS)), ("other.xdd", fixture("fixtures/device_files/parameters.xdd"))],
    );
    let name = folder.to_str().unwrap();
    let text = format!("{IDENTITY}{PDOS}");
    let identified = events(&["--profiles", name, "-"], &text, "node-identified");
    assert_eq!(identified.len(), 1);
    assert_eq!(
        (&identified[0]["device"], &identified[0]["by"]),
        (&"example-valve".into(), &"identity".into())
    );
    let output = ok(&["decode", "--profiles", name, "-"], &text);
    assert!(output.stdout.contains("identified as Valve by its identity"), "{}", output.stdout);
    assert!(output.stdout.contains("Spool position 1000?"), "{}", output.stdout);
    // A second file of the same device is reported; none of them is used.
    fs::write(folder.join("valve.dcf"), fixture(DCF)).unwrap();
    let output = ok(&["decode", "--profiles", name, "-"], &text);
    assert!(
        output.stdout.contains("node 5 matches several profiles: example-valve, valve"),
        "{}",
        output.stdout
    );
    // A profile with the same identity overrides both.
    let profile = "id = \"mine\"\ntitle = \"Mine\"\nextends = [\"cia301\"]\n\n[[identity]]\nvendor_id = 0xA01\nproduct_code = 5\n";
    fs::write(folder.join("mine.toml"), profile).unwrap();
    let identified = events(&["--profiles", name, "-"], &text, "node-identified");
    assert_eq!((identified.len(), &identified[0]["device"]), (1, &"mine".into()));
    // Also with a file of the user: the profile first, then the entries of the file that it lacks.
    let output = ok(&["decode", "--profiles", name, "--eds", &format!("5={EDS}"), "-"], &text);
    assert!(output.stdout.contains("identified as Mine by its identity"), "{}", output.stdout);
    assert!(output.stdout.contains("Spool position 1000?"), "{}", output.stdout);
}

#[test]
fn contradictions_to_the_file_are_reported_once() {
    // Device type 0191 instead of 0198, twice; 2010:00 of one byte; product code 5 as in the file.
    let text = "(1700000001.0) can0 605#4000100000000000\n(1700000001.1) can0 585#4300100091010000\n\
        (1700000001.2) can0 605#4000100000000000\n(1700000001.3) can0 585#4300100091010000\n\
        (1700000001.4) can0 605#4010200000000000\n(1700000001.5) can0 585#4F10200005000000\n\
        (1700000001.6) can0 605#4018100200000000\n(1700000001.7) can0 585#4318100205000000\n";
    let conflicts = events(&["--eds", &format!("5={EDS}"), "-"], text, "conflict");
    assert_eq!(conflicts.len(), 2);
    let [device_type, ramp] = &conflicts[..] else { panic!("{conflicts:?}") };
    assert_eq!((&device_type["object"], &device_type["frames"][1]), (&"0x1000:00".into(), &2.into()));
    assert_eq!(device_type["sources"][0], serde_json::json!({"source": "eds", "data": "98010000"}));
    assert_eq!(device_type["sources"][1], serde_json::json!({"source": "upload", "data": "91010000"}));
    assert_eq!(ramp["text"], "1 byte received, 2 bytes expected (UNSIGNED16 in the eds)");
    let lines = ok(&["decode", "--eds", &format!("5={EDS}"), "-"], text).stdout;
    let line =
        "CONFLICT 1000:00 Device type: eds 98 01 00 00, upload 91 01 00 00; the file is for another device";
    assert!(lines.contains(line), "{lines}");
}

/// Ramp time: read 300, read 250; dead band: written 30, read 30, read 31.
const CONFIGURED: &str = "(1700000001.0) can0 605#4010200000000000\n(1700000001.1) can0 585#4B1020002C010000\n\
    (1700000001.2) can0 605#4010200000000000\n(1700000001.3) can0 585#4B102000FA000000\n\
    (1700000001.4) can0 605#2B1120001E000000\n(1700000001.5) can0 585#6011200000000000\n\
    (1700000001.6) can0 605#4011200000000000\n(1700000001.7) can0 585#4B1120001E000000\n\
    (1700000001.8) can0 605#4011200000000000\n(1700000001.9) can0 585#4B1120001F000000\n";

#[test]
fn a_value_a_dcf_wants_is_contradicted_unless_it_was_written() {
    let conflicts = events(&["--eds", &format!("5={DCF}"), "-"], CONFIGURED, "conflict");
    let [ramp] = &conflicts[..] else { panic!("{conflicts:?}") };
    assert_eq!(
        (&ramp["object"], &ramp["text"]),
        (&"0x2010:00".into(), &"value differs from the configuration in the file".into())
    );
    // 250 and 300.
    assert_eq!((&ramp["sources"][0]["data"], &ramp["sources"][1]["data"]), (&"FA00".into(), &"2C01".into()));
}

#[test]
fn objects_against_a_dcf() {
    // Of the values in the DCF, the node has the ramp time; the dead band differs; the key cannot be read.
    let output = ok(&["objects", "--want", DCF, "-"], CONFIGURED).stdout;
    let expected = "node 5/05 on can0 against valve.dcf: 1 different, 1 equal, 4 unknown\n\
        2011:00  Dead band                                           expected 40, is 31  read {10} 0.900 s\n\
        unknown: 1017:00 1800:01 1A00:00..01\n";
    assert_eq!(output, expected);
    let named =
        ok(&["objects", "--want", DCF, "--eds", &format!("5={DCF}"), "--node", "5", "-"], CONFIGURED).stdout;
    assert_eq!(named, expected);
    let json = ok(&["objects", "--want", DCF, "-f", "json", "-"], CONFIGURED).stdout;
    let records: Vec<Value> = json.lines().map(|line| serde_json::from_str(line).unwrap()).collect();
    let results: Vec<_> = records.iter().map(|record| record["result"].as_str().unwrap()).collect();
    assert_eq!(
        results,
        ["never-seen", "never-seen", "never-seen", "never-seen", "equal", "differs", "never-seen"]
    );
    assert_eq!((&records[5]["wanted"], &records[5]["data"]), (&"2800".into(), &"1F00".into()));
    let absent = run(&["objects", "--want", DCF, "--node", "9", "-"], CONFIGURED);
    assert_eq!(absent.stderr, "cobscope: -: node 9/09 sent no frame; nodes present: 5/05\n");
    assert_eq!((absent.code, absent.stdout.as_str()), (0, ""));
    // An NMT command to node 5 is not a frame of it.
    let silent = "(1700000000.0) can0 701#05\n(1700000000.1) can0 000#8105\n(1700000000.2) can0 000#8106\n";
    let silent = run(&["objects", "--want", DCF, "-"], silent);
    assert_eq!(silent.stderr, "cobscope: -: node 5/05 not present; nodes present: 1/01\n");
    let eds = run(&["objects", "--want", EDS, "-"], CONFIGURED);
    assert_eq!(
        (eds.code, eds.stderr.contains("no values to compare: EDS and XDD files have no values")),
        (4, true)
    );
    let text = fs::read_to_string(workspace().join("fixtures/device_files/minimal.eds")).unwrap();
    let dcf = folder("nothing-wanted", &[("a.dcf", format!("{text}\n[DeviceComissioning]\nNodeID=5\n"))]);
    let dcf = run(&["objects", "--want", dcf.join("a.dcf").to_str().unwrap(), "-"], CONFIGURED);
    assert!(dcf.stderr.contains("no values to compare: no ParameterValue"), "{}", dcf.stderr);
}

#[test]
fn objects_show_what_a_dcf_wants() {
    let output = ok(&["objects", "--eds", &format!("5={DCF}"), "--node", "5", "-"], CONFIGURED).stdout;
    let line = |object: &str| output.lines().find(|line| line.starts_with(object)).unwrap().to_owned();
    assert!(line("1017:00").contains("500 ms?         in DCF"), "{output}");
    assert!(line("2010:00").contains("250             read"), "{output}");
}

#[test]
fn a_profile_made_of_a_device_file_is_right_and_understood_alike() {
    let profile = ok(&["profiles", "import", EDS], "").stdout;
    assert!(profile.contains("id = \"example-valve\"\ntitle = \"Valve\"\nvendor = \"Example\""), "{profile}");
    let pdo = "[[pdo]]\npdo = \"TPDO1\"\nmapping = \"default\"\nfields = [\n  { object = \"2000:00\", bits = 16 },\n  { object = \"2002:00\", bits = 8 },\n]";
    assert!(profile.contains(pdo), "{profile}");
    let folder = folder("eds_import", &[("valve.toml", profile)]);
    let path = folder.join("valve.toml");
    let checked = ok(&["profiles", "check", path.to_str().unwrap()], "");
    assert!(checked.stdout.contains("valve.toml: ok, 0 samples"), "{}", checked.stdout);
    let arguments = ["decode", "--profiles", folder.to_str().unwrap(), "--node", "5=example-valve", "-"];
    let output = ok(&arguments, PDOS).stdout;
    assert!(output.contains("TPDO1 E8 03 14: Spool position 1000?, Temperature 20?"), "{output}");
    assert_eq!(run(&["profiles", "import", "LICENSE"], "").code, 4);
}

#[test]
fn device_files_are_checked() {
    let good = ok(&["profiles", "check", EDS, DCF], "");
    assert_eq!(good.stdout, format!("{EDS}: ok, 21 objects\n{DCF}: ok, 12 objects\n"));
    let bad = run(&["profiles", "check", "fixtures/device_files/defects.eds"], "");
    assert_eq!((bad.code, bad.stderr.lines().count()), (4, 33), "{}", bad.stderr);
    assert!(bad.stderr.contains("fixtures/device_files/defects.eds:34: [2000] without ParameterName\n"));
    assert_eq!(run(&["profiles", "check", "no/such.dcf"], "").code, 4);
}

#[test]
fn names_of_a_device_file_steer_no_terminal() {
    let hostile = fixture(EDS)
        .replace("Spool position", "Spool\u{1b}[2Jposition\u{202e}")
        .replace("=Valve", "=Val\u{7}ve");
    let folder = folder("eds_hostile", &[("va\u{1b}lve.eds", hostile)]);
    let path = folder.join("va\u{1b}lve.eds");
    let path = path.to_str().unwrap();
    let eds = format!("5={path}");
    let folder = folder.to_str().unwrap();
    let text = format!("{IDENTITY}{PDOS}");
    for arguments in [
        &["decode", "--eds", &eds, "-"][..],
        &["decode", "-f", "jsonl", "--eds", &eds, "-"],
        &["decode", "--profiles", folder, "-"],
        &["objects", "--eds", &eds, "--node", "5", "-"],
        &["profiles", "import", path],
        &["profiles", "list", "--profiles", folder],
        &["profiles", "show", "--profiles", folder, "example-val-ve"],
        &["profiles", "check", path],
    ] {
        let output = run(arguments, &text);
        for shown in [&output.stdout, &output.stderr] {
            let is_terminal_control = |c: char| c != '\n' && (c.is_control() || c == '\u{202e}');
            assert!(!shown.chars().any(is_terminal_control), "{arguments:?}: {shown:?}");
        }
    }
}
