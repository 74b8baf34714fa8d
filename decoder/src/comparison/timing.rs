//! Periods, gaps and jitter of identifiers; latencies and reaction times of nodes.

use std::collections::BTreeMap;

use super::alignment::{BusPair, NodePair};
use super::difference::{
    CaptureComparison, ComparedSide, DifferenceKind, DifferenceSection, Observation, SubjectNoun,
};
use super::record::{EvidenceMark, MessageRecord, MessageRole};
use super::scope::ComparisonScope;
use super::times::{format_duration, format_seconds};
use super::tolerance::exceeds_tolerance;
use crate::frame::CanId;
use crate::statistics::DurationDistribution;

const SECTION: DifferenceSection = DifferenceSection::Timing;

/// Minimum number of intervals for a period, and of exchanges for a latency.
const ENOUGH: u64 = 10;

/// Longest intervals of a message after which it is missing.
const MISSING: i64 = 3;

/// Compares all identifiers and exchanges.
pub(super) fn compare_timing(scope: &ComparisonScope<'_>, out: &mut CaptureComparison) {
    for (record, side) in [(scope.good, "GOOD"), (scope.bad, "BAD")] {
        if !record.is_timed {
            out.limits.push((SECTION, format!("{side} without usable timestamps: timing not compared")));
        }
    }
    for bus in &scope.alignment.buses {
        compare_messages(bus, scope, out);
        for pair in bus.nodes.iter().filter(|_| scope.is_timed()) {
            compare_latencies(pair, scope, out);
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

fn compare_messages(bus: &BusPair<'_>, scope: &ComparisonScope<'_>, out: &mut CaptureComparison) {
    let key = |role, it: &MessageRecord| (role, it.is_remote);
    let good = bus.good.messages.iter().filter(|it| !is_on_request(it.role));
    let good: BTreeMap<_, _> = good.map(|it| (key(it.role, it), it)).collect();
    let bad = bus.bad.messages.iter().filter(|it| !is_on_request(it.role));
    let bad = bad.map(|it| (key(role_in_good(bus, it.role), it), it));
    let bad: BTreeMap<_, _> = bad.collect();
    for (key, good) in &good {
        match bad.get(key) {
            Some(bad) => compare_message(bus, (good, bad), scope, out),
            None => report_lone_message(bus, good, ComparedSide::Bad, scope, out),
        }
    }
    for (_, bad) in bad.iter().filter(|(key, _)| !good.contains_key(key)) {
        report_lone_message(bus, bad, ComparedSide::Good, scope, out);
    }
}

/// Whether messages follow a request of a client or of the master: their intervals are those of the requests.
fn is_on_request(role: MessageRole) -> bool {
    match role {
        MessageRole::Service(code, _) => matches!(code, 0x580 | 0x600),
        MessageRole::Id(id) => id == CanId::from_standard(0),
        MessageRole::Pdo(..) => false,
    }
}

/// Label of a message in output.
pub(super) fn message_label(bus: &BusPair<'_>, message: &MessageRecord) -> String {
    let remote = if message.is_remote { " R" } else { "" };
    let meaning = if message.meaning.is_empty() { String::new() } else { format!(" {}", message.meaning) };
    format!("{}{}{remote}{meaning}", bus.prefix, message.id)
}

/// Whether the intervals of a message have a period: nine of ten are between a half and twice the median.
fn is_periodic(gaps: &DurationDistribution) -> bool {
    let part = |part| gaps.percentile(part).unwrap_or(0);
    let median = part(50);
    gaps.duration_count() >= ENOUGH && part(90) <= median.saturating_mul(2) && part(10) >= median / 2
}

/// A message of one capture only. Its absence is a difference if it is periodic, and if the other capture lasts for
/// [`MISSING`] of its intervals and its node is operational there.
fn report_lone_message(
    bus: &BusPair<'_>,
    message: &MessageRecord,
    by: ComparedSide,
    scope: &ComparisonScope<'_>,
    out: &mut CaptureComparison,
) {
    let name = message_label(bus, message);
    let period = message.gaps.percentile(50).filter(|_| is_periodic(&message.gaps));
    let node = match message.role {
        MessageRole::Pdo(node, _) | MessageRole::Service(_, node) => Some(node),
        MessageRole::Id(_) => None,
    };
    let had_opportunity = node.is_none_or(|node| {
        let pair = bus.nodes.iter().find(|pair| match by {
            ComparedSide::Bad => pair.good.id == node,
            ComparedSide::Good => pair.bad.id == node,
        });
        pair.is_some_and(|pair| match by {
            ComparedSide::Bad => pair.bad.was_operational,
            ComparedSide::Good => pair.good.was_operational,
        })
    });
    let other = if by == ComparedSide::Bad { scope.bad } else { scope.good };
    let lasts = other.duration >= Some(message.gaps.longest().saturating_mul(MISSING));
    let had_opportunity = had_opportunity && lasts;
    let Some(period) = period.filter(|_| had_opportunity && scope.is_timed() && !message.is_remote) else {
        return out.add_not_seen((SECTION, SubjectNoun::Identifier), by, (name, ""), message.last);
    };
    let mark = EvidenceMark { time: None, ..message.last };
    let value = Some(Observation::new(format!("every {}", format_duration(period)), mark));
    match by {
        ComparedSide::Bad => {
            out.add_difference(
                (SECTION, DifferenceKind::MessageMissing),
                (name, "period"),
                (value, None),
                "",
            );
        }
        ComparedSide::Good => {
            out.add_difference((SECTION, DifferenceKind::NewMessage), (name, "period"), (None, value), "");
        }
    }
}

fn compare_message(
    bus: &BusPair<'_>,
    (good, bad): (&MessageRecord, &MessageRecord),
    scope: &ComparisonScope<'_>,
    out: &mut CaptureComparison,
) {
    if !scope.is_timed() {
        return out.add_not_seen(
            (SECTION, SubjectNoun::Period),
            lacking_times(scope),
            (message_label(bus, good), ""),
            good.last,
        );
    }
    let noun =
        if matches!(good.role, MessageRole::Pdo(..)) { SubjectNoun::PdoPeriod } else { SubjectNoun::Period };
    if !is_periodic(&good.gaps) || bad.gaps.duration_count() < ENOUGH {
        return;
    }
    let name = message_label(bus, good);
    let median = |it: &MessageRecord| it.gaps.percentile(50).unwrap_or(0);
    let floor = scope.time_floor();
    if let (None, Some(since)) = (good.silent_since, bad.silent_since) {
        let values = (
            Some(Observation::new(format!("every {}", format_duration(median(good))), good.last)),
            Some(Observation::new(
                format!("none since {}", format_seconds(since)),
                EvidenceMark { time: None, ..bad.last },
            )),
        );
        out.add_difference((SECTION, DifferenceKind::MessageSilent), (&name, ""), values, "");
    }
    let limits = scope.tolerances;
    let longest = |it: &MessageRecord| {
        let at = it.longest_at.map_or(String::new(), |at| format!(" at {}", format_seconds(at)));
        format!("{}{at}", format_duration(it.gaps.longest()))
    };
    let tail = |it: &MessageRecord| it.gaps.percentile(99).unwrap_or(0);
    // Below 100 intervals the 99th percentile is the longest one.
    let has_tail = good.gaps.duration_count() >= 100 && bad.gaps.duration_count() >= 100;
    let (kind, field, texts) =
        if exceeds_tolerance(median(good), median(bad), limits.period, scope.granularity()) {
            (DifferenceKind::Period, "period", [good, bad].map(|it| format_duration(median(it))))
        } else if is_longest_apart((good, bad), limits.longest_gap, floor) {
            (DifferenceKind::LongestGap, "gap max", [good, bad].map(longest))
        } else if has_tail && exceeds_tolerance(tail(good), tail(bad), limits.gap, floor) {
            (DifferenceKind::Jitter, "gap 99 %", [good, bad].map(|it| format_duration(tail(it))))
        } else {
            return out.add_equal(SECTION, noun);
        };
    let [good, bad] = texts.map(|text| Some(Observation::new(text, EvidenceMark::default())));
    out.add_difference((SECTION, kind), (name, field), (good, bad), "");
}

/// Whether the longest intervals differ. A longer one must exceed twice the period, because captures of different lengths
/// show different extremes.
fn is_longest_apart((good, bad): (&MessageRecord, &MessageRecord), percent: f64, floor: i64) -> bool {
    let longest = good.gaps.longest().max(bad.gaps.longest());
    let median = good.gaps.percentile(50).unwrap_or(0);
    longest > median.saturating_mul(2)
        && exceeds_tolerance(good.gaps.longest(), bad.gaps.longest(), percent, floor)
}

fn lacking_times(scope: &ComparisonScope<'_>) -> ComparedSide {
    if scope.good.is_timed { ComparedSide::Bad } else { ComparedSide::Good }
}

fn compare_latencies(pair: &NodePair<'_>, scope: &ComparisonScope<'_>, out: &mut CaptureComparison) {
    let (good, bad) = (pair.good, pair.bad);
    let exchanges = [
        ("SDO transfer", DifferenceKind::Latency, &good.transfers, &bad.transfers),
        ("UDS latency", DifferenceKind::Latency, &good.exchanges, &bad.exchanges),
    ];
    for (aspect, kind, one, other) in exchanges {
        compare_latency(pair, (aspect.to_owned(), kind), (one, other), scope, out);
    }
    for one in &good.reactions {
        let other = bad.reactions.iter().find(|other| (other.tpdo, other.rpdo) == (one.tpdo, one.rpdo));
        let Some(other) = other else { continue };
        let aspect = format!("reaction {} → {}", one.tpdo, one.rpdo);
        compare_latency(pair, (aspect, DifferenceKind::Reaction), (&one.times, &other.times), scope, out);
    }
}

fn compare_latency(
    pair: &NodePair<'_>,
    (aspect, kind): (String, DifferenceKind),
    (good, bad): (&DurationDistribution, &DurationDistribution),
    scope: &ComparisonScope<'_>,
    out: &mut CaptureComparison,
) {
    if good.duration_count() < ENOUGH || bad.duration_count() < ENOUGH {
        return;
    }
    let floor = scope.time_floor();
    for (part, name) in [(50, "median"), (99, "99 %")] {
        let value = |it: &DurationDistribution| it.percentile(part).unwrap_or(0);
        let has_tail = part == 50 || good.duration_count().min(bad.duration_count()) >= 100;
        if has_tail && exceeds_tolerance(value(good), value(bad), scope.tolerances.latency, floor) {
            let text = |it| Some(Observation::new(format_duration(value(it)), EvidenceMark::default()));
            let place = (pair.label.as_str(), format!("{aspect} {name}"));
            return out.add_difference((SECTION, kind), place, (text(good), text(bad)), "");
        }
    }
    out.add_equal(SECTION, SubjectNoun::ResponseTime);
}
