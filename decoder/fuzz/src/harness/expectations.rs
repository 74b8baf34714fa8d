//! Expectations: any bus file must be accepted, or rejected with a position. The verdicts of an accepted one
//! must not depend on whether time advances between frames.

use std::sync::Arc;

use cobscope_decoder::Reading;
use cobscope_decoder::bus_file::BusFile;
use cobscope_decoder::capture::{Batch, BatchItem, CaptureReader, ReadOptions};
use cobscope_decoder::finding::{CaptureFindings, RuleOrigin};
use cobscope_decoder::frame::Timestamp;
use cobscope_decoder::profile::TextError;
use cobscope_decoder::rules::RuleSetup;
use cobscope_decoder::session::SessionOptions;

/// Captures to check, of several protocols.
const CAPTURES: [&str; 4] = [
    include_str!("../../../../fixtures/canopen/mid_run.log"),
    include_str!("../../../../fixtures/canopen/pdo_mapping.log"),
    include_str!("../../../../fixtures/rules/expect-every.log"),
    include_str!("../../../../fixtures/rules/expect-order.log"),
];

/// Fuzzes the expectations of a bus file.
pub fn expectations(data: &[u8]) {
    let Ok(text) = std::str::from_utf8(data) else { return };
    let Some((options, setup)) = understood(text) else { return };
    for capture in CAPTURES {
        let recorded = verdicts(&judge(capture, &options, &setup, |_| 0));
        assert!(!recorded.contains('\x1b') || text.contains('\x1b') || text.contains("\\u"), "{recorded}");
        let live = verdicts(&judge(capture, &options, &setup, |gap| gap / 3));
        assert!(
            recorded == live,
            "with time that passes between frames: {:#?}",
            differences(&recorded, &live)
        );
    }
}

/// Parses a bus file; `None` if it is invalid.
fn understood(text: &str) -> Option<(SessionOptions, Arc<RuleSetup>)> {
    let lines = text.matches('\n').count() + 1;
    let refused = |error: &TextError| {
        assert!((1..=lines).contains(&error.line) && error.column > 0, "{error}");
        assert!(!error.show_in_file("f").contains('\x1b') && !error.message.is_empty());
    };
    let file = BusFile::parse(text).inspect_err(refused).ok()?;
    let setup = RuleSetup::new(&file, text, None).inspect_err(refused).ok()?;
    for rule in setup.rules() {
        assert!(!rule.title.is_empty() && rule.cited_source().is_some() && rule.word.len() <= 6);
    }
    Some((SessionOptions { bus_file: file, ..SessionOptions::default() }, Arc::new(setup)))
}

/// Checks a capture as on a live bus. `step` returns the interval, in nanoseconds, at which time advances
/// within a gap between two frames; 0 for no advance.
pub fn judge(
    capture: &str,
    options: &SessionOptions,
    setup: &Arc<RuleSetup>,
    mut step: impl FnMut(i64) -> i64,
) -> CaptureFindings {
    let mut reader = CaptureReader::open(capture.as_bytes(), &ReadOptions::default()).unwrap();
    let mut reading = Reading::of_options(options.clone(), Some(Arc::clone(setup)), ());
    let mut batch = Batch::new();
    let mut last = None;
    while reader.read(&mut batch).unwrap() {
        reading.set_buses(reader.buses().clone());
        for item in batch.items() {
            match item {
                BatchItem::Frame(frame) => {
                    if let (Some(Timestamp(last)), Some(Timestamp(next))) = (last, frame.time) {
                        let step = step(next.saturating_sub(last));
                        let mut now = last.saturating_add(step);
                        while step > 0 && now < next {
                            reading.advance(Timestamp(now));
                            now += step;
                        }
                    }
                    last = frame.time;
                    reading.push(frame);
                }
                BatchItem::Notice(notice) => reading.notice(notice),
            }
        }
    }
    reading.finish().findings
}

/// Lines that are in one of the texts only.
pub fn differences<'a>(recorded: &'a str, live: &'a str) -> Vec<(&'static str, &'a str)> {
    let only = |of: &'a str, other: &'a str| {
        of.lines().filter(move |line| !other.lines().any(|known| known == *line))
    };
    let recorded_only = only(recorded, live).map(|line| ("recorded", line));
    recorded_only.chain(only(live, recorded).map(|line| ("live", line))).collect()
}

/// Findings and verdicts of expectations, independent of their order, and verdicts of the other rules.
pub fn verdicts(findings: &CaptureFindings) -> String {
    let mut lines: Vec<String> = Vec::new();
    for group in &findings.groups {
        assert!(!group.text.is_empty() && !group.text.contains('\n'), "{}", group.text);
        if findings.rules[usize::from(group.key.rule)].origin == RuleOrigin::Expectation {
            lines.push(format!(
                "{} {} {} {:?} {:?} {:?} {:?}",
                group.fingerprint(),
                group.severity.name(),
                group.count,
                group.text,
                group.worst,
                group.first,
                group.last
            ));
        } else {
            lines.push(format!("{} {}", group.fingerprint(), group.severity.name()));
        }
    }
    lines.sort();
    for (rule, tally) in findings.rules.iter().zip(&findings.tallies) {
        match rule.origin {
            RuleOrigin::Expectation => lines.push(format!("{} {tally:?}", rule.name)),
            _ => lines.push(format!("{} {}", rule.name, tally.verdict().name())),
        }
    }
    format!("{}\n{}\n{:?}", lines.join("\n"), findings.quality.join("\n"), findings.suppressions)
}
