//! Frames that the recorder lost: single elements of messages of several senders are missing while their phase is unchanged.

use std::fmt::Write as _;

use cobscope_decoder::finding::{CaptureFindings, Severity};

use crate::rules::{Annotated, judge, parse};

/// Periodic messages: identifier, data, period and phase in ms. SYNC, and heartbeats of two nodes whose producer time is read.
const STREAMS: [(&str, &str, u32, u32); 3] =
    [("080", "", 20, 3), ("705", "05", 100, 11), ("706", "05", 100, 17)];

/// 20 s of all messages without those in `lost`: identifier and number.
fn findings_without(lost: &[(&str, u32)]) -> CaptureFindings {
    let mut frames = vec![];
    for (number, node) in [5, 6].into_iter().enumerate() {
        let at = u32::try_from(number).unwrap() * 2;
        frames.push((at, format!("60{node}#4017100000000000")));
        frames.push((at + 1, format!("58{node}#4B17100064000000")));
    }
    for (id, data, period, phase) in STREAMS {
        let numbers = (0..20_000 / period).filter(|number| !lost.contains(&(id, *number)));
        frames.extend(numbers.map(|number| (10 + phase + number * period, format!("{id}#{data}"))));
    }
    frames.sort();
    let text = frames.iter().fold(String::new(), |mut text, (time, frame)| {
        // Jitter keeps the timestamps real.
        let (seconds, micros) = (1_700_000_000 + time / 1_000, time % 1_000 * 1_000 + time * 7 % 90);
        writeln!(text, "({seconds}.{micros:06}) can0 {frame}").unwrap();
        text
    });
    let Annotated { frames, options, setup, .. } = parse("missing frames", &text);
    judge(&frames, &options, setup).1
}

/// Rules with findings above notes.
fn judged(findings: &CaptureFindings) -> Vec<&str> {
    let above = findings.groups.iter().filter(|group| group.severity > Severity::Note);
    above.map(|group| &*group.rule).collect()
}

fn statement(findings: &CaptureFindings) -> Option<&str> {
    findings.quality.iter().map(String::as_str).find(|text| text.contains("not captured"))
}

/// Intervals of a stream of n frames: two of them show the period, so 1,000 SYNC count 997 and 200 heartbeats 197. Each gap
/// takes one frame of two intervals, and counts as one missing element.
#[test]
fn single_gaps_of_several_senders_are_one_statement() {
    let clean = findings_without(&[]);
    assert_eq!((judged(&clean), statement(&clean)), (vec![], None));
    let lost = findings_without(&[("080", 300), ("080", 650), ("705", 60), ("706", 120)]);
    assert_eq!(judged(&lost), Vec::<&str>::new());
    // 997 - 4 + 2, 197 - 2 + 1 twice: 4 of 1,387.
    assert_eq!(
        statement(&lost),
        Some(
            "about 0.3 % of the frames not captured (4 elements of periodic messages): single gaps are notes"
        )
    );
}

#[test]
fn one_missing_element_is_no_finding() {
    let lost = findings_without(&[("706", 120)]);
    assert_eq!(judged(&lost), Vec::<&str>::new());
    let text = "1 element of a periodic message not captured: single gaps are notes";
    assert_eq!(statement(&lost), Some(text));
}

#[test]
fn a_sender_that_alone_misses_elements_did_not_send_them() {
    let lost = findings_without(&[("705", 40), ("705", 60), ("705", 90), ("705", 150)]);
    assert_eq!((judged(&lost), statement(&lost)), (vec!["node-lost"], None));
}

#[test]
fn a_silence_is_a_finding_also_if_frames_are_missing() {
    let silence = (60..70).map(|number| ("705", number));
    let lost: Vec<_> = silence.chain([("080", 300), ("080", 650), ("706", 120)]).collect();
    let findings = findings_without(&lost);
    assert_eq!(judged(&findings), ["node-lost"]);
    assert!(statement(&findings).is_some());
}
