//! Nodes: presence, identity, device, boot-ups, losses, heartbeat.

use super::alignment::{BusPair, NodePair};
use super::difference::{
    CaptureComparison, ComparedSide, DifferenceKind, DifferenceSection, Observation, SubjectNoun,
};
use super::record::{CaptureRecord, EvidenceMark, NodeBehaviour, Occurrences};
use super::scope::ComparisonScope;

const SECTION: DifferenceSection = DifferenceSection::Nodes;

/// Compares all nodes.
pub(super) fn compare_nodes(scope: &ComparisonScope<'_>, out: &mut CaptureComparison) {
    compare_machine(scope, out);
    for bus in &scope.alignment.only_good {
        out.add_not_seen(
            (SECTION, SubjectNoun::Bus),
            ComparedSide::Bad,
            (bus.name.as_str(), ""),
            EvidenceMark::default(),
        );
    }
    for bus in &scope.alignment.only_bad {
        out.add_not_seen(
            (SECTION, SubjectNoun::Bus),
            ComparedSide::Good,
            (bus.name.as_str(), ""),
            EvidenceMark::default(),
        );
    }
    for bus in &scope.alignment.buses {
        report_missing(bus, out);
        for pair in bus.nodes.iter().filter(|pair| pair.good.is_present || pair.bad.is_present) {
            compare_identity(pair, out);
            if pair.good.is_present && pair.bad.is_present {
                compare_lifetime(pair, scope, out);
            }
        }
    }
}

/// Reports captures of two different machines.
fn compare_machine(scope: &ComparisonScope<'_>, out: &mut CaptureComparison) {
    let count = |record: &CaptureRecord| {
        record.buses.iter().flat_map(|bus| &bus.nodes).filter(|node| node.is_present).count()
    };
    let pairs = || scope.alignment.buses.iter().flat_map(|bus| &bus.nodes);
    let present = pairs().filter(|pair| pair.good.is_present && pair.bad.is_present);
    let same = present.filter(|pair| !is_replaced(pair)).count();
    let (good, bad) = (count(scope.good), count(scope.bad));
    if same == 0 && good > 0 && bad > 0 {
        let value = |count: usize| {
            Some(Observation::new(crate::words::count_noun(count, "node"), EvidenceMark::default()))
        };
        let note = "no node in common: captures of different machines; comparable parts follow";
        out.add_difference(
            (SECTION, DifferenceKind::Machine),
            ("machine", ""),
            (value(good), value(bad)),
            note,
        );
    }
}

/// Whether vendor or product differ.
fn is_replaced(pair: &NodePair<'_>) -> bool {
    pair.good.kind.zip(pair.bad.kind).is_some_and(|(one, other)| one != other)
}

fn report_missing(bus: &BusPair<'_>, out: &mut CaptureComparison) {
    let shown = |node: &NodeBehaviour| {
        Some(Observation::new(node.device.clone().unwrap_or_else(|| "present".to_owned()), node.boots.first))
    };
    for node in bus.only_good.iter().filter(|node| node.is_present) {
        out.add_difference(
            (SECTION, DifferenceKind::NodeMissing),
            (bus.node_label(node), ""),
            (shown(node), None),
            "",
        );
    }
    for node in bus.only_bad.iter().filter(|node| node.is_present) {
        out.add_difference(
            (SECTION, DifferenceKind::NewNode),
            (bus.node_label(node), ""),
            (None, shown(node)),
            "",
        );
    }
}

fn compare_identity(pair: &NodePair<'_>, out: &mut CaptureComparison) {
    let NodePair { good, bad, label } = pair;
    let value = |node: &NodeBehaviour| Some(Observation::new("present", node.boots.first));
    match (good.is_present, bad.is_present) {
        (true, false) => {
            out.add_difference((SECTION, DifferenceKind::NodeMissing), (label, ""), (value(good), None), "");
        }
        (false, true) => {
            out.add_difference((SECTION, DifferenceKind::NewNode), (label, ""), (None, value(bad)), "");
        }
        _ => {}
    }
    if good.id != bad.id {
        let value = |node: &NodeBehaviour| Some(Observation::new(node.id.label(), node.boots.first));
        out.add_difference(
            (SECTION, DifferenceKind::NodeId),
            (label, "node-ID"),
            (value(good), value(bad)),
            "",
        );
    }
    if let (Some(one), Some(other)) = (&good.device, &bad.device)
        && one != other
    {
        let value = |text: &str| Some(Observation::new(text, EvidenceMark::default()));
        out.add_difference(
            (SECTION, DifferenceKind::Device),
            (label, "device"),
            (value(one), value(other)),
            "",
        );
    }
    for (name, (text, mark)) in &good.identity {
        match bad.identity.get(name) {
            Some((other, _)) if other == text => out.add_equal(SECTION, SubjectNoun::IdentityValue),
            Some((other, at)) => {
                let values = (Some(Observation::new(text, *mark)), Some(Observation::new(other, *at)));
                out.add_difference((SECTION, DifferenceKind::Identity), (label, *name), values, "");
            }
            None => out.add_not_seen(
                (SECTION, SubjectNoun::IdentityValue),
                ComparedSide::Bad,
                (label, format!("{name} {text}")),
                *mark,
            ),
        }
    }
    for (name, (text, mark)) in bad.identity.iter().filter(|(name, _)| !good.identity.contains_key(*name)) {
        out.add_not_seen(
            (SECTION, SubjectNoun::IdentityValue),
            ComparedSide::Good,
            (label, format!("{name} {text}")),
            *mark,
        );
    }
}

fn compare_lifetime(pair: &NodePair<'_>, scope: &ComparisonScope<'_>, out: &mut CaptureComparison) {
    let NodePair { good, bad, label } = pair;
    let before = out.differences.len();
    let count = |at: Occurrences| Some(Observation::new(at.count.to_string(), at.first));
    if scope.counts_differ(good.boots.count, bad.boots.count) {
        match (good.boots.count, bad.boots.count) {
            // A capture can begin in operation: the absence of the first boot-up shows nothing.
            (1, 0) => out.add_not_seen(
                (SECTION, SubjectNoun::BootUp),
                ComparedSide::Bad,
                (label, "boot-up"),
                good.boots.first,
            ),
            (0, 1) if begins_with(bad.boots) => {
                out.add_not_seen(
                    (SECTION, SubjectNoun::BootUp),
                    ComparedSide::Good,
                    (label, "boot-up"),
                    bad.boots.first,
                );
            }
            _ => out.add_difference(
                (SECTION, DifferenceKind::BootUps),
                (label, "boot-ups"),
                (count(good.boots), count(bad.boots)),
                "",
            ),
        }
    }
    if scope.counts_differ(good.losses.count, bad.losses.count) {
        let values = (count(good.losses), count(bad.losses));
        out.add_difference((SECTION, DifferenceKind::Lost), (label, "lost"), values, "");
    }
    let beat = |node: &NodeBehaviour| match node.silent_since {
        Some(since) => Some(Observation::new(
            format!("none since {}", super::times::format_seconds(since)),
            EvidenceMark::default(),
        )),
        None => Some(Observation::new("until the end", EvidenceMark::default())),
    };
    if good.silent_since.is_some() != bad.silent_since.is_some() && scope.is_timed() {
        out.add_difference(
            (SECTION, DifferenceKind::HeartbeatSilent),
            (label, "heartbeat"),
            (beat(good), beat(bad)),
            "",
        );
    }
    if before == out.differences.len() {
        out.add_equal(SECTION, SubjectNoun::Node);
    }
}

/// Whether the first boot-up is within the first second of the capture.
fn begins_with(boots: Occurrences) -> bool {
    const BEGINNING: i64 = 1_000_000_000;
    boots.first.time.is_none_or(|time| time < BEGINNING)
}
