//! The command `cobscope profiles`.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

use cobscope_decoder::profile::Catalogue;

use crate::cli::run;
use crate::docs::is_current;
use crate::support::workspace;

/// A folder of this test with one profile in it.
fn folder(name: &str, text: &str) -> PathBuf {
    let folder = Path::new(env!("CARGO_TARGET_TMPDIR")).join(name);
    let _ = fs::remove_dir_all(&folder);
    fs::create_dir_all(&folder).unwrap();
    fs::write(folder.join("pump.toml"), text).unwrap();
    folder
}

fn path(folder: &Path) -> String {
    folder.to_str().unwrap().to_owned()
}

/// 2001 has 0.1 bar per digit; 2000 is a word of two bits; 2010 to 2012 are equal.
const PUMP: &str = "id = \"acme-pump\"\ntitle = \"Pump\"\nvendor = \"Acme\"\nextends = [\"cia301\"]\n\n\
    [[object]]\nindex = 0x2000\nname = \"Status\"\ntype = \"UNSIGNED8\"\naccess = \"ro\"\n\
    bits = [ { bit = 0, name = \"on\" }, { bit = 1, name = \"hot\" } ]\nsource = \"3\"\n\n\
    [[object]]\nindex = 0x2001\nname = \"Pressure\"\ntype = \"INTEGER16\"\naccess = \"rw\"\nunit = \"bar\"\n\
    scale = 0.1\nrange = [0, 4000]\ndefault = 50\nsource = \"4\"\n\n\
    [[object]]\nindex = 0x2010\nrepeat = { count = 3, stride = 1 }\nname = \"Ramp {n}\"\ntype = \"UNSIGNED16\"\n\
    unit = \"ms\"\n\n\
    [[pdo]]\npdo = \"TPDO1\"\nmapping = \"fixed\"\nsource = \"5\"\n\
    fields = [ { object = \"2000:00\", bits = 8 }, { object = \"2001:00\", bits = 16 } ]\n";

#[test]
fn all_devices_are_listed_with_their_variants() {
    let output = run(&["profiles", "list"], "");
    assert_eq!((output.stderr.as_str(), output.code), ("", 0));
    is_current("tests/tui/profiles_list.txt", &output.stdout);
    let catalogue = Catalogue::default();
    let mut expected = Vec::new();
    for id in catalogue.ids() {
        let variants = &catalogue.device(&id).unwrap().variants;
        let variants = variants.iter().map(|variant| format!("{id}:{}", variant.id)).collect::<Vec<_>>();
        expected.push(id);
        expected.extend(variants);
    }
    let listed: Vec<&str> = output.stdout.lines().filter_map(|line| line.split_whitespace().next()).collect();
    assert_eq!(listed, expected);
}

#[test]
fn profiles_of_the_user_are_listed_too() {
    let folder = folder("list", PUMP);
    let output = run(&["profiles", "list", "--profiles", &path(&folder)], "");
    assert_eq!(output.code, 0, "{}", output.stderr);
    let line = format!("acme-pump                Pump\n  from {}\n", folder.join("pump.toml").display());
    assert!(output.stdout.starts_with(&line), "{}", output.stdout);
}

#[test]
fn bus_files_beside_profiles_are_passed_over() {
    let folder = folder("beside", PUMP);
    let all = ["uds/named.bus.toml", "machine/machine.bus.toml", "incidents/250k.bus.toml"];
    for (at, file) in all.into_iter().enumerate() {
        let file = workspace().join("fixtures").join(file);
        fs::copy(file, folder.join(format!("bus{at}.toml"))).unwrap();
    }
    fs::write(folder.join("id.toml"), "[[id]]\nid = 0x1A0\nservice = \"none\"\n").unwrap();
    let output = run(&["profiles", "list", "--profiles", &path(&folder)], "");
    assert_eq!((output.stderr.as_str(), output.code), ("", 0));
    fs::write(folder.join("none.toml"), "[[object]]\nindx = 1\n").unwrap();
    let output = run(&["profiles", "list", "--profiles", &path(&folder)], "");
    assert!(output.stderr.contains("none.toml:2:1: unknown field `indx`"), "{}", output.stderr);
}

#[test]
fn of_two_profiles_with_one_id_the_last_is_used_and_reported() {
    let folder = folder("twice", PUMP);
    fs::write(folder.join("valve.toml"), PUMP).unwrap();
    fs::write(folder.join("own.toml"), PUMP.replace("acme-pump", "rexroth-vpcd")).unwrap();
    let output = run(&["profiles", "list", "--profiles", &path(&folder)], "");
    let file = |name: &str| path(&folder.join(name));
    let expected = format!(
        "cobscope: {}: overrides the built-in profile for rexroth-vpcd\n\
         cobscope: {}: overrides {} for acme-pump\n",
        file("own.toml"),
        file("valve.toml"),
        file("pump.toml")
    );
    assert_eq!(output.stderr, expected);
}

#[test]
fn a_profile_without_samples_is_reported() {
    let unshown = folder("unshown", PUMP);
    let file = path(&unshown.join("pump.toml"));
    let output = run(&["profiles", "check", &file], "");
    let expected = format!("{file}: ok, 0 samples; values not verified\n");
    assert_eq!((output.stdout, output.code), (expected, 0));
}

#[test]
fn an_id_that_no_option_can_name_is_no_id() {
    let folder = folder("unnamed", &PUMP.replace("acme-pump", "Acme pump:a"));
    let file = path(&folder.join("pump.toml"));
    let output = run(&["profiles", "check", &file], "");
    let stated = format!("cobscope: {file}:1:6: invalid id 'Acme pump:a'; expected a-z, 0-9 and hyphens\n");
    assert!(output.stderr.starts_with(&stated), "{}", output.stderr);
    assert_eq!((output.stdout.as_str(), output.code), ("", 4));
}

#[test]
fn a_set_point_without_gates_says_why_nothing_is_known() {
    let text = format!(
        "{PUMP}\n[[object]]\nindex = 0x2005\nname = \"Pressure set point\"\ntype = \"UNSIGNED16\"\n\
         unit = \"bar\"\nscale = 0.1\nrole = \"set-point\"\n\n\
         [[pdo]]\npdo = \"RPDO1\"\nmapping = \"fixed\"\nfields = [ {{ object = \"2005:00\", bits = 16 }} ]\n"
    );
    let folder = folder("gateless", &text);
    let frames = "(1.0) can0 705#05\n(1.1) can0 205#D007\n";
    let output = run(
        &["decode", "--protocol", "canopen", "--profiles", &path(&folder), "--node", "5=acme-pump"],
        frames,
    );
    let line = output.stdout.lines().find(|line| line.contains("SETPT")).unwrap_or_default();
    let stated = "Pressure set point 200.0 bar effective: unknown (no gates in the profile)";
    assert!(line.contains(stated), "{}{}", output.stdout, output.stderr);
}

#[test]
fn a_page_holds_what_the_profile_says() {
    let folder = folder("show", PUMP);
    let output = run(&["profiles", "show", "--profiles", &path(&folder), "acme-pump"], "");
    let expected = "\
acme-pump  Pump
Acme

Network
  recognised by: none; assign it in the bus file or with --node
  starts with: a boot-up message

PDOs
  TPDO1: 2000:00 Status (8 bit), 2001:00 Pressure (16 bit)  [5]

Objects
  2000:00  Status, UNSIGNED8 ro, 2 bit fields  [3]
  2001:00  Pressure, INTEGER16 rw, bar = raw × 0.1, 0.0 to 400.0 bar, default 5.0 bar  [4]
  2010:00…2012:00  Ramp 1…3, UNSIGNED16, ms, ×3
";
    assert_eq!((output.stdout.as_str(), output.code), (expected, 0), "{}", output.stderr);
}

#[test]
fn lines_of_the_manuals_worked_out_by_hand() {
    let lines = [
        // RE 30027-Z 10.4.1 and 5208:02; 19.1; 16.2 (sets 0 to 15); 14.3; 17.4.2.
        (
            "rexroth-sydfec",
            "  503A:00  Pressure set point, INTEGER16 ro, bar = raw × 5208:02 / 16383, 0.0 to 315.0 bar  [10.4.1]",
        ),
        (
            "rexroth-sydfec",
            "  5400:07…540F:07  Parameter set 0…15, Pressure transducer input, INTEGER16 rw, 1 to 4, ×16  [16.2]",
        ),
        (
            "rexroth-sydfec",
            "  8102  life guarding: master silent, register 10 (communication) → NMT pre-operational  [12, 14.3.1.1]",
        ),
        ("rexroth-sydfec", "  transducer-range-pre-operational: "),
        // Eight channels, 800h apart; a set point is % of 16384; R with H moves FAULT HOLD to HOLD.
        (
            "wandfluh-md2",
            "  6300:01…9B00:01  Spool set point 1…8, INTEGER16 rw, % = raw × 100 / 16384, -100.0 to 100.0 %, default 0.0 %, ×8,",
        ),
        ("wandfluh-md2", "  FAULT HOLD → HOLD: control & 0A = 0A, bit 3 0→1; send 03, then 0B"),
        ("wandfluh-md2", "  control-mode-only-when-off: "),
        ("wandfluh-md2", "  tpdo1…4-answers-rpdo1…4: "),
        // 1018 identifies it; EMCY 0000 at boot.
        ("danfoss-pve-ci", "  recognised by: 1018:01 = 01000019, 1018:02 = 53360000"),
        ("danfoss-pve-ci", "  starts with: a boot-up message, and EMCY 0000  "),
        // Flow in closed loop: 0.1 l/min.
        (
            "rexroth-ifb-iac",
            "           6043:00 = -3 (pQ, Q closed loop): Flow set point, l/min = raw × 0.1, -1638.4 to 1638.4 l/min",
        ),
        // 4.74: scale 324.7 as printed; areas set with the manufacturer's tool.
        (
            "rexroth-vpcd",
            "  2F0E:00  Pressure command, INTEGER32 ro, bar = raw / 324.7, 0 to 600 bar  [4.74]",
        ),
        ("rexroth-vpcd", "  TPDO3: set in the manufacturer's tool: tx_area in the bus file  [3.4]"),
    ];
    for (profile, line) in lines {
        let output = run(&["profiles", "show", profile], "").stdout;
        assert!(output.lines().any(|is| is.starts_with(line)), "{line}\n{output}");
    }
}

#[test]
fn no_line_is_too_long_to_read() {
    let catalogue = Catalogue::default();
    for id in catalogue.ids() {
        let device = catalogue.device(&id).unwrap();
        let variants = device.variants.iter().map(|variant| format!("{id}:{}", variant.id));
        for name in std::iter::once(id.clone()).chain(variants) {
            let output = run(&["profiles", "show", &name], "").stdout;
            for line in output.lines() {
                assert!(line.chars().count() <= 120 && line.trim_end() == line, "{name}: {line}");
            }
        }
    }
}

#[test]
fn counts() {
    // 24 variables, 9 entries of 1003 … (docs/profile-counts.md); 0000, 8305, 8003.
    let output = run(&["profiles", "show", "--count", "danfoss-pve-ci:pveo"], "");
    assert_eq!(output.code, 0);
    assert!(output.stdout.starts_with("danfoss-pve-ci:pveo\n  object entries   68\n  EMCY codes       3\n"));
    // The controller has 96 objects more than the amplifier.
    assert!(
        run(&["profiles", "show", "--count", "wandfluh-md2"], "").stdout.contains("object entries   490\n")
    );
}

#[test]
fn a_profile_that_is_not_there_is_a_mistake_of_the_command_line() {
    let unknown = run(&["profiles", "show", "sydfec"], "");
    assert_eq!(unknown.code, 2);
    let expected =
        "cobscope: unknown profile 'sydfec'; did you mean 'rexroth-sydfec'? (cobscope profiles list)\n";
    assert_eq!(unknown.stderr, expected);
    let variant = run(&["profiles", "show", "wandfluh-md2:pump"], "");
    assert_eq!(variant.code, 2);
    let expected = "unknown variant 'pump' of profile 'wandfluh-md2'; expected amplifier, controller";
    assert!(variant.stderr.contains(expected), "{}", variant.stderr);
    let none = run(&["profiles", "show", "rexroth-sydfec:pump"], "");
    assert!(none.stderr.contains("; it has no variants"), "{}", none.stderr);
}

#[test]
fn a_valid_profile_is_reported_as_valid() {
    let folder = folder("right", PUMP);
    let name = path(&folder.join("pump.toml"));
    let output = run(&["profiles", "check", &name], "");
    assert_eq!((output.stdout, output.code), (format!("{name}: ok, 0 samples; values not verified\n"), 0));
}

#[test]
fn a_broken_profile_gives_4_and_the_place() {
    let folder = folder("broken", &PUMP.replace("unit = \"bar\"", "unit = \"baar\""));
    let name = path(&folder.join("pump.toml"));
    // The unit is in line 19 from column 8 on; the error lists all units.
    let begin = format!("cobscope: {name}:19:8: unknown unit 'baar'; expected one of % ‰ bar mbar psi ");
    let end = " bytes B\n  19 | unit = \"baar\"\n     |        ^^^^^^\n";
    let is_place = |text: &str| text.starts_with(&begin) && text.ends_with(end) && text.lines().count() == 3;
    let output = run(&["profiles", "check", &name], "");
    assert!(is_place(&output.stderr) && output.code == 4, "{}", output.stderr);
    // The list continues without the profile, reports it once and also ends with 4.
    let output = run(&["profiles", "list", "--profiles", &path(&folder)], "");
    assert!(is_place(&output.stderr) && output.code == 4, "{}", output.stderr);
    assert!(output.stdout.contains("pump                     invalid\n"), "{}", output.stdout);
    assert!(output.stdout.contains("rexroth-sydfec"), "{}", output.stdout);
}

#[test]
fn what_a_profile_s_grammar_does_not_show_is_found() {
    let folder =
        folder("wrong", &PUMP.replace("scale = 0.1\nrange = [0, 4000]", "scale = 0.1\nrange = [0, 40000]"));
    let name = path(&folder.join("pump.toml"));
    let output = run(&["profiles", "check", &name], "");
    assert_eq!(output.code, 4);
    assert!(
        output.stderr.contains("pump.toml:14:1: range 40000 does not fit INTEGER16"),
        "{}",
        output.stderr
    );
    let missing = run(&["profiles", "check", "no/such.toml"], "");
    assert_eq!((missing.code, missing.stderr.contains("no/such.toml: ")), (4, true));
}

#[test]
fn waivers_are_of_rules_there_are() {
    let waiver = "\n[[waiver]]\nrule = \"sdo-short-frame\"\ntext = \"t\"\n";
    let place = folder("waiver", &format!("{PUMP}{waiver}"));
    let output = run(&["profiles", "check", &path(&place.join("pump.toml"))], "");
    let line = PUMP.lines().count() + 3;
    let stated = format!("pump.toml:{line}:8: unknown rule 'sdo-short-frame' in waiver; similar rules: ");
    assert!(output.code == 4 && output.stderr.contains(&stated), "{}", output.stderr);
}

#[test]
fn samples_are_run() {
    // 01 F2 = 498: 49.8 bar.
    let sample = |value: &str| {
        format!(
            "{PUMP}\n[[sample]]\nabout = \"half\"\nframes = [\"181#03F201\"]\npdo = \"TPDO1\"\n\
             signals = {{ \"2001:00\" = {value} }}\ntexts = {{ \"2000:00\" = \"on, hot\" }}\n"
        )
    };
    let right = path(&folder("sample", &sample("49.8")).join("pump.toml"));
    let output = run(&["profiles", "check", &right], "");
    assert_eq!((output.stdout, output.code), (format!("{right}: ok, 1 sample\n"), 0));
    let wrong = path(&folder("wrong-sample", &sample("49.4")).join("pump.toml"));
    let output = run(&["profiles", "check", &wrong], "");
    let expected = format!(
        "cobscope: {wrong}:42:25: acme-pump: sample: half: 2001:00: found 49.8, expected 49.4\n\
         \x20 42 | signals = {{ \"2001:00\" = 49.4 }}\n     |                         ^^^^\n"
    );
    assert_eq!((output.stderr, output.code), (expected, 4));
}

#[test]
fn a_profile_of_the_user_explains_as_well() {
    let right = folder("explain", PUMP);
    let output = run(&["explain", "2001", "--device", "acme-pump", "--profiles", &path(&right)], "");
    assert_eq!(output.code, 0, "{}", output.stderr);
    assert!(output.stdout.contains("unit         bar = raw × 0.1\n"), "{}", output.stdout);
    // Not found by its id: a broken file is identified by its file name.
    let broken = folder("explain_broken", "id = \"acme-pump\"\n[[object]]\nindx = 1\n");
    let output = run(&["explain", "2001", "--device", "pump", "--profiles", &path(&broken)], "");
    assert_eq!(output.code, 4);
    assert!(output.stderr.contains("pump.toml:3:1: unknown field `indx`"), "{}", output.stderr);
}

#[test]
fn a_profile_in_the_folder_of_the_user_is_named_where_it_is_not_read() {
    let profiles = folder("config/cobscope/profiles", PUMP);
    let config = Path::new(env!("CARGO_TARGET_TMPDIR")).join("config");
    let run = |arguments: &[&str]| {
        let mut program = Command::new(env!("CARGO_BIN_EXE_cobscope"));
        let program = program.args(arguments).current_dir(workspace()).env("XDG_CONFIG_HOME", &config);
        let output = program.stdin(Stdio::null()).output().unwrap();
        (String::from_utf8(output.stderr).unwrap(), output.status.code())
    };
    let hint = format!("; --user-profiles reads it from {}", profiles.display());
    let lake = folder("config-lake", PUMP);
    let (capture, lake) = ("fixtures/rules/clean/canopen.log", path(&lake));
    for command in [&["check"][..], &["lake", "add", &lake]] {
        if command.len() > 1 && !cfg!(feature = "parquet") {
            continue;
        }
        let given = |node| run(&[command, &["--node", node, capture]].concat());
        let list = "(cobscope profiles list)";
        let expected = format!("cobscope: --node 5=acme-pump: unknown profile 'acme-pump' {list}{hint}\n");
        assert_eq!(given("5=acme-pump"), (expected, Some(4)));
        // No folder has it.
        let expected = format!("cobscope: --node 5=other: unknown profile 'other' {list}\n");
        assert_eq!(given("5=other"), (expected, Some(4)));
    }
    let bus = path(&profiles.join("machine.bus.toml"));
    fs::write(&bus, "[node.5]\ndevice = \"acme-pump\"\n").unwrap();
    let expected = format!(
        "cobscope: {bus}:2:10: unknown profile 'acme-pump'{hint}\n  2 | device = \"acme-pump\"\n    |          \
         ^^^^^^^^^^^\n"
    );
    assert_eq!(run(&["check", "--bus", &bus, capture]), (expected, Some(4)));
    assert_eq!(run(&["check", "--user-profiles", "--node", "5=acme-pump", capture]).1, Some(0));
}
