//! Claims: stories with node, time and sources.

use super::clock::format_date;
use super::model::{ClaimLine, ReportClaim, RuleSource};
use crate::diagnosis::Story;
use crate::figures::format_time;
use crate::finding::{CaptureFindings, FindingGroup};
use crate::frame::{BusIndex, Timestamp};
use crate::session::{AssignedBy, Bus, Buses, Node};
use crate::statistics::format_span;
use crate::wire::NodeId;

/// Maximum number of claims on a page; further stories are listed by title.
pub const SHOWN_CLAIMS: usize = 3;

/// Maximum number of sources listed with a claim.
const SHOWN_SOURCES: usize = 3;

/// The claim of a story, without evidence.
pub(super) fn build_claim(
    (number, story): (usize, &Story),
    lines: Vec<ClaimLine>,
    findings: &CaptureFindings,
    (buses, zero): (Buses<'_>, Option<Timestamp>),
) -> ReportClaim {
    let mut sources = Vec::new();
    for RuleSource { source, .. } in sources_of(story, findings) {
        if !sources.contains(&source) && sources.len() < SHOWN_SOURCES {
            sources.push(source);
        }
    }
    ReportClaim {
        number,
        severity: story.severity,
        title: story.title.clone(),
        who: node_title(buses, story.bus, story.node),
        when: story_period(story, zero),
        lines,
        sources,
        evidence: Vec::new(),
        omitted: 0,
        context: Vec::new(),
        plots: Vec::new(),
        values: Vec::new(),
    }
}

/// `node 32/20 boom (PVEA, danfoss-pve-ci), bus can0`.
pub(super) fn node_title(buses: Buses<'_>, index: BusIndex, id: Option<NodeId>) -> String {
    let bus = buses.iter().find(|bus| bus.index() == index);
    let on = bus.map_or_else(String::new, |bus| format!("bus {}", bus.name()));
    match (id, bus) {
        (Some(id), Some(bus)) => format!("{}, {on}", describe_node(bus, id)),
        (Some(id), None) => id.sentence_label(),
        (None, _) => on,
    }
}

/// `node 32/20 boom (PVEA, danfoss-pve-ci)`.
pub(super) fn describe_node(bus: &Bus, id: NodeId) -> String {
    let node = bus.node_table().present_or_former(id);
    let mut text = id.sentence_label();
    if let Some(now) = node.map(Node::id).filter(|now| *now != id) {
        text = format!("{text}, later {}", now.label());
    }
    if let Some(name) = node.and_then(Node::name) {
        text.push(' ');
        text.push_str(name);
    }
    if let Some((title, device)) = node.and_then(|node| node.device_title().zip(node.device_id())) {
        text = format!("{text} ({title}, {device})");
    }
    text
}

/// Source of the profile of a node.
pub(super) const fn assigned_by(by: AssignedBy) -> &'static str {
    match by {
        AssignedBy::Option => "assigned on the command line",
        AssignedBy::BusFile => "assigned in the bus file",
        AssignedBy::DeviceFile => "assigned by a device file",
        AssignedBy::Identity => "identified by the node itself",
        AssignedBy::DeviceType => "derived from the device type alone",
    }
}

/// `7.204 s after the first frame, 2023-11-14 22:13:27.204 UTC; until 10.430 s`.
fn story_period(story: &Story, zero: Option<Timestamp>) -> String {
    let Some((began, zero)) = story.began.time.zip(zero) else {
        return match story.began.frames.first {
            0 => "unknown: the capture has no timestamps".to_owned(),
            frame => format!("frame {frame}; the capture has no timestamps"),
        };
    };
    let mut text = format!("{} after the first frame", format_time(began.since(zero)));
    if began.has_date() {
        text.push_str(", ");
        text.push_str(&format_date(began));
    }
    match story.ended.time.map(|ended| (ended, ended.since(began))) {
        _ if story.lasts => text.push_str("; present at the end of the capture"),
        Some((ended, lasted)) if lasted > 0 => {
            text = format!(
                "{text}; last seen {} ({} later)",
                format_time(ended.since(zero)),
                format_span(lasted)
            );
        }
        _ => {}
    }
    text
}

/// Groups of a story, cause first.
pub(super) fn story_groups<'a>(
    story: &'a Story,
    findings: &'a CaptureFindings,
) -> impl Iterator<Item = &'a FindingGroup> {
    story.findings.iter().filter_map(|id| findings.groups.iter().find(|group| group.id == *id))
}

/// Sources of the rules of a story, without duplicates.
pub(super) fn sources_of(story: &Story, findings: &CaptureFindings) -> Vec<RuleSource> {
    let mut all: Vec<RuleSource> = Vec::new();
    for group in story_groups(story, findings) {
        let Some(rule) = findings.rules.get(usize::from(group.key.rule)) else { continue };
        let source = group.manual.clone().or_else(|| rule.cited_source()).unwrap_or_default();
        let own = RuleSource {
            rule: rule.name.to_string(),
            title: rule.title.to_string(),
            // Paragraphs of a rule have line breaks.
            source: source.split_whitespace().collect::<Vec<_>>().join(" "),
        };
        if !source.is_empty() && !all.contains(&own) {
            all.push(own);
        }
    }
    all
}
