//! Data collected for one bus.

use super::cadence::{MessageRhythm, PeriodicMessages, StoppedMessage};
use super::change::{ChangeScope, RecentChanges, change_scope};
use super::fault::{self, FaultGrade, FaultKind};
use super::followed::FollowedPdos;
use super::moment::{MomentDistance, WhyMoment};
use super::node_watch::{NodeWatch, is_same_point};
use super::state::NodeState;
use crate::event::{DecodedPdo, EffectiveState, Event, EventKind, SetPoint};
use crate::frame::{BusIndex, Timestamp};
use crate::session::{Bus, MessagePreview};
use crate::statistics::ReactionTime;
use crate::wire::canopen::NmtState;
use crate::wire::{NodeId, NodeMap};

/// Maximum number of set points without effect per bus.
const IDLE_POINTS: usize = 64;

/// Minimum time for which a set point must be without effect to be reported, in ns; in frames for a capture
/// without timestamps.
const IDLE: i64 = 500_000_000;
const IDLE_FRAMES: u64 = 100;

/// Maximum number of moments of findings per bus.
const FINDINGS: usize = 64;

/// Time after an NMT command during which a node may still report its old state, in ns.
const SETTLING: i64 = 1_000_000_000;

/// A set point without effect.
#[derive(Debug, Clone)]
struct IdleSetPoint {
    node: NodeId,
    point: SetPoint,
    /// Start of the condition; `None` after it was reported.
    moment: Option<WhyMoment>,
}

/// Data collected for one bus.
#[derive(Debug, Clone)]
pub(super) struct BusWatch {
    index: BusIndex,
    /// Search for the latest fault instead of the first.
    latest: bool,
    /// Restricts the search to one node.
    chosen: Option<NodeId>,
    /// Whether the current event may be a fault of the report.
    may_report: bool,
    sequence: u64,
    time: Option<Timestamp>,
    changes: RecentChanges,
    /// Time of the last NMT command to all nodes.
    commanded: Option<Timestamp>,
    beats: PeriodicMessages,
    nodes: NodeMap<Box<NodeWatch>>,
    followed: FollowedPdos,
    idle: Vec<IdleSetPoint>,
    /// Moment that is still collecting events.
    open: Option<WhyMoment>,
    /// One moment per grade.
    found: [Option<WhyMoment>; 3],
    /// Moments at which findings began, at most [`FINDINGS`].
    of_findings: Vec<WhyMoment>,
}

impl BusWatch {
    pub(super) fn new(index: BusIndex, latest: bool, chosen: Option<NodeId>) -> Self {
        Self {
            index,
            latest,
            chosen,
            may_report: true,
            sequence: 0,
            time: None,
            changes: RecentChanges::default(),
            commanded: None,
            beats: PeriodicMessages::default(),
            nodes: NodeMap::default(),
            followed: FollowedPdos::default(),
            idle: Vec::new(),
            open: None,
            found: [const { None }; 3],
            of_findings: Vec::new(),
        }
    }

    /// Reaction times of the controller, of one node or of all.
    pub(super) fn reaction_times(
        &self,
        node: Option<NodeId>,
    ) -> impl Iterator<Item = (NodeId, &ReactionTime)> {
        let chosen = self.nodes.iter().filter(move |(id, _)| node.is_none_or(|node| node == *id));
        chosen.flat_map(|(id, watch)| watch.reactions.pairs().iter().map(move |pair| (id, pair)))
    }

    /// Processes an event; `bus` is in the state after it.
    pub(super) fn observe_event(&mut self, event: &Event, bus: &Bus, may_report: bool) {
        self.may_report = may_report;
        self.sequence = self.sequence.saturating_add(1);
        self.time = event.time.or(self.time);
        if let EventKind::FindingOpened(news) = &event.kind {
            return self.note_finding(news.id, event, bus);
        }
        if self.open.as_ref().is_some_and(|open| open.distance_of(event) == MomentDistance::Over) {
            self.close_moment();
        }
        if !self.idle.is_empty() {
            self.judge_idle(event.time, event.frames.last);
        }
        // Outside a moment, PDOs and complete SYNC messages are neither faults nor changes.
        match &event.kind {
            EventKind::Pdo(pdo) if self.open.is_none() => {
                if !pdo.is_request {
                    self.follow_pdo(pdo, event, bus);
                }
                return;
            }
            EventKind::Sync { expected: None, .. } if self.open.is_none() => {
                return self.beats.add_message(MessageRhythm::Sync, event.time, event.frames.last);
            }
            _ => {}
        }
        let was_operational = self.learn_event(event, bus);
        let node = event.node.and_then(|id| bus.node(id));
        let kind = fault::fault_kind(event, node, was_operational).filter(|_| self.is_asked_for(event));
        match kind {
            Some(FaultKind::LeftOperational) if self.is_settling(event) => {}
            Some(kind) => self.note_fault(kind, event, bus),
            None => self.note_companion(event, bus),
        }
        if let EventKind::SetPoint(point) = &event.kind {
            self.set_point(point, event, bus);
        }
        if let (Some(id), EventKind::BootUp { .. } | EventKind::NodeLost(_)) = (event.node, &event.kind) {
            self.followed.pass_on(id, &mut self.nodes);
            if let Some(node) = self.nodes.entry(id) {
                node.reactions.take_event(event);
            }
        }
        match change_scope(event) {
            Some(ChangeScope::Bus) => self.changes.add_change(self.sequence, event),
            Some(ChangeScope::Node(id)) => {
                if let Some(node) = self.nodes.entry(id) {
                    node.changes.add_change(self.sequence, event);
                }
            }
            None => {}
        }
    }

    /// Whether a moment is still collecting events, or a set point without effect may become a fault.
    #[inline]
    pub(super) fn is_watching(&self) -> bool {
        self.open.is_some() || !self.idle.is_empty()
    }

    /// Whether the event of a PDO or message is needed: only a PDO that updates the state of the node in a moment.
    pub(super) fn needs_event(&self, preview: &MessagePreview, bus: &Bus) -> bool {
        self.open.as_ref().is_some_and(|open| {
            let of_pdo = bus.identifiers().pdo_at(preview.identifier);
            of_pdo.is_some_and(|(_, node)| open.is_updated_by_pdo(node, preview))
        })
    }

    /// Takes a PDO or message without an event.
    #[inline]
    pub(super) fn skip_event(&mut self, preview: &MessagePreview) {
        self.followed.skip_frame(preview, &mut self.nodes);
    }

    /// Ends the moment and judges set points at a frame without an event.
    #[cold]
    pub(super) fn watch_preview(&mut self, preview: &MessagePreview) {
        if self.open.as_ref().is_some_and(|open| open.is_over(preview)) {
            self.close_moment();
        }
        self.judge_idle(Some(preview.time), preview.frame);
    }

    /// Records a PDO that is not a request. One with unchanged contents is no news.
    fn follow_pdo(&mut self, pdo: &DecodedPdo, event: &Event, bus: &Bus) {
        let Some(identifier) = bus.identifiers().identifier_of_event(pdo.cob_id) else { return };
        let frame = event.frames.last;
        self.followed.count_pdo((identifier, event.time, frame), bus, &mut self.nodes);
        if let Some(time) = event.time.filter(|_| !event.routine) {
            self.followed.count_change(identifier, (time, frame), &mut self.nodes);
        }
    }

    /// Whether an event concerns the chosen node; faults of the bus always do.
    fn is_asked_for(&self, event: &Event) -> bool {
        let is_of_node = self.chosen.is_none() || event.node.is_none() || event.node == self.chosen;
        self.may_report && is_of_node
    }

    /// Whether the node was commanded less than [`SETTLING`] ago.
    fn is_settling(&self, event: &Event) -> bool {
        let node = event.node.and_then(|id| self.nodes.get(id)?.commanded);
        let command = self.commanded.max(node);
        event.time.zip(command).is_some_and(|(time, command)| time.since(command) <= SETTLING)
    }

    /// Updates periodic messages, commands and set points; returns whether the node was operational before.
    fn learn_event(&mut self, event: &Event, bus: &Bus) -> bool {
        match &event.kind {
            EventKind::Pdo(pdo) if !pdo.is_request => self.follow_pdo(pdo, event, bus),
            EventKind::Sync { .. } => {
                self.beats.add_message(MessageRhythm::Sync, event.time, event.frames.last);
            }
            EventKind::NmtCommand { target: 0, .. } => self.commanded = event.time,
            EventKind::NmtCommand { target, .. } => {
                if let Some(node) = self.nodes.entry((*target).into()) {
                    node.commanded = event.time;
                }
            }
            _ => {}
        }
        let Some(node) = event.node.and_then(|id| self.nodes.entry(id)) else { return false };
        let was_operational = node.was_operational;
        match &event.kind {
            EventKind::GuardRequest => {
                node.beats.add_message(MessageRhythm::Guarding, event.time, event.frames.last);
            }
            EventKind::NmtState(change) => node.was_operational |= change.to == NmtState::Operational,
            EventKind::Emcy(emergency) if emergency.boot.is_some() => node.points.clear(),
            EventKind::BootUp { .. } => node.points.clear(),
            EventKind::SetPoint(point) => node.remember_point(point),
            _ => {}
        }
        was_operational
    }

    fn note_fault(&mut self, kind: FaultKind, event: &Event, bus: &Bus) {
        let sequence = self.sequence;
        let joins = self.open.as_ref().is_some_and(|open| {
            open.distance_of(event) == MomentDistance::Together
                || open.node == event.node && open.is_cause_of(event)
        });
        if joins {
            if let Some(open) = &mut self.open {
                open.join_fault(kind, event, sequence);
            }
        } else {
            self.close_moment();
            if self.latest || self.found_moment(kind.fault_grade()).is_none() {
                self.open = Some(self.begin_moment(Some(kind), event, event.node, bus));
            }
        }
        self.refresh_state(bus);
    }

    /// Keeps the moment at which a finding began.
    fn note_finding(&mut self, id: u64, event: &Event, bus: &Bus) {
        let is_known = self.of_findings.iter().any(|moment| moment.findings.contains(&id));
        if is_known || self.of_findings.len() >= FINDINGS {
            return;
        }
        let together = self
            .open
            .as_mut()
            .filter(|open| open.node == event.node && open.distance_of(event) == MomentDistance::Together);
        if let Some(open) = together {
            open.findings.push(id);
            return;
        }
        let mut moment = self.begin_moment(None, event, event.node, bus);
        moment.findings.push(id);
        moment.state = event.node.or(self.chosen).map(|node| self.node_state(bus, node));
        self.of_findings.push(moment);
    }

    /// The moment at which a finding began.
    pub(super) fn of_finding(&self, id: u64) -> Option<&WhyMoment> {
        self.of_findings.iter().find(|moment| moment.findings.contains(&id))
    }

    /// Adds an event without a fault to the open moment, if it belongs there.
    fn note_companion(&mut self, event: &Event, bus: &Bus) {
        let Some(open) = &mut self.open else { return };
        if open.is_explained_by(event) {
            open.add_event(event, self.sequence);
            self.refresh_state(bus);
        } else if open.shows_state(event) {
            self.refresh_state(bus);
        }
    }

    /// Starts a moment with the changes before it.
    fn begin_moment(
        &self,
        kind: Option<FaultKind>,
        event: &Event,
        node: Option<NodeId>,
        bus: &Bus,
    ) -> WhyMoment {
        let mut moment = WhyMoment::new(kind, event, self.sequence);
        moment.before = self.changes_of(node.or(self.chosen), 0);
        moment.quiet = self.overdue_messages(node.or(self.chosen), event.time, bus);
        moment
    }

    /// Updates the node state of the open moment. Not for the latest fault, whose state is that at the end.
    fn refresh_state(&mut self, bus: &Bus) {
        if self.latest {
            return;
        }
        let Some(id) = self.open.as_ref().and_then(|open| open.node.or(self.chosen)) else { return };
        let state = self.node_state(bus, id);
        if let Some(open) = &mut self.open {
            open.state = Some(state);
        }
    }

    fn found_moment(&self, grade: FaultGrade) -> Option<&WhyMoment> {
        self.found.get(grade as usize).and_then(Option::as_ref)
    }

    fn keep_moment(&mut self, moment: WhyMoment) {
        let latest = self.latest;
        let Some(place) = self.found.get_mut(moment.highest_grade() as usize) else { return };
        // Moments are not found in the order in which they started.
        if place.as_ref().is_none_or(|known| (moment.began > known.began) == latest) {
            *place = Some(moment);
        }
    }

    fn close_moment(&mut self) {
        let Some(open) = self.open.take() else { return };
        if !open.findings.is_empty() {
            self.of_findings.push(open.clone());
        }
        self.keep_moment(open);
    }

    /// Tracks set points without effect; they are reported if the condition persists.
    fn set_point(&mut self, point: &SetPoint, event: &Event, bus: &Bus) {
        let Some(id) = event.node.filter(|_| self.is_asked_for(event)) else { return };
        let is_neutral = point.to.number.is_none_or(|number| number == 0.0);
        let is_idle = point.effective == EffectiveState::No && !is_neutral;
        let place = self.idle.iter().position(|idle| idle.node == id && is_same_point(&idle.point, point));
        match place {
            Some(place) if !is_idle => {
                self.idle.remove(place);
            }
            None if is_idle && self.idle.len() < IDLE_POINTS => {
                let is_wanted = self.latest || self.found_moment(FaultGrade::Minor).is_none();
                let moment = is_wanted.then(|| {
                    let mut moment = self.begin_moment(Some(FaultKind::SetPoint), event, Some(id), bus);
                    moment.state = Some(self.node_state(bus, id));
                    moment
                });
                self.idle.push(IdleSetPoint { node: id, point: point.clone(), moment });
            }
            _ => {}
        }
    }

    /// Reports set points that have been without effect for long enough.
    fn judge_idle(&mut self, time: Option<Timestamp>, frame: u64) {
        let lasts = |moment: &mut WhyMoment| match time.zip(moment.time) {
            Some((now, start)) => now.since(start) >= IDLE,
            None => frame.saturating_sub(moment.frame) >= IDLE_FRAMES,
        };
        let mut found: Vec<WhyMoment> = Vec::new();
        for moment in self.idle.iter_mut().filter_map(|idle| idle.moment.take_if(lasts)) {
            match found.last_mut().filter(|last| last.node == moment.node) {
                Some(last) => last.merge_moment(moment),
                None => found.push(moment),
            }
        }
        for moment in found {
            self.keep_moment(moment);
        }
    }

    /// Moment with the highest grade at the end of the capture.
    pub(super) fn finish_watch(&mut self) -> Option<WhyMoment> {
        self.close_moment();
        self.found.iter_mut().rev().find_map(Option::take)
    }

    /// Changes of a node and of the bus after event number `after`, oldest first.
    pub(super) fn changes_of(&self, node: Option<NodeId>, after: u64) -> Vec<Event> {
        let node = node.and_then(|id| self.nodes.get(id)).map(|node| &node.changes);
        RecentChanges::last_changes(node.into_iter().chain([&self.changes]), after)
    }

    /// Periodic messages of the bus and of a node that have stopped.
    pub(super) fn overdue_messages(
        &self,
        node: Option<NodeId>,
        now: Option<Timestamp>,
        bus: &Bus,
    ) -> Vec<StoppedMessage> {
        let node = node.and_then(|id| self.nodes.get(id));
        let beat_of = |identifier| self.followed.message_times(identifier, bus).map(|(beat, _)| beat);
        let own = node.into_iter().flat_map(|node| node.beats.overdue_messages(now, beat_of));
        self.beats.overdue_messages(now, beat_of).chain(own).collect()
    }

    /// Current state of a node.
    pub(super) fn node_state(&self, bus: &Bus, id: NodeId) -> NodeState {
        let points = self.nodes.get(id).map_or(&[][..], |node| &node.points);
        NodeState::current_state(bus, id, points)
    }

    /// Time of the last event.
    pub(super) fn time(&self) -> Option<Timestamp> {
        self.time
    }

    /// Index of the bus.
    pub(super) fn index(&self) -> BusIndex {
        self.index
    }

    /// Nodes with events.
    pub(super) fn nodes(&self) -> impl Iterator<Item = (NodeId, &NodeWatch)> {
        self.nodes.iter().map(|(id, node)| (id, &**node))
    }
}
