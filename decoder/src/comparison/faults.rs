//! Stories, findings and codes that only one capture has, or that one has more often.

use std::collections::{BTreeMap, BTreeSet};

use super::alignment::BusPair;
use super::difference::{Comparison, Kind, Observation, Section, Side, SubjectNoun};
use super::finish::bus_place;
use super::ranking::ranking;
use super::record::{CaptureRecord, Code, CodeRecord, FindingRecord, NodeRecord, StoryRecord};
use super::scope::Scope;
use crate::finding::Severity;
use crate::frame::BusIndex;
use crate::wire::NodeId;

const SECTION: Section = Section::Faults;

/// Maximum number of rules in the note of a story.
const SHOWN_RULES: usize = 4;

/// Compares stories, findings and codes.
pub(super) fn compare(scope: &Scope<'_>, out: &mut Comparison) {
    findings(scope, out);
    for bus in &scope.alignment.buses {
        for pair in &bus.nodes {
            codes(bus, (pair.good, pair.bad), scope, out);
        }
    }
}

/// Key of a finding of the first capture that is the same defect as one of the second capture.
fn key_in_good<'a>(
    scope: &Scope<'_>,
    finding: &'a FindingRecord,
) -> Option<(&'a str, usize, Option<NodeId>, &'a str)> {
    let (bus, node) = finding.place;
    let pair = pair_of(scope, Side::Bad, bus)?;
    let node = node.map(|node| pair.good_of(node).unwrap_or(node));
    Some((&finding.rule, pair.places.0, node, &finding.about))
}

fn key(finding: &FindingRecord) -> (&str, usize, Option<NodeId>, &str) {
    (&finding.rule, bus_place(finding.place.0), finding.place.1, &finding.about)
}

fn pair_of<'a, 'b>(scope: &'b Scope<'a>, side: Side, bus: BusIndex) -> Option<&'b BusPair<'a>> {
    scope.alignment.buses.iter().find(|pair| {
        let place = if side == Side::Good { pair.places.0 } else { pair.places.1 };
        place == bus_place(bus)
    })
}

fn findings(scope: &Scope<'_>, out: &mut Comparison) {
    let known: BTreeMap<_, _> = scope.good.findings.iter().map(|good| (key(good), good)).collect();
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
                let place = place_of(scope, Side::Bad, bad.place);
                out.add(
                    (SECTION, Kind::FindingRate),
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
    one_sided(scope, Side::Bad, &new, out);
    out.new_findings = new;
    one_sided(scope, Side::Good, &ended, out);
}

/// A condition that lasts is one occurrence in a short capture and many in a long one.
fn is_more(scope: &Scope<'_>, good: &FindingRecord, bad: &FindingRecord) -> bool {
    let (one, other) = scope.seconds();
    let is_short = one.min(other) * 2.0 < one.max(other);
    !is_short || good.at.count.abs_diff(bad.at.count) > 2
}

/// Findings of one capture only: by story, most important first.
fn one_sided(scope: &Scope<'_>, side: Side, ids: &BTreeSet<u64>, out: &mut Comparison) {
    let record = if side == Side::Bad { scope.bad } else { scope.good };
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
        match opportunity(scope, side, it) {
            Some(reason) if side == Side::Good || !reason.counts => {
                let text = format!("{} [{}]", it.text, it.rule);
                out.add_not_seen((SECTION, SubjectNoun::Finding), other(side), (place, text), it.at.first);
                if side == Side::Bad {
                    out.raise_not_seen(ranking().weight(Kind::Finding.name()));
                }
            }
            reason => {
                let (kind, values) = match side {
                    Side::Bad => (Kind::Finding, (None, value)),
                    Side::Good => (Kind::FindingEnded, (value, None)),
                };
                out.add((SECTION, kind), (place, &*it.rule), values, reason.map_or("", |reason| reason.text));
            }
        }
    }
}

const fn other(side: Side) -> Side {
    match side {
        Side::Good => Side::Bad,
        Side::Bad => Side::Good,
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
fn opportunity(scope: &Scope<'_>, side: Side, finding: &FindingRecord) -> Option<NoOpportunity> {
    let record: &CaptureRecord = if side == Side::Bad { scope.good } else { scope.bad };
    let reason = |text, counts| Some(NoOpportunity { text, counts });
    if ranking().needs_error_frames(&finding.rule) && record.error_frames == 0 {
        return reason("no error frames in the other capture", false);
    }
    if record.timing_rules.contains(&finding.rule) && !record.is_timed {
        return reason("no timestamps in the other capture", false);
    }
    let is_exercised = record.exercised.contains(&finding.rule);
    (!is_exercised).then_some(NoOpportunity { text: "rule not exercised in GOOD", counts: true })
}

fn add_story(
    scope: &Scope<'_>,
    side: Side,
    story: &StoryRecord,
    (root, all): (&FindingRecord, &[&FindingRecord]),
    out: &mut Comparison,
) {
    let place = place_of(scope, side, story.place);
    let reason = opportunity(scope, side, root);
    if reason.is_some_and(|reason| side == Side::Good || !reason.counts) {
        let text = format!("{} [{}]", story.title, root.rule);
        out.add_not_seen((SECTION, SubjectNoun::Finding), other(side), (place, text), story.mark);
        if side == Side::Bad {
            out.raise_not_seen(ranking().story(story.rank, story.is_cause_visible));
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
        Side::Bad => (Kind::Finding, (None, value)),
        Side::Good => (Kind::StoryEnded, (value, None)),
    };
    out.add((SECTION, kind), (place, &*root.rule), values, notes.join("; "));
    if let (Side::Bad, Some(added)) = (side, out.differences.last_mut()) {
        added.weight =
            ranking().story(story.rank, story.is_cause_visible && root.severity >= Severity::Warning);
    }
}

/// Label of a node, or name of the bus if there are several.
fn place_of(scope: &Scope<'_>, side: Side, (bus, node): (BusIndex, Option<NodeId>)) -> String {
    let Some(pair) = pair_of(scope, side, bus) else { return String::new() };
    let Some(node) = node else { return pair.prefix.trim_end().to_owned() };
    let records = if side == Side::Good { &pair.good.nodes } else { &pair.bad.nodes };
    records.iter().find(|it| it.id == node).map_or_else(|| node.label(), |node| pair.label(node))
}

fn codes(
    bus: &BusPair<'_>,
    (good, bad): (&NodeRecord, &NodeRecord),
    scope: &Scope<'_>,
    out: &mut Comparison,
) {
    let label = bus.label(good);
    let value =
        |it: &CodeRecord| Some(Observation::new(crate::words::plural(it.at.count, "time"), it.at.first));
    let none = CodeRecord::default();
    let mut all: Vec<_> = good.codes.keys().chain(bad.codes.keys()).copied().collect();
    all.sort_unstable();
    all.dedup();
    for code in all {
        let (one, other) = (good.codes.get(&code).unwrap_or(&none), bad.codes.get(&code).unwrap_or(&none));
        let text = if one.text.is_empty() { &other.text } else { &one.text };
        let (name, kind) = describe(code, text);
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
            let (by, mark) = if is_ended { (Side::Bad, one.at.first) } else { (Side::Good, other.at.first) };
            out.add_not_seen((SECTION, SubjectNoun::Code), by, (&label, name), mark);
            continue;
        }
        let values = match (one.at.count, other.at.count) {
            (0, _) => (None, value(other)),
            (_, 0) => (value(one), None),
            _ => (value(one), value(other)),
        };
        out.add((SECTION, if is_ended { Kind::CodeEnded } else { kind }), (&label, name), values, "");
    }
}

/// Whether a finding of the second capture reports this code.
fn is_reported(code: Code, node: &NodeRecord, scope: &Scope<'_>) -> bool {
    let about = match code {
        Code::Emcy(code) => format!("{code:04X}"),
        Code::Dtc(spn, fmi) => format!("{spn}/{fmi}"),
        Code::Abort(..) | Code::NoResponse(_) | Code::Uds(_) => return false,
    };
    scope.bad.findings.iter().any(|it| it.place.1 == Some(node.id) && it.about == about)
}

fn describe(code: Code, text: &str) -> (String, Kind) {
    let object = |object: Option<crate::wire::canopen::ObjectAddress>| {
        object.map_or(String::new(), |object| format!(" of {object}"))
    };
    match code {
        Code::Emcy(code) => (format!("EMCY {code:04X} {text}"), Kind::Emcy),
        Code::Dtc(spn, fmi) => (format!("SPN {spn} FMI {fmi} {text}"), Kind::TroubleCode),
        Code::Abort(code, address) => {
            (format!("SDO abort {code:08X}{} {text}", object(address)), Kind::Abort)
        }
        Code::NoResponse(address) => (format!("SDO{} no response", object(address)), Kind::NoResponse),
        Code::Uds(code) => (format!("UDS response code {code:02X} {text}"), Kind::UdsResponse),
    }
}
