//! Collects the record of a capture from its frames and events.

use std::collections::BTreeMap;

use super::following::SetPointFollowing;
use super::record::{
    CodeRecord, EventSequence, EvidenceMark, MOST_STEPS, MOST_SUBJECTS, Occurrences, PointRecord,
    RecordedCode, SequenceStep, StateRecord, WrittenValue,
};
use super::steps::{SHOWN_BYTES, step_text, written_text};
use crate::event::{
    DtcAction, EffectiveState, EmcyAction, Event, EventKind, SdoDirection, SdoOutcome, SdoTransfer, SetPoint,
};
use crate::frame::{BusIndex, Frame, Timestamp};
use crate::profile;
use crate::query::Filter;
use crate::session::{Bus, MessagePreview};
use crate::statistics::{DurationDistribution, IdentifierRows, Statistics};
use crate::wire::NodeId;
use crate::wire::canopen::{NmtState, ObjectAddress};

/// Number of identifiers per bus of which measured values are compared with set points.
const MOST_FOLLOWED: usize = 4_096;

/// State machine of NMT.
pub(super) const NMT: &str = "NMT";

/// Collects frames and events of one capture; [`BehaviourRecorder::finish_record`] returns its record.
#[derive(Debug, Default)]
pub struct BehaviourRecorder {
    pub(crate) statistics: Statistics,
    pub(super) identifiers: IdentifierRows,
    /// Intervals by identifier, in the order of the rows of `identifiers`.
    pub(super) gaps: Vec<DurationDistribution>,
    /// Row of the frame whose events follow.
    place: Option<usize>,
    pub(super) first: Option<Timestamp>,
    pub(super) nodes: BTreeMap<(BusIndex, NodeId), NodeNotes>,
    filter: Option<Filter>,
    pub(super) sequence: Option<EventSequence>,
    /// Identifiers with measured values of a set point, by bus and index of the identifier.
    followed: Vec<Vec<bool>>,
    /// Node of the event that starts the sequence.
    subject: Option<(BusIndex, Option<NodeId>)>,
}

/// Notes on one node during decoding.
#[derive(Debug, Default)]
pub(super) struct NodeNotes {
    pub(super) boots: Occurrences,
    pub(super) losses: Occurrences,
    pub(super) was_operational: bool,
    pub(super) codes: BTreeMap<RecordedCode, CodeRecord>,
    pub(super) exchanges: DurationDistribution,
    pub(super) machines: BTreeMap<String, StateRecord>,
    pub(super) points: BTreeMap<(ObjectAddress, Option<u8>), PointRecord>,
    pub(super) written: BTreeMap<ObjectAddress, WrittenValue>,
    pub(super) following: SetPointFollowing,
}

impl BehaviourRecorder {
    /// No frame yet. With a filter, the steps from the first event on that matches are collected.
    pub fn new(at_event: Option<Filter>) -> Self {
        let sequence = at_event.is_some().then(EventSequence::default);
        Self { filter: at_event, sequence, ..Self::default() }
    }

    /// Sets the zero of all times: the first frame of the capture, also if only a part of it is compared.
    pub fn set_zero(&mut self, first: Option<Timestamp>) {
        self.first = first;
    }

    /// Counts a frame; call it before the events of the frame.
    pub fn count_frame(&mut self, frame: &Frame) {
        self.first = self.first.or(frame.time);
        self.statistics.count_frame(frame);
        self.place = self.identifiers.count_frame(frame);
        let Some(place) = self.place else { return };
        if self.gaps.len() <= place {
            self.gaps.resize_with(place + 1, DurationDistribution::default);
        }
        let gap = self.identifiers.rows().get(place).and_then(|row| row.last_gap);
        if let (Some(gaps), Some(gap)) = (self.gaps.get_mut(place), gap.filter(|gap| *gap >= 0)) {
            gaps.add_duration(gap);
        }
    }

    pub(super) fn mark_frame(&self, frame: u64, time: Option<Timestamp>) -> EvidenceMark {
        EvidenceMark { frame, time: time.zip(self.first).map(|(time, first)| time.since(first)) }
    }

    fn note_event(&mut self, event: &Event, bus: &Bus) {
        let Some(node) = event.node else { return };
        let mark = self.mark_frame(event.frames.last, event.time);
        let notes = self.nodes.entry((event.bus, node)).or_default();
        match &event.kind {
            EventKind::BootUp { .. } => notes.boots.add_mark(mark),
            EventKind::NodeLost(_) => notes.losses.add_mark(mark),
            EventKind::NmtState(change) => {
                notes.was_operational |= change.to == NmtState::Operational;
                notes.enter_state(NMT, change.to.name(), false, mark);
            }
            EventKind::Heartbeat { state: Some(state), .. } => {
                notes.was_operational |= *state == NmtState::Operational;
            }
            EventKind::DeviceState(state) => {
                let channel = state.channel.map_or(String::new(), |channel| format!(" c{channel}"));
                notes.enter_state(&format!("{}{channel}", state.machine), &state.to, state.fault, mark);
            }
            EventKind::Mode(mode) => {
                let channel = mode.channel.map_or(String::new(), |channel| format!(" c{channel}"));
                notes.enter_state(&format!("{} {}{channel}", mode.object, mode.name), &mode.to, false, mark);
            }
            EventKind::SetPoint(point) => notes.set_point(point, mark),
            EventKind::Pdo(pdo) => {
                let is_followed = mark.time.is_some_and(|time| notes.following.on_measured(pdo, time));
                if is_followed {
                    self.add_followed(event.bus, bus.identifiers().identifier_of_event(pdo.cob_id));
                }
            }
            EventKind::SdoTransfer(transfer) => notes.note_transfer(transfer, mark),
            EventKind::UdsExchange(exchange) => {
                if let Some(latency) = exchange.latency {
                    notes.exchanges.add_duration(latency);
                }
                if let Some(nrc) = exchange.nrc {
                    let text = profile::uds_names().code_entry(nrc).map_or("", |code| code.name.as_str());
                    notes.note_code(RecordedCode::Uds(nrc), text, mark);
                }
            }
            _ => notes.note_fault(event, node, bus, mark),
        }
    }

    fn add_followed(&mut self, bus: BusIndex, identifier: Option<usize>) {
        let (bus, Some(identifier)) = (usize::from(bus.0), identifier) else { return };
        if self.followed.len() <= bus {
            self.followed.resize_with(bus + 1, Vec::new);
        }
        let Some(of_bus) = self.followed.get_mut(bus).filter(|_| identifier < MOST_FOLLOWED) else { return };
        if of_bus.len() <= identifier {
            of_bus.resize(identifier + 1, false);
        }
        if let Some(is_followed) = of_bus.get_mut(identifier) {
            *is_followed = true;
        }
    }

    /// Adds a step, from the first event on that matches the filter.
    fn follow_sequence(&mut self, event: &Event, bus: &Bus) {
        let (Some(filter), Some(sequence)) = (&self.filter, &self.sequence) else { return };
        if sequence.steps.len() >= MOST_STEPS {
            return;
        }
        let mark = self.mark_frame(event.frames.first, event.time);
        if sequence.start.is_none() && !filter.matches_event(event, bus, None) {
            return;
        }
        let Some(sequence) = &mut self.sequence else { return };
        if sequence.start.is_none() {
            sequence.start = Some(mark);
            self.subject = Some((event.bus, event.node));
        }
        let is_meant = match (self.subject, event.node) {
            (Some((bus, Some(node))), Some(own)) => (event.bus, own) == (bus, node),
            (Some((bus, _)), _) => event.bus == bus,
            (None, _) => false,
        };
        if let Some(text) = step_text(event).filter(|_| is_meant) {
            sequence.steps.push(SequenceStep { place: (event.bus, event.node), text, mark });
        }
    }
}

impl BehaviourRecorder {
    /// Takes an event of the capture.
    pub fn event(&mut self, event: &Event, bus: &Bus) {
        self.statistics.count_event(event);
        if let Some(place) = self.place {
            self.identifiers.update_row(place, event);
        }
        self.note_event(event, bus);
        self.follow_sequence(event, bus);
    }

    /// Whether the event of a frame is needed: a set point is compared with its value.
    pub fn needs(&self, preview: &MessagePreview, bus: &Bus) -> bool {
        let of_bus = self.followed.get(usize::from(bus.index().0));
        of_bus.and_then(|of_bus| of_bus.get(preview.identifier)).copied().unwrap_or(false)
    }

    /// Counts a frame whose event is not needed.
    pub fn skip(&mut self, preview: &MessagePreview, bus: &Bus) {
        self.statistics.skip_event(preview, bus);
    }
}

impl Occurrences {
    pub(super) fn add_mark(&mut self, mark: EvidenceMark) {
        if self.count == 0 {
            self.first = mark;
        }
        self.count = self.count.saturating_add(1);
    }
}

impl NodeNotes {
    /// Enters a state of a machine.
    fn enter_state(&mut self, machine: &str, state: &str, is_fault: bool, mark: EvidenceMark) {
        let has_room = self.machines.len() < MOST_SUBJECTS;
        if !has_room && !self.machines.contains_key(machine) {
            return;
        }
        let record = self.machines.entry(machine.to_owned()).or_default();
        record.leave_state(mark);
        let fits = record.states.len() < MOST_SUBJECTS;
        if fits || record.states.contains_key(state) {
            let time = record.states.entry(state.to_owned()).or_default();
            time.is_fault |= is_fault;
            // A confirmation of the state is not an entry.
            if record.last != state {
                time.at.add_mark(mark);
            }
        }
        if record.last != state {
            state.clone_into(&mut record.last);
        }
        record.since = mark;
    }

    fn note_code(&mut self, code: RecordedCode, text: &str, mark: EvidenceMark) {
        let has_room = self.codes.len() < MOST_SUBJECTS;
        if !has_room && !self.codes.contains_key(&code) {
            return;
        }
        let record = self.codes.entry(code).or_default();
        if record.text.is_empty() {
            text.clone_into(&mut record.text);
        }
        record.at.add_mark(mark);
    }

    fn note_fault(&mut self, event: &Event, node: NodeId, bus: &Bus, mark: EvidenceMark) {
        let device = bus.node(node).map_or(profile::plain_device(), |node| node.device());
        match &event.kind {
            EventKind::Emcy(emergency) if emergency.action == EmcyAction::Raised => {
                if let Some(code) = emergency.code {
                    self.note_code(RecordedCode::Emcy(code), device.error_text(code), mark);
                }
            }
            EventKind::Dtc(dtc) if dtc.action == DtcAction::Raised => {
                let own = device.trouble_code_entry(dtc.spn, dtc.fmi).map(|own| own.text.as_str());
                let text = own.unwrap_or_else(|| profile::failure_modes().code_text(u32::from(dtc.fmi)));
                self.note_code(RecordedCode::Dtc(dtc.spn, dtc.fmi), text, mark);
            }
            _ => {}
        }
    }

    fn note_transfer(&mut self, transfer: &SdoTransfer, mark: EvidenceMark) {
        if let Some(abort) = transfer.abort {
            let text = profile::abort_codes().code_text(abort.code);
            self.note_code(RecordedCode::Abort(abort.code, transfer.object), text, mark);
        } else if transfer.outcome == SdoOutcome::Timeout {
            self.note_code(RecordedCode::NoResponse(transfer.object), "no response", mark);
        }
        let is_written =
            transfer.direction == Some(SdoDirection::Download) && transfer.outcome == SdoOutcome::Complete;
        let Some(object) = transfer.object.filter(|_| is_written) else { return };
        let data = transfer.data.get(..SHOWN_BYTES).unwrap_or(&transfer.data).to_vec();
        let text = written_text(transfer);
        let has_room = self.written.len() < crate::session::OBJECT_LIMIT;
        if !has_room && !self.written.contains_key(&object) {
            return;
        }
        let is_operational =
            self.machines.get(NMT).is_some_and(|nmt| nmt.last == NmtState::Operational.name());
        let before = self.written.get(&object).map_or(0, |written| written.in_operation);
        let in_operation = before.saturating_add(u64::from(is_operational));
        self.written.insert(object, WrittenValue { text, data, mark, in_operation });
    }

    fn set_point(&mut self, point: &SetPoint, mark: EvidenceMark) {
        let key = (point.object, point.channel);
        let has_room = self.points.len() < MOST_SUBJECTS;
        if !has_room && !self.points.contains_key(&key) {
            return;
        }
        let record = self.points.entry(key).or_default();
        if record.signal.is_empty() {
            point.signal.clone_into(&mut record.signal);
            point.unit.clone_into(&mut record.unit);
        }
        record.is_assumed |= point.assumed;
        if let Some(value) = point.to.number {
            let (low, high) = record.range.unwrap_or((f64::INFINITY, f64::NEG_INFINITY));
            let [low_text, high_text] = &mut record.texts;
            for (is_extreme, text) in [(value < low, low_text), (value > high, high_text)] {
                if is_extreme {
                    point.to.text.clone_into(text);
                    record.extreme = mark;
                }
            }
            record.range = Some((low.min(value), high.max(value)));
        }
        if let Some(deviation) = mark.time.and_then(|time| self.following.set_point(point, time)) {
            record.add_deviation(deviation);
        }
        let is_zero = point.to.number.is_none_or(|value| value == 0.0);
        match point.effective {
            EffectiveState::Yes => record.effective.add_mark(mark),
            EffectiveState::No if !is_zero => {
                if record.ineffective.count == 0 {
                    record.gates.clone_from(&point.gates);
                }
                record.ineffective.add_mark(mark);
            }
            EffectiveState::No | EffectiveState::Unknown => {}
        }
    }
}

impl PointRecord {
    /// Adds a deviation of the measured value.
    #[expect(clippy::cast_possible_truncation, reason = "saturates")]
    pub(super) fn add_deviation(&mut self, deviation: f64) {
        self.deviations.add_duration((deviation * 1_000.0) as i64);
    }
}

impl StateRecord {
    /// Adds the time in the present state until `mark`.
    pub(super) fn leave_state(&mut self, mark: EvidenceMark) {
        let elapsed =
            mark.time.zip(self.since.time).map_or(0, |(now, since)| now.saturating_sub(since).max(0));
        if let Some(state) = self.states.get_mut(&self.last) {
            state.time = state.time.saturating_add(elapsed);
        }
    }
}
