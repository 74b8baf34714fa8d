//! A controller with a heartbeat of its own: its commands to all nodes are not for itself.

use std::fmt::Write as _;

use cobscope_decoder::finding::CaptureFindings;

use crate::rules::{Annotated, judge, parse};

/// Nodes 5 and 127 send heartbeats for 8 s. After 2 s all nodes are reset: node 5 boots, node 127 continues; then all are
/// started. `more` are further frames: time in ms, frame.
fn findings_of(more: &[(u32, &str)]) -> CaptureFindings {
    let mut frames: Vec<(u32, &str)> = more.to_vec();
    let beats = |id: &'static str, from: u32, to: u32| (from / 100..to / 100).map(move |n| (n * 100 + 7, id));
    frames.extend(beats("705#7F", 100, 2_000));
    frames.extend([(2_000, "000#8100"), (2_300, "705#00"), (3_000, "000#0100")]);
    frames.extend(beats("705#7F", 2_400, 3_000));
    frames.extend(beats("705#05", 3_000, 8_000));
    frames.extend(beats("77F#7F", 0, 8_000));
    frames.sort_unstable();
    let text = frames.iter().fold(String::new(), |mut text, (time, frame)| {
        let (seconds, micros) = (1_700_000_000 + time / 1_000, time % 1_000 * 1_000 + time * 7 % 90);
        writeln!(text, "({seconds}.{micros:06}) can0 {frame}").unwrap();
        text
    });
    let Annotated { frames, options, setup, .. } = parse("controller", &text);
    judge(&frames, &options, setup).1
}

fn rules(findings: &CaptureFindings) -> Vec<&str> {
    let mut rules: Vec<&str> = findings.groups.iter().map(|group| &*group.rule).collect();
    rules.sort_unstable();
    rules
}

#[test]
fn its_commands_are_not_for_itself() {
    assert_eq!(rules(&findings_of(&[])), Vec::<&str>::new());
}

/// A node with an SDO server is a slave: it did not execute reset and start.
#[test]
fn a_slave_that_ignores_them_is_found() {
    let read = [(1_000, "67F#4000100000000000"), (1_003, "5FF#4300100000000000")];
    let all = ["boot-up-missing", "nmt-command-ignored", "traffic-before-boot"];
    assert_eq!(rules(&findings_of(&read)), all);
}
