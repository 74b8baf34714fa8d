//! Texts about findings, shared by all output.

use std::fmt::Write as _;

use super::{FactCause, FindingCause, FindingGroup, Occurrence};
use crate::figures::format_time;
use crate::frame::Timestamp;
use crate::wire::NodeId;

/// `can0 5/05 pump`.
pub fn node_phrase(group: &FindingGroup) -> String {
    let node = group.key.node.map(NodeId::label);
    let parts = [Some(group.bus.to_string()), node, group.node_name.as_deref().map(str::to_owned)];
    parts.into_iter().flatten().filter(|part| !part.is_empty()).collect::<Vec<_>>().join(" ")
}

/// Text of a fact with its node and frames: `7/07 mixer  1005:00 = 40000080h written {185-188}`.
pub fn fact_text(fact: &FactCause) -> String {
    let parts = [fact.node.map(NodeId::label), fact.node_name.as_deref().map(str::to_owned)];
    let who = parts.into_iter().flatten().collect::<Vec<_>>().join(" ");
    let gap = if who.is_empty() { "" } else { "  " };
    let frames = format_moment(Occurrence { time: None, frames: fact.at.frames }, None);
    format!("{who}{gap}{} {frames}", fact.text).trim_end().to_owned()
}

/// The subject of a finding and its text: `1018:01 Vendor-ID: response after 300 ms`.
pub fn subject_phrase(group: &FindingGroup) -> String {
    let about = group.key.about.to_string();
    if about.is_empty() || group.text.contains(&about) {
        return group.text.clone();
    }
    match &group.object_name {
        Some(name) => format!("{about} {name}: {}", group.text),
        None => format!("{about}: {}", group.text),
    }
}

/// The finding in one sentence: `heartbeat interval 170 ms > 150 ms for 6.6 s, 12 times; check the cycle
/// time`.
pub fn finding_sentence(group: &FindingGroup) -> String {
    let mut text = subject_phrase(group);
    if let Some(duration) = group.duration().filter(|duration| *duration > 0) {
        text.push_str(" for ");
        text.push_str(&format_duration(duration));
    }
    if group.count > 1 {
        let _ = write!(text, ", {} times", group.count);
    }
    if group.lasts_to_end {
        text.push_str(", until the end of the capture");
    }
    if let Some(next) = &group.next_step {
        text.push_str("; ");
        text.push_str(next);
    }
    text
}

/// A duration: `312 ms`, `6.6 s`.
pub(crate) fn format_duration(nanoseconds: i64) -> String {
    let milliseconds = nanoseconds.max(0) / 1_000_000;
    if milliseconds < 1_000 {
        return format!("{milliseconds} ms");
    }
    let tenths = (milliseconds + 50) / 100;
    format!("{}.{} s", tenths / 10, tenths % 10)
}

/// A duration as [`format_duration`], rounded: intervals are measured a few microseconds off.
pub(crate) fn format_interval(nanoseconds: i64) -> String {
    format_duration(nanoseconds.saturating_add(500_000))
}

/// `1.300 s {12-13}`.
pub fn format_moment(at: Occurrence, zero: Option<Timestamp>) -> String {
    let frames = at.frames;
    let frames = match (frames.first, frames.last) {
        (_, 0) => String::new(),
        (first, last) if first == last => format!("{{{last}}}"),
        (first, last) => format!("{{{first}-{last}}}"),
    };
    match at.time.zip(zero) {
        Some((time, zero)) => format!("{} {frames}", format_time(time.since(zero))),
        None => frames,
    }
}

/// Lines below a finding: time, worst occurrence, reason for a lowered severity, section of the manual.
pub fn finding_notes(group: &FindingGroup, zero: Option<Timestamp>) -> Vec<String> {
    notes_of(group, |at| format_moment(at, zero))
}

/// `at 1.300 s {12}`, `first 1.300 s {12}, last 9.100 s {500}`; `moment` writes an occurrence.
pub(crate) fn period_phrase(group: &FindingGroup, moment: impl Fn(Occurrence) -> String) -> String {
    let (began, ended) = (moment(group.first_occurrence()), moment(group.last_occurrence()));
    if group.count == 1 { format!("at {began}") } else { format!("first {began}, last {ended}") }
}

/// Like [`finding_notes`], with another form of moments.
pub(crate) fn notes_of(group: &FindingGroup, moment: impl Fn(Occurrence) -> String) -> Vec<String> {
    let mut notes = vec![period_phrase(group, &moment)];
    if let Some((_, text, at)) = &group.worst {
        notes.push(format!("worst {}: {text}", moment(*at)));
    }
    if let Some(reason) = &group.downgraded {
        notes.push(format!("severity lowered: {reason}"));
    }
    if let Some(FindingCause::Fact(fact)) = &group.cause {
        notes.push(format!("cause: {}", fact_text(fact)));
    }
    notes.extend(group.manual.as_ref().map(|manual| format!("manual: {manual}")));
    notes
}
