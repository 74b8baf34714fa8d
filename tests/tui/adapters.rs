//! `cobscope live` with adapters of PEAK and Kvaser, whose drivers are simulated (`bindings/fake`).
#![cfg(feature = "adapters")]

use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};

use crate::support::workspace;

/// A fresh folder of this test.
fn folder(name: &str) -> PathBuf {
    let path = PathBuf::from(env!("CARGO_TARGET_TMPDIR")).join("adapters").join(name);
    let _ = fs::remove_dir_all(&path);
    fs::create_dir_all(&path).unwrap();
    path
}

/// The simulated drivers next to this program.
fn library() -> PathBuf {
    let program = std::env::current_exe().unwrap();
    let name =
        format!("{}cobscope_fake_drivers{}", std::env::consts::DLL_PREFIX, std::env::consts::DLL_SUFFIX);
    program.parent().unwrap().join(name)
}

/// Runs `cobscope live` with both drivers; calls are recorded in `folder`.
fn live(folder: &Path, scenario: &str, library: &Path, arguments: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_cobscope"))
        .arg("live")
        .args(arguments)
        .current_dir(workspace())
        .env("COBSCOPE_PCAN_LIBRARY", library)
        .env("COBSCOPE_KVASER_LIBRARY", library)
        .env("COBSCOPE_FAKE_SCENARIO", scenario)
        .env("COBSCOPE_FAKE_CALLS", folder.join("calls"))
        .output()
        .unwrap()
}

fn text(bytes: &[u8]) -> String {
    String::from_utf8(bytes.to_vec()).unwrap()
}

/// Calls of the driver, of which none transmits.
fn calls(folder: &Path) -> String {
    let calls = fs::read_to_string(folder.join("calls")).unwrap_or_default();
    assert!(!calls.contains("Write") && !calls.contains("normal mode"), "{calls}");
    calls
}

const SOURCES: [(&str, &str); 2] = [("pcan:USB1@500k", "pcan-USB1"), ("kvaser:0@500k", "kvaser-0")];

/// The recorded frames have the numbers 0 to 99,999 as their data, and times that keep the distance of 100 µs.
#[test]
fn a_recording_contains_each_of_100_000_frames() {
    for (source, bus) in SOURCES {
        let folder = folder(bus);
        let record = folder.join("run.log");
        let arguments =
            [source, "--print", "-f", "none", "-n", "100000", "--record", record.to_str().unwrap()];
        let output = live(&folder, "frames=100000", &library(), &arguments);
        assert_eq!(output.status.code(), Some(0), "{}", text(&output.stderr));
        let recorded = fs::read_to_string(&record).unwrap();
        assert_eq!(recorded.lines().count(), 100_000);
        let mut last = None;
        for (number, line) in recorded.lines().enumerate() {
            let (time, frame) = line.split_once(") ").unwrap();
            let data = format!("{:016X}", (number as u64).swap_bytes());
            assert_eq!(frame, format!("{bus} 181#{data}"));
            let time: f64 = time.trim_start_matches('(').parse().unwrap();
            assert!(last.is_none_or(|last| time >= last), "{line}");
            last = Some(time);
        }
        assert!(calls(&folder).contains("on the bus in listen-only mode"));
    }
}

#[test]
fn lost_frames_bus_off_and_an_unplugged_adapter_are_events() {
    for (source, bus) in SOURCES {
        let folder = folder(&format!("events-{bus}"));
        let scenario = "frames=30,burst=5,error_every=4,overrun_at=3,bus_off_at=9,unplug_at=20";
        let output =
            live(&folder, scenario, &library(), &[source, "--print", "-f", "jsonl", "--all", "-n", "33"]);
        let (events, errors) = (text(&output.stdout), text(&output.stderr));
        assert_eq!(output.status.code(), Some(0), "{errors}");
        for expected in [
            "\"kind\":\"link\"",
            "\"kind\":\"lost-frames\"",
            "\"class\":\"protocol,bus-error\"",
            "bus-off\"",
            "\"state\":\"gone\"",
        ] {
            assert!(events.contains(expected), "{expected}: {events}\n{errors}");
        }
        // Opened again after it was unplugged, and closed in the end.
        let calls = calls(&folder);
        assert_eq!(calls.matches("on the bus in listen-only mode").count(), 2, "{calls}");
        assert_eq!(calls.matches("Uninitialize").count() + calls.matches("canClose").count(), 2, "{calls}");
    }
}

#[test]
fn an_adapter_without_listen_only_mode_is_refused() {
    for (source, bus) in SOURCES {
        let folder = folder(&format!("refused-{bus}"));
        let output = live(&folder, "listen=ignore", &library(), &[source, "--print"]);
        let error = text(&output.stderr);
        assert_eq!(output.status.code(), Some(3), "{error}");
        assert!(error.contains("has no listen-only mode; other modes are not used"), "{error}");
        assert!(!calls(&folder).contains("on the bus"));
    }
}

#[test]
fn a_missing_driver_is_one_sentence_with_its_package() {
    let folder = folder("missing");
    let missing = folder.join("no-such-library");
    for ((source, _), package) in SOURCES.into_iter().zip(["PCAN-Basic API", "Kvaser"]) {
        let output = live(&folder, "", &missing, &[source, "--print"]);
        let error = text(&output.stderr);
        assert_eq!(output.status.code(), Some(3), "{error}");
        assert!(error.contains("no-such-library not available") && error.contains(package), "{error}");
        assert_eq!(error.lines().count(), 1, "{error}");
    }
    // Only a driver that is asked for is missed.
    let output = live(&folder, "", &missing, &[]);
    assert!(!text(&output.stderr).contains("not available"), "{}", text(&output.stderr));
}

#[test]
fn the_mode_of_the_controller_is_printed_and_shown() {
    for (source, bus) in SOURCES {
        let folder = folder(&format!("mode-{bus}"));
        let output = live(&folder, "frames=30", &library(), &[source, "--print", "-n", "30"]);
        let stated = text(&output.stderr);
        let expected = format!(
            "{bus}: up, 500000 bit/s, listen-only, timestamps by the adapter; cobscope sends no frames\n"
        );
        assert!(stated.contains(&expected), "{stated}");
    }
}

#[cfg(unix)]
#[test]
fn the_bus_pane_shows_the_mode_of_the_controller() {
    use crate::terminal::Session;
    use pty_process::blocking::Command as PtyCommand;

    let (source, bus) = SOURCES[0];
    let folder = folder(&format!("pane-{bus}"));
    let command = PtyCommand::new(env!("CARGO_BIN_EXE_cobscope"))
        .args(["live", source, "--pane", "bus"])
        .current_dir(workspace())
        .env("COBSCOPE_PCAN_LIBRARY", library())
        .env("COBSCOPE_FAKE_SCENARIO", "frames=30")
        .env("COBSCOPE_FAKE_CALLS", folder.join("calls"));
    let session = Session::start(command, 40, 120);
    session.wait_text("controller  listen-only");
    session.send("q");
    assert!(session.wait_end().success());
}

#[test]
fn adapters_are_listed_with_their_state() {
    let folder = folder("list");
    let list = |scenario| text(&live(&folder, scenario, &library(), &[]).stdout);
    let both = list("");
    assert!(both.contains("pcan:USB1@BITRATE: PCAN-USB FD, channel 1, device 7, available\n"), "{both}");
    assert!(both.contains("kvaser:0@BITRATE: Kvaser Leaf Pro HS v2, channel 1, available\n"), "{both}");
    let others = list("in_use,light");
    assert!(others.contains("device 7, in use by another program or driver\n"), "{others}");
    assert!(others.contains("channel 1, no listen-only mode\n"), "{others}");
}
