//! Nodes: presence, identity, device, boot-ups, losses, heartbeat.

use super::alignment::{BusPair, NodePair};
use super::difference::{Comparison, Kind, Observation, Section, Side, SubjectNoun};
use super::record::{CaptureRecord, Mark, NodeRecord, Occurrences};
use super::scope::Scope;

const SECTION: Section = Section::Nodes;

/// Compares all nodes.
pub(super) fn compare(scope: &Scope<'_>, out: &mut Comparison) {
    machine(scope, out);
    for bus in &scope.alignment.only_good {
        out.add_not_seen((SECTION, SubjectNoun::Bus), Side::Bad, (bus.name.as_str(), ""), Mark::default());
    }
    for bus in &scope.alignment.only_bad {
        out.add_not_seen((SECTION, SubjectNoun::Bus), Side::Good, (bus.name.as_str(), ""), Mark::default());
    }
    for bus in &scope.alignment.buses {
        missing(bus, out);
        for pair in bus.nodes.iter().filter(|pair| pair.good.is_present || pair.bad.is_present) {
            identity(pair, out);
            if pair.good.is_present && pair.bad.is_present {
                lifetime(pair, scope, out);
            }
        }
    }
}

/// Reports captures of two different machines.
fn machine(scope: &Scope<'_>, out: &mut Comparison) {
    let count = |record: &CaptureRecord| {
        record.buses.iter().flat_map(|bus| &bus.nodes).filter(|node| node.is_present).count()
    };
    let pairs = || scope.alignment.buses.iter().flat_map(|bus| &bus.nodes);
    let present = pairs().filter(|pair| pair.good.is_present && pair.bad.is_present);
    let same = present.filter(|pair| !is_replaced(pair)).count();
    let (good, bad) = (count(scope.good), count(scope.bad));
    if same == 0 && good > 0 && bad > 0 {
        let value =
            |count: usize| Some(Observation::new(crate::words::plural(count, "node"), Mark::default()));
        let note = "no node in common: captures of different machines; comparable parts follow";
        out.add((SECTION, Kind::Machine), ("machine", ""), (value(good), value(bad)), note);
    }
}

/// Whether vendor or product differ.
fn is_replaced(pair: &NodePair<'_>) -> bool {
    pair.good.kind.zip(pair.bad.kind).is_some_and(|(one, other)| one != other)
}

fn missing(bus: &BusPair<'_>, out: &mut Comparison) {
    let shown = |node: &NodeRecord| {
        Some(Observation::new(node.device.clone().unwrap_or_else(|| "present".to_owned()), node.boots.first))
    };
    for node in bus.only_good.iter().filter(|node| node.is_present) {
        out.add((SECTION, Kind::NodeMissing), (bus.label(node), ""), (shown(node), None), "");
    }
    for node in bus.only_bad.iter().filter(|node| node.is_present) {
        out.add((SECTION, Kind::NewNode), (bus.label(node), ""), (None, shown(node)), "");
    }
}

fn identity(pair: &NodePair<'_>, out: &mut Comparison) {
    let NodePair { good, bad, label } = pair;
    let value = |node: &NodeRecord| Some(Observation::new("present", node.boots.first));
    match (good.is_present, bad.is_present) {
        (true, false) => out.add((SECTION, Kind::NodeMissing), (label, ""), (value(good), None), ""),
        (false, true) => out.add((SECTION, Kind::NewNode), (label, ""), (None, value(bad)), ""),
        _ => {}
    }
    if good.id != bad.id {
        let value = |node: &NodeRecord| Some(Observation::new(node.id.label(), node.boots.first));
        out.add((SECTION, Kind::NodeId), (label, "node-ID"), (value(good), value(bad)), "");
    }
    if let (Some(one), Some(other)) = (&good.device, &bad.device)
        && one != other
    {
        let value = |text: &str| Some(Observation::new(text, Mark::default()));
        out.add((SECTION, Kind::Device), (label, "device"), (value(one), value(other)), "");
    }
    for (name, (text, mark)) in &good.identity {
        match bad.identity.get(name) {
            Some((other, _)) if other == text => out.add_equal(SECTION, SubjectNoun::IdentityValue),
            Some((other, at)) => {
                let values = (Some(Observation::new(text, *mark)), Some(Observation::new(other, *at)));
                out.add((SECTION, Kind::Identity), (label, *name), values, "");
            }
            None => out.add_not_seen(
                (SECTION, SubjectNoun::IdentityValue),
                Side::Bad,
                (label, format!("{name} {text}")),
                *mark,
            ),
        }
    }
    for (name, (text, mark)) in bad.identity.iter().filter(|(name, _)| !good.identity.contains_key(*name)) {
        out.add_not_seen(
            (SECTION, SubjectNoun::IdentityValue),
            Side::Good,
            (label, format!("{name} {text}")),
            *mark,
        );
    }
}

fn lifetime(pair: &NodePair<'_>, scope: &Scope<'_>, out: &mut Comparison) {
    let NodePair { good, bad, label } = pair;
    let before = out.differences.len();
    let count = |at: Occurrences| Some(Observation::new(at.count.to_string(), at.first));
    if scope.counts_differ(good.boots.count, bad.boots.count) {
        match (good.boots.count, bad.boots.count) {
            // A capture can begin in operation: the absence of the first boot-up shows nothing.
            (1, 0) => out.add_not_seen(
                (SECTION, SubjectNoun::BootUp),
                Side::Bad,
                (label, "boot-up"),
                good.boots.first,
            ),
            (0, 1) if begins_with(bad.boots) => {
                out.add_not_seen(
                    (SECTION, SubjectNoun::BootUp),
                    Side::Good,
                    (label, "boot-up"),
                    bad.boots.first,
                );
            }
            _ => out.add(
                (SECTION, Kind::BootUps),
                (label, "boot-ups"),
                (count(good.boots), count(bad.boots)),
                "",
            ),
        }
    }
    if scope.counts_differ(good.losses.count, bad.losses.count) {
        let values = (count(good.losses), count(bad.losses));
        out.add((SECTION, Kind::Lost), (label, "lost"), values, "");
    }
    let beat = |node: &NodeRecord| match node.silent_since {
        Some(since) => {
            Some(Observation::new(format!("none since {}", super::times::seconds(since)), Mark::default()))
        }
        None => Some(Observation::new("until the end", Mark::default())),
    };
    if good.silent_since.is_some() != bad.silent_since.is_some() && scope.is_timed() {
        out.add((SECTION, Kind::HeartbeatSilent), (label, "heartbeat"), (beat(good), beat(bad)), "");
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
