//! The record of a capture, from the notes of the recorder and the state of the buses at the end.

use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;

use super::objects::{is_parameter, object_table};
use super::record::{
    BusRecord, CaptureRecord, EvidenceMark, FindingRecord, MappingRecord, MessageRecord, MessageRole,
    NodeBehaviour, Occurrences, ParameterRecord, PointRecord, StoryRecord,
};
use super::recorder::{BehaviourRecorder, NodeNotes};
use crate::diagnosis::Diagnosis;
use crate::finding::{CaptureFindings, FindingGroup, Occurrence, RuleOutcome};
use crate::frame::{BusIndex, CanId, Timestamp};
use crate::profile::PdoName;
use crate::session::{Bus, Buses, Node, StoredObject};
use crate::statistics::{BusStatistics, IdentifierRow};
use crate::wire::NodeId;
use crate::wire::canopen::ObjectAddress;

/// Everything that exists only at the end of a capture.
#[derive(Debug, Clone, Copy)]
pub struct CaptureEnding<'a> {
    /// Name of the capture.
    pub name: &'a str,
    /// Buses after the last frame.
    pub buses: Buses<'a>,
    /// Findings to compare.
    pub findings: &'a CaptureFindings,
    /// Their stories.
    pub diagnosis: &'a Diagnosis,
}

impl BehaviourRecorder {
    /// The record, after the last event and the last finding.
    pub fn finish_record(self, ending: &CaptureEnding<'_>) -> CaptureRecord {
        let quality = &self.statistics.quality;
        let mut record = CaptureRecord {
            name: ending.name.to_owned(),
            duration: quality.duration(),
            frames: quality.frames,
            error_frames: quality.error_frames,
            is_timed: quality.is_timed(),
            granularity: quality.granularity().unwrap_or(1),
            ..CaptureRecord::default()
        };
        let end = EvidenceMark {
            frame: quality.frames,
            time: quality.last.zip(self.first).map(|(last, first)| last.saturating_sub(first.0)),
        };
        record.end = end;
        let empty = BusStatistics::default();
        for (place, bus) in ending.buses.iter().enumerate() {
            let statistics = self.statistics.buses.get(place).unwrap_or(&empty);
            record.buses.push(bus_record(&self, bus, statistics, end));
        }
        let times = RecordTimes { first: self.first };
        record.stories = story_records(ending, times);
        record.findings =
            ending.findings.reported_groups().map(|group| finding_record(ending, group, times)).collect();
        record_judged_rules(ending.findings, &mut record);
        record.sequence = self.sequence;
        record
    }
}

/// Zero of the times of a record.
#[derive(Clone, Copy)]
struct RecordTimes {
    first: Option<Timestamp>,
}

impl RecordTimes {
    fn mark_occurrence(self, at: Occurrence) -> EvidenceMark {
        self.mark_frame(at.frames.last, at.time)
    }

    fn mark_frame(self, frame: u64, time: Option<Timestamp>) -> EvidenceMark {
        EvidenceMark { frame, time: time.zip(self.first).map(|(time, first)| time.since(first)) }
    }

    fn relative_time(self, time: i64) -> Option<i64> {
        self.first.map(|first| time.saturating_sub(first.0))
    }
}

fn story_records(ending: &CaptureEnding<'_>, times: RecordTimes) -> Vec<StoryRecord> {
    let of = |story: &crate::diagnosis::Story| StoryRecord {
        place: (story.bus, story.node),
        title: story.title.clone(),
        is_cause_visible: story.is_cause_visible,
        rank: story.rank(),
        mark: times.mark_occurrence(story.began),
        findings: story.findings.clone(),
    };
    ending.diagnosis.stories.iter().map(of).collect()
}

fn finding_record(ending: &CaptureEnding<'_>, group: &FindingGroup, times: RecordTimes) -> FindingRecord {
    let is_member =
        group.member_of.and_then(|id| ending.findings.group_by_id(id)).is_some_and(FindingGroup::is_reported);
    FindingRecord {
        id: group.id,
        rule: Arc::clone(&group.rule),
        place: (group.key.bus, group.key.node),
        about: group.key.about.to_string(),
        severity: group.severity,
        text: group.text.clone(),
        at: Occurrences { count: group.count, first: times.mark_occurrence(group.first_occurrence()) },
        is_member,
    }
}

/// Rules with a verdict, and rules that need timestamps.
fn record_judged_rules(findings: &CaptureFindings, record: &mut CaptureRecord) {
    for (rule, tally) in findings.rules.iter().zip(&findings.tallies) {
        if tally.verdict() != RuleOutcome::NotExercised {
            record.exercised.insert(Arc::clone(&rule.name));
        }
        if rule.is_timing {
            record.timing_rules.insert(Arc::clone(&rule.name));
        }
    }
}

fn bus_record(
    recorder: &BehaviourRecorder,
    bus: &Bus,
    statistics: &BusStatistics,
    end: EvidenceMark,
) -> BusRecord {
    let times = RecordTimes { first: recorder.first };
    let rows =
        || recorder.identifiers.rows().iter().zip(&recorder.gaps).filter(|(row, _)| row.bus == bus.index());
    let messages = rows().map(|(row, gaps)| MessageRecord {
        role: message_role(row, bus),
        id: row.id,
        is_remote: row.is_remote,
        meaning: bus.describe_id(row.id),
        count: row.count,
        gaps: gaps.clone(),
        longest_at: row.intervals.longest().and_then(|(_, began)| times.relative_time(began)),
        silent_since: silence_start(recorder, row).and_then(|since| times.relative_time(since)),
        last: times.mark_frame(row.last_frame, row.last_time),
    });
    let default = NodeNotes::default();
    let present = bus.nodes().filter(|node| !bus.protocols().is_withdrawn(Some(node.id())));
    let nodes = present.map(|node| {
        let own = recorder.nodes.get(&(bus.index(), node.id())).unwrap_or(&default);
        let mappings = mapping_records(rows().map(|(row, _)| row), node, times);
        let parts = NodeParts { notes: own, mappings, end };
        node_record(node, statistics, parts, times, recorder)
    });
    let mut nodes: Vec<_> = nodes.collect();
    nodes.sort_by_key(|node| node.id);
    BusRecord {
        name: bus.name().to_owned(),
        bit_rate: bus.bit_rate(),
        frames: statistics.load.frames,
        bits: statistics.load.bits,
        nodes,
        messages: messages.collect(),
    }
}

/// Start of a silence until the end of the capture.
fn silence_start(recorder: &BehaviourRecorder, row: &IdentifierRow) -> Option<i64> {
    row.intervals.silent_since(recorder.statistics.quality.last)
}

fn message_role(row: &IdentifierRow, bus: &Bus) -> MessageRole {
    const SERVICES: [u16; 4] = [0x080, 0x580, 0x600, 0x700];
    if let (Some(node), Some(pdo)) = (row.node, row.pdo) {
        return MessageRole::Pdo(node, pdo);
    }
    if let CanId::Standard(id) = row.id
        && let Ok(number) = u8::try_from(id & 0x7F)
        && SERVICES.contains(&(id & 0x780))
        && bus.node(number).is_some()
    {
        return MessageRole::Service(id & 0x780, NodeId::Canopen(number));
    }
    MessageRole::Id(row.id)
}

/// Objects of each PDO of a node, from the last layout on its identifier.
fn mapping_records<'a>(
    rows: impl Iterator<Item = &'a IdentifierRow>,
    node: &Node,
    times: RecordTimes,
) -> BTreeMap<PdoName, MappingRecord> {
    let mut all = BTreeMap::new();
    for row in rows.filter(|row| row.node == Some(node.id())) {
        let (Some(pdo), Some(layout)) = (row.pdo, &row.layout) else { continue };
        let index = pdo.mapping_index();
        let written = node.store().sorted().into_iter().filter(|(object, _)| object.index == index);
        let last = written.map(|(_, entry)| entry.origin).max_by_key(|origin| origin.frame);
        let mark = last.map_or_else(
            || times.mark_frame(row.last_frame, row.last_time),
            |origin| times.mark_frame(origin.frame, origin.time),
        );
        let objects = layout.fields.iter().map(|field| match field.id.to_string() {
            id if id.is_empty() => field.name().unwrap_or("?").to_owned(),
            id => id,
        });
        all.insert(pdo, MappingRecord { objects: objects.collect(), is_assumed: layout.assumed, mark });
    }
    all
}

struct NodeParts<'a> {
    notes: &'a NodeNotes,
    mappings: BTreeMap<PdoName, MappingRecord>,
    end: EvidenceMark,
}

fn node_record(
    node: &Node,
    statistics: &BusStatistics,
    parts: NodeParts<'_>,
    times: RecordTimes,
    recorder: &BehaviourRecorder,
) -> NodeBehaviour {
    let NodeParts { notes, mappings, end } = parts;
    let own = statistics.node(node.id());
    let mut machines = notes.machines.clone();
    for machine in machines.values_mut() {
        machine.leave_state(end);
    }
    let last = recorder.statistics.quality.last;
    let silent = own.and_then(|own| own.heartbeat.silent_since(last));
    NodeBehaviour {
        name: node.name().map(str::to_owned),
        device: node.device_id().map(str::to_owned),
        kind: device_kind(node),
        identity: identity_values(node, times),
        parameters: parameter_records(node, (notes, &mappings), times),
        mappings,
        boots: notes.boots,
        losses: notes.losses,
        silent_since: silent.and_then(|since| times.relative_time(since)),
        was_operational: notes.was_operational || node.j1939_name().is_some(),
        is_present: own.is_some_and(crate::statistics::NodeStatistics::is_present),
        codes: notes.codes.clone(),
        transfers: own.map(|own| own.sdo_duration.clone()).unwrap_or_default(),
        exchanges: notes.exchanges.clone(),
        reactions: own.map(|own| own.reactions.pairs().to_vec()).unwrap_or_default(),
        machines,
        points: point_records(notes),
        ..NodeBehaviour::new(node.id())
    }
}

/// Set points, with the deviations at the end of the capture.
fn point_records(notes: &NodeNotes) -> BTreeMap<(ObjectAddress, Option<u8>), PointRecord> {
    let mut all = notes.points.clone();
    for (object, deviation) in notes.following.settled_deviations() {
        if let Some((_, point)) = all.iter_mut().find(|((own, _), _)| *own == object) {
            point.add_deviation(deviation);
        }
    }
    all
}

/// Vendor and product of CiA 301; manufacturer and function of a J1939 NAME.
fn device_kind(node: &Node) -> Option<(u64, u64)> {
    if let Some(name) = node.j1939_name() {
        let fields = name.fields();
        let function = u64::from(fields.function) << 8 | u64::from(fields.device_class);
        return Some((u64::from(fields.manufacturer_code), function));
    }
    let seen = |sub| {
        let object = ObjectAddress::new(0x1018, sub);
        node.store().seen_value(object).and_then(|_| node.store().number(object))
    };
    Some((seen(1)?, seen(2)?))
}

fn identity_values(node: &Node, times: RecordTimes) -> BTreeMap<&'static str, (String, EvidenceMark)> {
    let mut all = BTreeMap::new();
    for (object, name) in &object_table().identity {
        let Some(entry) = node.store().seen_value(*object) else { continue };
        let mark = times.mark_frame(entry.origin.frame, entry.origin.time);
        all.insert(name.as_str(), (shown_value(node, *object, entry), mark));
    }
    if let Some(name) = node.j1939_name() {
        let fields = name.fields();
        let mut add = |name, value: u32| all.insert(name, (value.to_string(), EvidenceMark::default()));
        add("manufacturer", u32::from(fields.manufacturer_code));
        add("function", u32::from(fields.function));
        add("device class", u32::from(fields.device_class));
        add("ECU instance", u32::from(fields.ecu_instance));
    }
    all
}

fn shown_value(node: &Node, object: ObjectAddress, entry: &StoredObject) -> String {
    let value = node.meaning(object).map(|meaning| meaning.format_value(&meaning.decode(&entry.value)));
    value.unwrap_or_else(|| {
        let bytes = entry.value.get(..16).unwrap_or(&entry.value);
        crate::profile::DecodedValue::Bytes(bytes.to_vec()).to_string()
    })
}

/// Parameters of a node; objects in a PDO are process data.
fn parameter_records(
    node: &Node,
    (notes, mappings): (&NodeNotes, &BTreeMap<PdoName, MappingRecord>),
    times: RecordTimes,
) -> BTreeMap<ObjectAddress, ParameterRecord> {
    let mut all = BTreeMap::new();
    let mapped: BTreeSet<&str> = mappings.values().flat_map(|pdo| &pdo.objects).map(String::as_str).collect();
    for (object, entry) in node.store().sorted() {
        let meaning = node.meaning(object);
        let is_mapped = mapped.contains(object.to_string().as_str());
        if is_mapped || !is_parameter(node, object, entry, meaning.as_ref()) {
            continue;
        }
        let name = meaning.map(|meaning| meaning.name).unwrap_or_default();
        let parameter = ParameterRecord {
            name,
            text: shown_value(node, object, entry),
            data: entry.value.clone(),
            origin: entry.origin.kind.origin_text(),
            is_stale: entry.stale,
            mark: times.mark_frame(entry.origin.frame, entry.origin.time),
            written: notes.written.get(&object).cloned(),
        };
        all.insert(object, parameter);
    }
    all
}

/// Place of a bus in a record.
pub(super) const fn bus_place(bus: BusIndex) -> usize {
    bus.0 as usize
}
