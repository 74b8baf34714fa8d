//! SDO requests to node-IDs without a device: a scan, a node that is switched on later, and a node that is missing.

use std::fmt::Write as _;

use cobscope_decoder::finding::{CaptureFindings, Severity};

use crate::rules::{Annotated, judge, parse};

/// 20 s with heartbeats of nodes 5 and 6, and other frames: time in ms, frame.
fn findings_of(more: &[(u32, String)]) -> CaptureFindings {
    let mut frames: Vec<(u32, String)> = more.to_vec();
    for (node, phase) in [(5, 11), (6, 17)] {
        frames.extend((0..200).map(|number| (10 + phase + number * 100, format!("70{node}#05"))));
    }
    frames.sort();
    let text = frames.iter().fold(String::new(), |mut text, (time, frame)| {
        let (seconds, micros) = (1_700_000_000 + time / 1_000, time % 1_000 * 1_000 + time * 7 % 90);
        writeln!(text, "({seconds}.{micros:06}) can0 {frame}").unwrap();
        text
    });
    let Annotated { frames, options, setup, .. } = parse("absent nodes", &text);
    judge(&frames, &options, setup).1
}

fn request(node: u32, at: u32) -> (u32, String) {
    (at, format!("{:03X}#4000100000000000", 0x600 + node))
}

/// Severities of findings about requests without response.
fn severities(findings: &CaptureFindings) -> Vec<Severity> {
    let asked = findings.groups.iter().filter(|group| &*group.rule == "sdo-no-response");
    asked.map(|group| group.severity).collect()
}

#[test]
fn a_scan_is_one_statement() {
    let requests: Vec<_> = (10..20).map(|node| request(node, 1_000 + node * 50)).collect();
    let findings = findings_of(&requests);
    assert_eq!(severities(&findings), [Severity::Note; 10]);
    let scans: Vec<_> = findings.quality.iter().filter(|text| text.starts_with("scan")).collect();
    assert_eq!(scans, ["scan: no answer on 10 node-IDs"]);
}

#[test]
fn a_node_that_is_switched_on_later_is_a_note() {
    let later = (4_500, "714#00".to_owned());
    let findings = findings_of(&[request(20, 1_000), request(20, 3_000), later]);
    assert_eq!(severities(&findings), [Severity::Note]);
}

#[test]
fn a_missing_node_is_an_error() {
    let findings = findings_of(&[request(20, 1_000), request(20, 3_000)]);
    assert_eq!(severities(&findings), [Severity::Error]);
}
