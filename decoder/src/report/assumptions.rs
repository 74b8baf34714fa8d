//! Assumptions that the claims rest on.

use super::claims::{assigned_by, describe_node, node_title, story_groups};
use super::model::{EvidenceFrame, ReportClaim};
use crate::diagnosis::Story;
use crate::finding::CaptureFindings;
use crate::session::{AssignedBy, Bus, Buses};

/// Stories of the report, and what they rest on.
pub(super) struct ReportBasis<'a> {
    pub(super) stories: &'a [&'a Story],
    pub(super) findings: &'a CaptureFindings,
    pub(super) buses: Buses<'a>,
    /// The protocol of the first story is not confirmed.
    pub(super) is_presumed: bool,
}

/// Assumptions about protocol, devices and severities.
pub(super) fn of_capture(basis: &ReportBasis<'_>) -> Vec<String> {
    let mut all: Vec<String> = Vec::new();
    let mut add = |text: String| {
        if !all.contains(&text) {
            all.push(text);
        }
    };
    for (place, story) in basis.stories.iter().enumerate() {
        if place == 0 && basis.is_presumed {
            add(format!(
                "protocol of {}?: not confirmed by the traffic",
                node_title(basis.buses, story.bus, None)
            ));
        }
        let bus = basis.buses.iter().find(|bus| bus.index() == story.bus);
        let nodes = story.nodes.iter().filter(|(index, _)| *index == story.bus).map(|(_, id)| *id);
        for id in nodes.chain(story.node) {
            bus.and_then(|bus| assigned_profile(bus, id)).into_iter().for_each(&mut add);
        }
        for group in story_groups(story, basis.findings) {
            if let Some(reason) = &group.downgraded {
                add(format!("severity of {} lowered: {reason}", group.rule));
            }
        }
    }
    all
}

/// A profile that the node did not confirm.
fn assigned_profile(bus: &Bus, id: crate::wire::NodeId) -> Option<String> {
    let by = bus.node(id)?.assigned_by().filter(|by| *by != AssignedBy::Identity).map(assigned_by)?;
    let node = describe_node(bus, id);
    Some(format!("profile of {node}?: {by}; the capture does not prove that the node is this device"))
}

/// Marks `?` in the story, the frames and the object values of a claim.
pub(super) fn of_claim(claim: &ReportClaim) -> Vec<String> {
    let number = claim.number;
    let mut all = Vec::new();
    for line in claim.lines.iter().filter(|line| is_marked(&line.text)) {
        all.push(format!("claim {number}, story: {}", line.text));
    }
    let mut meanings: Vec<(&str, Vec<u64>)> = Vec::new();
    for (frame, text) in claim.evidence.iter().flat_map(|it| marked_words(it).map(|text| (it.number, text))) {
        match meanings.iter_mut().find(|(known, _)| *known == text) {
            Some((_, frames)) => frames.push(frame),
            None => meanings.push((text, vec![frame])),
        }
    }
    for (text, frames) in meanings {
        let frames: Vec<_> = frames.iter().map(ToString::to_string).collect();
        all.push(format!("claim {number}, {{{}}}: {text}", frames.join(" ")));
    }
    for rows in claim.values.iter().map(|values| &values.rows) {
        let stale: Vec<_> = rows.iter().filter(|row| row.is_stale).map(|row| row.object.as_str()).collect();
        if !stale.is_empty() {
            all.push(format!(
                "claim {number}, values that may have changed since they were seen: {}",
                stale.join(", ")
            ));
        }
        for row in rows.iter().filter(|row| row.frame == 0 && row.is_subject) {
            all.push(format!(
                "claim {number}, object {} {} = {}: {}, not seen on the bus",
                row.object, row.name, row.value, row.origin
            ));
        }
    }
    for curve in claim.plots.iter().flat_map(|plot| &plot.curves).filter(|curve| curve.name.ends_with('?')) {
        all.push(format!(
            "claim {number}, plot: {} in {}: scale or mapping assumed",
            curve.name, curve.source
        ));
    }
    all
}

/// Meanings of a frame that are presumed, or contain a presumed value.
fn marked_words(frame: &EvidenceFrame) -> impl Iterator<Item = &str> {
    let is_presumed = frame.is_presumed;
    frame.meaning.iter().map(String::as_str).filter(move |text| is_presumed || is_marked(text))
}

/// Whether a text contains a value or state with the mark `?`.
fn is_marked(text: &str) -> bool {
    let mut before = ' ';
    text.chars().any(|letter| {
        let is_mark = letter == '?' && !before.is_whitespace();
        before = letter;
        is_mark
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn marks_follow_a_value() {
        assert!(is_marked("boot-up → initialising?") && is_marked("+37.5 %? effective"));
        assert!(!is_marked("? → operational") && !is_marked("no mark"));
    }
}
