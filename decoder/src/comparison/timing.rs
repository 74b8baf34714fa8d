//! Periods, gaps and jitter of identifiers; latencies and reaction times of nodes.

use std::collections::BTreeMap;

use super::alignment::{BusPair, NodePair};
use super::difference::{Comparison, Kind, Observation, Section, Side, SubjectNoun};
use super::record::{Mark, MessageRecord, MessageRole};
use super::scope::Scope;
use super::times::{duration, seconds};
use super::tolerance::differ;
use crate::frame::CanId;
use crate::statistics::Distribution;

const SECTION: Section = Section::Timing;

/// Minimum number of intervals for a period, and of exchanges for a latency.
const ENOUGH: u64 = 10;

/// Longest intervals of a message after which it is missing.
const MISSING: i64 = 3;

/// Compares all identifiers and exchanges.
pub(super) fn compare(scope: &Scope<'_>, out: &mut Comparison) {
    for (record, side) in [(scope.good, "GOOD"), (scope.bad, "BAD")] {
        if !record.is_timed {
            out.limits.push((SECTION, format!("{side} without usable timestamps: timing not compared")));
        }
    }
    for bus in &scope.alignment.buses {
        messages(bus, scope, out);
        for pair in bus.nodes.iter().filter(|_| scope.is_timed()) {
            latencies(pair, scope, out);
        }
    }
}

/// The role of a message of the second capture in terms of the first one.
fn role_in_good(bus: &BusPair<'_>, role: MessageRole) -> MessageRole {
    match role {
        MessageRole::Pdo(node, pdo) => MessageRole::Pdo(bus.good_of(node).unwrap_or(node), pdo),
        MessageRole::Service(code, node) => MessageRole::Service(code, bus.good_of(node).unwrap_or(node)),
        MessageRole::Id(_) => role,
    }
}

fn messages(bus: &BusPair<'_>, scope: &Scope<'_>, out: &mut Comparison) {
    let key = |role, it: &MessageRecord| (role, it.is_remote);
    let good = bus.good.messages.iter().filter(|it| !is_on_request(it.role));
    let good: BTreeMap<_, _> = good.map(|it| (key(it.role, it), it)).collect();
    let bad = bus.bad.messages.iter().filter(|it| !is_on_request(it.role));
    let bad = bad.map(|it| (key(role_in_good(bus, it.role), it), it));
    let bad: BTreeMap<_, _> = bad.collect();
    for (key, good) in &good {
        match bad.get(key) {
            Some(bad) => message(bus, (good, bad), scope, out),
            None => lone(bus, good, Side::Bad, scope, out),
        }
    }
    for (_, bad) in bad.iter().filter(|(key, _)| !good.contains_key(key)) {
        lone(bus, bad, Side::Good, scope, out);
    }
}

/// Whether messages follow a request of a client or of the master: their intervals are those of the requests.
fn is_on_request(role: MessageRole) -> bool {
    match role {
        MessageRole::Service(code, _) => matches!(code, 0x580 | 0x600),
        MessageRole::Id(id) => id == CanId::standard(0),
        MessageRole::Pdo(..) => false,
    }
}

/// Label of a message in output.
pub(super) fn subject(bus: &BusPair<'_>, message: &MessageRecord) -> String {
    let remote = if message.is_remote { " R" } else { "" };
    let meaning = if message.meaning.is_empty() { String::new() } else { format!(" {}", message.meaning) };
    format!("{}{}{remote}{meaning}", bus.prefix, message.id)
}

/// Whether the intervals of a message have a period: nine of ten are between a half and twice the median.
fn is_periodic(gaps: &Distribution) -> bool {
    let part = |part| gaps.percentile(part).unwrap_or(0);
    let median = part(50);
    gaps.count() >= ENOUGH && part(90) <= median.saturating_mul(2) && part(10) >= median / 2
}

/// A message of one capture only. Its absence is a difference if it is periodic, and if the other capture lasts for
/// [`MISSING`] of its intervals and its node is operational there.
fn lone(bus: &BusPair<'_>, message: &MessageRecord, by: Side, scope: &Scope<'_>, out: &mut Comparison) {
    let name = subject(bus, message);
    let period = message.gaps.percentile(50).filter(|_| is_periodic(&message.gaps));
    let node = match message.role {
        MessageRole::Pdo(node, _) | MessageRole::Service(_, node) => Some(node),
        MessageRole::Id(_) => None,
    };
    let had_opportunity = node.is_none_or(|node| {
        let pair = bus.nodes.iter().find(|pair| match by {
            Side::Bad => pair.good.id == node,
            Side::Good => pair.bad.id == node,
        });
        pair.is_some_and(|pair| match by {
            Side::Bad => pair.bad.was_operational,
            Side::Good => pair.good.was_operational,
        })
    });
    let other = if by == Side::Bad { scope.bad } else { scope.good };
    let lasts = other.duration >= Some(message.gaps.longest().saturating_mul(MISSING));
    let had_opportunity = had_opportunity && lasts;
    let Some(period) = period.filter(|_| had_opportunity && scope.is_timed() && !message.is_remote) else {
        return out.add_not_seen((SECTION, SubjectNoun::Identifier), by, (name, ""), message.last);
    };
    let mark = Mark { time: None, ..message.last };
    let value = Some(Observation::new(format!("every {}", duration(period)), mark));
    match by {
        Side::Bad => out.add((SECTION, Kind::MessageMissing), (name, "period"), (value, None), ""),
        Side::Good => out.add((SECTION, Kind::NewMessage), (name, "period"), (None, value), ""),
    }
}

fn message(
    bus: &BusPair<'_>,
    (good, bad): (&MessageRecord, &MessageRecord),
    scope: &Scope<'_>,
    out: &mut Comparison,
) {
    if !scope.is_timed() {
        return out.add_not_seen(
            (SECTION, SubjectNoun::Period),
            lacking_times(scope),
            (subject(bus, good), ""),
            good.last,
        );
    }
    let noun =
        if matches!(good.role, MessageRole::Pdo(..)) { SubjectNoun::PdoPeriod } else { SubjectNoun::Period };
    if !is_periodic(&good.gaps) || bad.gaps.count() < ENOUGH {
        return;
    }
    let name = subject(bus, good);
    let median = |it: &MessageRecord| it.gaps.percentile(50).unwrap_or(0);
    let floor = scope.time_floor();
    if let (None, Some(since)) = (good.silent_since, bad.silent_since) {
        let values = (
            Some(Observation::new(format!("every {}", duration(median(good))), good.last)),
            Some(Observation::new(format!("none since {}", seconds(since)), Mark { time: None, ..bad.last })),
        );
        out.add((SECTION, Kind::MessageSilent), (&name, ""), values, "");
    }
    let limits = scope.tolerances;
    if differ(median(good), median(bad), limits.period, scope.granularity()) {
        let value = |it: &MessageRecord| Some(Observation::new(duration(median(it)), Mark::default()));
        return out.add((SECTION, Kind::Period), (name, "period"), (value(good), value(bad)), "");
    }
    if is_longest_apart((good, bad), limits.longest_gap, floor) {
        let value = |it: &MessageRecord| {
            let at = it.longest_at.map_or(String::new(), |at| format!(" at {}", seconds(at)));
            Some(Observation::new(format!("{}{at}", duration(it.gaps.longest())), Mark::default()))
        };
        return out.add((SECTION, Kind::LongestGap), (name, "gap max"), (value(good), value(bad)), "");
    }
    let tail = |it: &MessageRecord| it.gaps.percentile(99).unwrap_or(0);
    // Below 100 intervals the 99th percentile is the longest one.
    let has_tail = good.gaps.count() >= 100 && bad.gaps.count() >= 100;
    if has_tail && differ(tail(good), tail(bad), limits.gap, floor) {
        let value = |it: &MessageRecord| Some(Observation::new(duration(tail(it)), Mark::default()));
        return out.add((SECTION, Kind::Jitter), (name, "gap 99 %"), (value(good), value(bad)), "");
    }
    out.add_equal(SECTION, noun);
}

/// Whether the longest intervals differ. A longer one must exceed twice the period, because captures of different lengths
/// show different extremes.
fn is_longest_apart((good, bad): (&MessageRecord, &MessageRecord), percent: f64, floor: i64) -> bool {
    let longest = good.gaps.longest().max(bad.gaps.longest());
    let median = good.gaps.percentile(50).unwrap_or(0);
    longest > median.saturating_mul(2) && differ(good.gaps.longest(), bad.gaps.longest(), percent, floor)
}

fn lacking_times(scope: &Scope<'_>) -> Side {
    if scope.good.is_timed { Side::Bad } else { Side::Good }
}

fn latencies(pair: &NodePair<'_>, scope: &Scope<'_>, out: &mut Comparison) {
    let (good, bad) = (pair.good, pair.bad);
    let exchanges = [
        ("SDO transfer", Kind::Latency, &good.transfers, &bad.transfers),
        ("UDS latency", Kind::Latency, &good.exchanges, &bad.exchanges),
    ];
    for (aspect, kind, one, other) in exchanges {
        latency(pair, (aspect.to_owned(), kind), (one, other), scope, out);
    }
    for one in &good.reactions {
        let other = bad.reactions.iter().find(|other| (other.tpdo, other.rpdo) == (one.tpdo, one.rpdo));
        let Some(other) = other else { continue };
        let aspect = format!("reaction {} → {}", one.tpdo, one.rpdo);
        latency(pair, (aspect, Kind::Reaction), (&one.times, &other.times), scope, out);
    }
}

fn latency(
    pair: &NodePair<'_>,
    (aspect, kind): (String, Kind),
    (good, bad): (&Distribution, &Distribution),
    scope: &Scope<'_>,
    out: &mut Comparison,
) {
    if good.count() < ENOUGH || bad.count() < ENOUGH {
        return;
    }
    let floor = scope.time_floor();
    for (part, name) in [(50, "median"), (99, "99 %")] {
        let value = |it: &Distribution| it.percentile(part).unwrap_or(0);
        let has_tail = part == 50 || good.count().min(bad.count()) >= 100;
        if has_tail && differ(value(good), value(bad), scope.tolerances.latency, floor) {
            let text = |it| Some(Observation::new(duration(value(it)), Mark::default()));
            let place = (pair.label.as_str(), format!("{aspect} {name}"));
            return out.add((SECTION, kind), place, (text(good), text(bad)), "");
        }
    }
    out.add_equal(SECTION, SubjectNoun::ResponseTime);
}
