//! Stories, findings and codes that only one capture has, or that one has more often.

use std::collections::{BTreeMap, BTreeSet};

use super::alignment::BusPair;
use super::difference::{
    CaptureComparison, ComparedSide, DifferenceKind, DifferenceSection, Observation, SubjectNoun,
};
use super::finish::bus_place;
use super::ranking::load_ranking;
use super::record::{CaptureRecord, CodeRecord, FindingRecord, NodeBehaviour, RecordedCode, StoryRecord};
use super::scope::ComparisonScope;
use crate::finding::Severity;
use crate::frame::BusIndex;
use crate::wire::NodeId;

const SECTION: DifferenceSection = DifferenceSection::Faults;

/// Maximum number of rules in the note of a story.
const SHOWN_RULES: usize = 4;

/// Compares stories, findings and codes.
pub(super) fn compare_faults(scope: &ComparisonScope<'_>, out: &mut CaptureComparison) {
    compare_findings(scope, out);
    for bus in &scope.alignment.buses {
        for pair in &bus.nodes {
            compare_codes(bus, (pair.good, pair.bad), scope, out);
        }
    }
}

/// Key of a finding of the first capture that is the same defect as one of the second capture.
fn key_in_good<'a>(
    scope: &ComparisonScope<'_>,
    finding: &'a FindingRecord,
) -> Option<(&'a str, usize, Option<NodeId>, &'a str)> {
    let (bus, node) = finding.place;
    let pair = pair_of(scope, ComparedSide::Bad, bus)?;
    let node = node.map(|node| pair.good_of(node).unwrap_or(node));
    Some((&finding.rule, pair.places.0, node, &finding.about))
}

fn finding_key(finding: &FindingRecord) -> (&str, usize, Option<NodeId>, &str) {
    (&finding.rule, bus_place(finding.place.0), finding.place.1, &finding.about)
}

fn pair_of<'a, 'b>(
    scope: &'b ComparisonScope<'a>,
    side: ComparedSide,
    bus: BusIndex,
) -> Option<&'b BusPair<'a>> {
    scope.alignment.buses.iter().find(|pair| {
        let place = if side == ComparedSide::Good { pair.places.0 } else { pair.places.1 };
        place == bus_place(bus)
    })
}

fn compare_findings(scope: &ComparisonScope<'_>, out: &mut CaptureComparison) {
    let known: BTreeMap<_, _> = scope.good.findings.iter().map(|good| (finding_key(good), good)).collect();
    let mut found = BTreeSet::new();
    let mut new = BTreeSet::new();
    for bad in &scope.bad.findings {
        let good = key_in_good(scope, bad).and_then(|key| known.get(&key)).copied();
        found.extend(good.map(|good| good.id));
        match good {
            None => {
                new.insert(bad.id);
            }
            Some(good) if scope.counts_differ(good.at.count, bad.at.count) && is_more(scope, good, bad) => {
                let value = |it: &FindingRecord| Some(Observation::new(it.at.count.to_string(), it.at.first));
                let place = place_of(scope, ComparedSide::Bad, bad.place);
                out.add_difference(
                    (SECTION, DifferenceKind::FindingRate),
                    (place, &*bad.rule),
                    (value(good), value(bad)),
                    &*bad.text,
                );
            }
            Some(_) => out.add_equal(SECTION, SubjectNoun::Finding),
        }
    }
    let ids = scope.good.findings.iter().map(|good| good.id);
    let ended = ids.filter(|id| !found.contains(id)).collect();
    one_sided(scope, ComparedSide::Bad, &new, out);
    out.new_findings = new;
    one_sided(scope, ComparedSide::Good, &ended, out);
}

/// A condition that lasts is one occurrence in a short capture and many in a long one.
fn is_more(scope: &ComparisonScope<'_>, good: &FindingRecord, bad: &FindingRecord) -> bool {
    let (one, other) = scope.seconds();
    let is_short = one.min(other) * 2.0 < one.max(other);
    !is_short || good.at.count.abs_diff(bad.at.count) > 2
}

/// Findings of one capture only: by story, most important first.
fn one_sided(
    scope: &ComparisonScope<'_>,
    side: ComparedSide,
    ids: &BTreeSet<u64>,
    out: &mut CaptureComparison,
) {
    let record = if side == ComparedSide::Bad { scope.bad } else { scope.good };
    let find = |id: &u64| record.findings.iter().find(|it| it.id == *id);
    let mut shown = BTreeSet::new();
    for story in &record.stories {
        let own: Vec<_> = story.findings.iter().filter(|id| ids.contains(id)).filter_map(find).collect();
        let is_root = story.findings.iter().find_map(find).is_some_and(|root| ids.contains(&root.id));
        if !is_root {
            continue;
        }
        shown.extend(own.iter().map(|it| it.id));
        if let Some(root) = own.first() {
            add_story(scope, side, story, (root, &own), out);
        }
    }
    for id in ids.iter().filter(|id| !shown.contains(*id)) {
        let Some(it) = find(id).filter(|it| !it.is_member) else { continue };
        let place = place_of(scope, side, it.place);
        let value = Some(Observation::new(&*it.text, it.at.first));
        match missing_opportunity(scope, side, it) {
            Some(reason) if side == ComparedSide::Good || !reason.counts => {
                let text = format!("{} [{}]", it.text, it.rule);
                out.add_not_seen(
                    (SECTION, SubjectNoun::Finding),
                    other_side(side),
                    (place, text),
                    it.at.first,
                );
                if side == ComparedSide::Bad {
                    out.raise_not_seen(load_ranking().difference_weight(DifferenceKind::Finding.name()));
                }
            }
            reason => {
                let (kind, values) = match side {
                    ComparedSide::Bad => (DifferenceKind::Finding, (None, value)),
                    ComparedSide::Good => (DifferenceKind::FindingEnded, (value, None)),
                };
                out.add_difference(
                    (SECTION, kind),
                    (place, &*it.rule),
                    values,
                    reason.map_or("", |reason| reason.text),
                );
            }
        }
    }
}

const fn other_side(side: ComparedSide) -> ComparedSide {
    match side {
        ComparedSide::Good => ComparedSide::Bad,
        ComparedSide::Bad => ComparedSide::Good,
    }
}

/// Reason why the absence of a finding in the other capture shows nothing.
#[derive(Clone, Copy)]
struct NoOpportunity {
    text: &'static str,
    /// The finding counts as a difference although the other capture could not show it.
    counts: bool,
}

/// `None` if the other capture could have shown the finding.
fn missing_opportunity(
    scope: &ComparisonScope<'_>,
    side: ComparedSide,
    finding: &FindingRecord,
) -> Option<NoOpportunity> {
    let record: &CaptureRecord = if side == ComparedSide::Bad { scope.good } else { scope.bad };
    let reason = |text, counts| Some(NoOpportunity { text, counts });
    if load_ranking().needs_error_frames(&finding.rule) && record.error_frames == 0 {
        return reason("no error frames in the other capture", false);
    }
    if record.timing_rules.contains(&finding.rule) && !record.is_timed {
        return reason("no timestamps in the other capture", false);
    }
    let is_exercised = record.exercised.contains(&finding.rule);
    (!is_exercised).then_some(NoOpportunity { text: "rule not exercised in GOOD", counts: true })
}

fn add_story(
    scope: &ComparisonScope<'_>,
    side: ComparedSide,
    story: &StoryRecord,
    (root, all): (&FindingRecord, &[&FindingRecord]),
    out: &mut CaptureComparison,
) {
    let place = place_of(scope, side, story.place);
    let reason = missing_opportunity(scope, side, root);
    if reason.is_some_and(|reason| side == ComparedSide::Good || !reason.counts) {
        let text = format!("{} [{}]", story.title, root.rule);
        out.add_not_seen((SECTION, SubjectNoun::Finding), other_side(side), (place, text), story.mark);
        if side == ComparedSide::Bad {
            out.raise_not_seen(load_ranking().story_weight(story.rank, story.is_cause_visible));
        }
        return;
    }
    let mut rules: Vec<&str> = all.iter().skip(1).filter(|it| !it.is_member).map(|it| &*it.rule).collect();
    rules.dedup();
    let more = rules.len().saturating_sub(SHOWN_RULES);
    rules.truncate(SHOWN_RULES);
    let mut notes = Vec::new();
    if !rules.is_empty() {
        let more = if more > 0 { format!(" and {more} more") } else { String::new() };
        notes.push(format!("then {}{more}", rules.join(", ")));
    }
    notes.extend(reason.map(|reason| reason.text.to_owned()));
    let value = Some(Observation::new(&*story.title, story.mark));
    let (kind, values) = match side {
        ComparedSide::Bad => (DifferenceKind::Finding, (None, value)),
        ComparedSide::Good => (DifferenceKind::StoryEnded, (value, None)),
    };
    out.add_difference((SECTION, kind), (place, &*root.rule), values, notes.join("; "));
    if let (ComparedSide::Bad, Some(added)) = (side, out.differences.last_mut()) {
        added.weight = load_ranking()
            .story_weight(story.rank, story.is_cause_visible && root.severity >= Severity::Warning);
    }
}

/// Label of a node, or name of the bus if there are several.
fn place_of(
    scope: &ComparisonScope<'_>,
    side: ComparedSide,
    (bus, node): (BusIndex, Option<NodeId>),
) -> String {
    let Some(pair) = pair_of(scope, side, bus) else { return String::new() };
    let Some(node) = node else { return pair.prefix.trim_end().to_owned() };
    let records = if side == ComparedSide::Good { &pair.good.nodes } else { &pair.bad.nodes };
    records.iter().find(|it| it.id == node).map_or_else(|| node.label(), |node| pair.node_label(node))
}

fn compare_codes(
    bus: &BusPair<'_>,
    (good, bad): (&NodeBehaviour, &NodeBehaviour),
    scope: &ComparisonScope<'_>,
    out: &mut CaptureComparison,
) {
    let label = bus.node_label(good);
    let value =
        |it: &CodeRecord| Some(Observation::new(crate::words::count_noun(it.at.count, "time"), it.at.first));
    let none = CodeRecord::default();
    let mut all: Vec<_> = good.codes.keys().chain(bad.codes.keys()).copied().collect();
    all.sort_unstable();
    all.dedup();
    for code in all {
        let (one, other) = (good.codes.get(&code).unwrap_or(&none), bad.codes.get(&code).unwrap_or(&none));
        let text = if one.text.is_empty() { &other.text } else { &one.text };
        let (name, kind) = describe_code(code, text);
        if !scope.counts_differ(one.at.count, other.at.count) {
            out.add_equal(SECTION, SubjectNoun::Code);
            continue;
        }
        let is_ended = other.at.count == 0;
        if !is_ended && one.at.count == 0 && is_reported(code, bad, scope) {
            continue;
        }
        let was_present = if is_ended { bad.is_present } else { good.is_present };
        if !was_present {
            let (by, mark) = if is_ended {
                (ComparedSide::Bad, one.at.first)
            } else {
                (ComparedSide::Good, other.at.first)
            };
            out.add_not_seen((SECTION, SubjectNoun::Code), by, (&label, name), mark);
            continue;
        }
        let values = match (one.at.count, other.at.count) {
            (0, _) => (None, value(other)),
            (_, 0) => (value(one), None),
            _ => (value(one), value(other)),
        };
        out.add_difference(
            (SECTION, if is_ended { DifferenceKind::CodeEnded } else { kind }),
            (&label, name),
            values,
            "",
        );
    }
}

/// Whether a finding of the second capture reports this code.
fn is_reported(code: RecordedCode, node: &NodeBehaviour, scope: &ComparisonScope<'_>) -> bool {
    let about = match code {
        RecordedCode::Emcy(code) => format!("{code:04X}"),
        RecordedCode::Dtc(spn, fmi) => format!("{spn}/{fmi}"),
        RecordedCode::Abort(..) | RecordedCode::NoResponse(_) | RecordedCode::Uds(_) => return false,
    };
    scope.bad.findings.iter().any(|it| it.place.1 == Some(node.id) && it.about == about)
}

fn describe_code(code: RecordedCode, text: &str) -> (String, DifferenceKind) {
    let object = |object: Option<crate::wire::canopen::ObjectAddress>| {
        object.map_or(String::new(), |object| format!(" of {object}"))
    };
    match code {
        RecordedCode::Emcy(code) => (format!("EMCY {code:04X} {text}"), DifferenceKind::Emcy),
        RecordedCode::Dtc(spn, fmi) => (format!("SPN {spn} FMI {fmi} {text}"), DifferenceKind::TroubleCode),
        RecordedCode::Abort(code, address) => {
            (format!("SDO abort {code:08X}{} {text}", object(address)), DifferenceKind::Abort)
        }
        RecordedCode::NoResponse(address) => {
            (format!("SDO{} no response", object(address)), DifferenceKind::NoResponse)
        }
        RecordedCode::Uds(code) => {
            (format!("UDS response code {code:02X} {text}"), DifferenceKind::UdsResponse)
        }
    }
}
