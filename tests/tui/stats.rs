//! `cobscope stats`.

use std::fmt::Write as _;

use serde_json::Value;

use crate::cli::run;
use crate::support;

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
    // fixtures/canopen/sdo_abort.expected.txt: twelve transfers, all aborted, one of them with node 3.
    let all = figures("fixtures/canopen/sdo_abort.log");
    let nodes = all["buses"][0]["nodes"].as_array().unwrap();
    assert_eq!(nodes.iter().map(|node| node["sdo"]["aborted"].as_u64().unwrap()).sum::<u64>(), 12);
    assert_eq!(nodes[0]["sdo"]["abort_codes"]["0x06020000"], 2);
    // The client gave up after 0.3 s: frames 28 and 29.
    assert_eq!(nodes[1]["sdo"]["duration_ms"]["max"], 300.0);
}

#[test]
fn made_up_stamps_and_missing_error_frames_are_said() {
    let lines = every_millisecond(1_200, "705#05");
    let text = run(&["stats", "-"], &lines).stdout;
    assert!(text.contains("stamps are made up: every 1.000 ms"), "{text}");
    assert!(text.contains("no error frames"), "{text}");
    assert!(text.contains("needs the bit rate"), "{text}");
}

#[test]
fn load_needs_a_bit_rate() {
    // 1,000 frames a second of 0x555 without data, 48 bits each: 48 kbit/s are 19 % of 250.
    let lines = every_millisecond(3_000, "555#");
    let text = run(&["stats", "--bitrate", "250k", "-"], &lines).stdout;
    assert!(text.contains("load 19 % of 250 kbit/s, worst second 19 %"), "{text}");
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
