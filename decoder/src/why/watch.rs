//! What is remembered of one bus until the question is answered.

use std::collections::BTreeMap;

use super::cadence::{Beats, Quiet, Rhythm};
use super::change::{Changes, Reach, reach};
use super::fault::{self, FaultKind, Grade};
use super::moment::{Distance, Moment};
use super::state::NodeState;
use super::suggest::Signs;
use crate::event::{Effective, Event, EventKind, SetPoint};
use crate::frame::{BusIndex, Timestamp};
use crate::profile::PdoDirection;
use crate::session::Bus;
use crate::wire::NodeId;
use crate::wire::canopen::NmtState;

/// Set points kept of a node.
const POINTS: usize = 64;

/// Set points without effect remembered of a bus.
const IDLE_POINTS: usize = 64;

/// A set point that does not act for this long is worth a word, in nanoseconds; and in frames, in a capture
/// without times.
const IDLE: i64 = 500_000_000;
const IDLE_FRAMES: u64 = 100;

/// For this long after an NMT command a node may still say its old state, in nanoseconds.
const SETTLING: i64 = 1_000_000_000;

/// One node.
#[derive(Debug, Clone, Default)]
pub(super) struct NodeWatch {
    changes: Changes,
    /// When it was commanded last.
    commanded: Option<Timestamp>,
    was_operational: bool,
    beats: Beats,
    points: Vec<SetPoint>,
    /// What may suggest its profile.
    pub(super) signs: Signs,
}

/// A set point that does not act.
#[derive(Debug, Clone)]
struct Idle {
    node: NodeId,
    point: SetPoint,
    /// Its beginning, until it is judged.
    moment: Option<Moment>,
}

/// One bus.
#[derive(Debug, Clone)]
pub(super) struct BusWatch {
    index: BusIndex,
    /// The latest fault is asked for, not the first.
    latest: bool,
    /// The only node that is asked for.
    chosen: Option<NodeId>,
    sequence: u64,
    time: Option<Timestamp>,
    changes: Changes,
    /// When all nodes were commanded last.
    commanded: Option<Timestamp>,
    beats: Beats,
    nodes: BTreeMap<NodeId, NodeWatch>,
    idle: Vec<Idle>,
    /// Still gathers what belongs to it.
    open: Option<Moment>,
    /// One of each grade.
    found: [Option<Moment>; 3],
    /// Nothing later changes the answer.
    is_settled: bool,
}

impl BusWatch {
    pub(super) fn new(index: BusIndex, latest: bool, chosen: Option<NodeId>) -> Self {
        Self {
            index,
            latest,
            chosen,
            sequence: 0,
            time: None,
            changes: Changes::default(),
            commanded: None,
            beats: Beats::default(),
            nodes: BTreeMap::new(),
            idle: Vec::new(),
            open: None,
            found: [const { None }; 3],
            is_settled: false,
        }
    }

    /// Whether nothing later changes the answer.
    pub(super) fn is_settled(&self) -> bool {
        self.is_settled
    }

    /// Takes an event.
    pub(super) fn event(&mut self, event: &Event, bus: &Bus) {
        self.sequence = self.sequence.saturating_add(1);
        self.time = event.time.or(self.time);
        if self.open.as_ref().is_some_and(|open| open.distance(event) == Distance::Over) {
            self.close(bus);
        }
        self.judge_idle(event);
        let was_operational = self.learn(event);
        let node = event.node.and_then(|id| bus.node(id));
        let kind = fault::of(event, node, was_operational).filter(|_| self.is_asked_for(event));
        match kind {
            Some(FaultKind::LeftOperational) if self.is_settling(event) => {}
            Some(kind) => self.fault(kind, event, bus),
            None => self.companion(event, bus),
        }
        if let EventKind::SetPoint(point) = &event.kind {
            self.set_point(point, event, bus);
        }
        match reach(event) {
            Some(Reach::Bus) => self.changes.add(self.sequence, event),
            Some(Reach::Node(id)) => {
                let sequence = self.sequence;
                self.node(id).changes.add(sequence, event);
            }
            None => {}
        }
    }

    /// Faults of the bus concern whatever node is asked for.
    fn is_asked_for(&self, event: &Event) -> bool {
        self.chosen.is_none() || event.node.is_none() || event.node == self.chosen
    }

    /// Whether the node was commanded a moment ago.
    fn is_settling(&self, event: &Event) -> bool {
        let node = event.node.and_then(|id| self.nodes.get(&id)?.commanded);
        let command = self.commanded.max(node);
        event.time.zip(command).is_some_and(|(time, command)| time.since(command) <= SETTLING)
    }

    fn node(&mut self, id: NodeId) -> &mut NodeWatch {
        self.nodes.entry(id).or_default()
    }

    /// Remembers what is no change by itself; says whether the node had been operational before.
    fn learn(&mut self, event: &Event) -> bool {
        match event.kind {
            EventKind::Sync { .. } => self.beats.came(Rhythm::Sync, event.time, event.frames.last),
            EventKind::NmtCommand { target: 0, .. } => self.commanded = event.time,
            EventKind::NmtCommand { target, .. } => self.node(target.into()).commanded = event.time,
            _ => {}
        }
        let Some(id) = event.node else { return false };
        let node = self.node(id);
        let was_operational = node.was_operational;
        match &event.kind {
            EventKind::Pdo(pdo) if !pdo.is_request => {
                node.signs.pdo(pdo.name, pdo.length);
                if pdo.name.direction == PdoDirection::Receive {
                    node.beats.came(Rhythm::Rpdo(pdo.name), event.time, event.frames.last);
                }
            }
            EventKind::GuardRequest => node.beats.came(Rhythm::Guarding, event.time, event.frames.last),
            EventKind::NmtState(change) => node.was_operational |= change.to == NmtState::Operational,
            EventKind::Emcy(emergency) => {
                node.signs.ready |= emergency.code.is_none();
                if emergency.boot.is_some() {
                    node.points.clear();
                }
            }
            EventKind::BootUp { .. } => node.points.clear(),
            EventKind::SetPoint(point) => node.remember(point),
            _ => {}
        }
        was_operational
    }

    fn fault(&mut self, kind: FaultKind, event: &Event, bus: &Bus) {
        let sequence = self.sequence;
        let joins = self.open.as_ref().is_some_and(|open| {
            open.distance(event) == Distance::Together || open.node == event.node && open.is_cause_of(event)
        });
        if joins {
            if let Some(open) = &mut self.open {
                open.join(kind, event, sequence);
            }
        } else {
            self.close(bus);
            if self.latest || self.found(kind.grade()).is_none() {
                self.open = Some(self.begin(kind, event, event.node));
            }
        }
        self.refresh(bus);
    }

    /// An event that is no fault may belong to one.
    fn companion(&mut self, event: &Event, bus: &Bus) {
        let Some(open) = &mut self.open else { return };
        if open.is_told_by(event) {
            open.add(event, self.sequence);
            self.refresh(bus);
        } else if open.shows_state(event) {
            self.refresh(bus);
        }
    }

    /// A moment with what was before it.
    fn begin(&self, kind: FaultKind, event: &Event, node: Option<NodeId>) -> Moment {
        let mut moment = Moment::new(kind, event, self.sequence);
        moment.before = self.changes_of(node.or(self.chosen), 0);
        moment.quiet = self.quiet(node.or(self.chosen), event.time);
        moment
    }

    /// Shows the node as it stands now. Looking back, only how it stands at the end counts.
    fn refresh(&mut self, bus: &Bus) {
        if self.latest {
            return;
        }
        let Some(id) = self.open.as_ref().and_then(|open| open.node.or(self.chosen)) else { return };
        let state = self.state(bus, id);
        if let Some(open) = &mut self.open {
            open.state = Some(state);
        }
    }

    fn found(&self, grade: Grade) -> Option<&Moment> {
        self.found.get(grade as usize).and_then(Option::as_ref)
    }

    fn keep(&mut self, moment: Moment) {
        let latest = self.latest;
        let Some(place) = self.found.get_mut(moment.grade() as usize) else { return };
        // They are not found in the order in which they began.
        if place.as_ref().is_none_or(|known| (moment.began > known.began) == latest) {
            *place = Some(moment);
        }
    }

    fn close(&mut self, bus: &Bus) {
        if let Some(open) = self.open.take() {
            self.keep(open);
        }
        // Until the bus is believed to be one, what looked like a fault may be none.
        let is_sure = bus.is_canopen()
            || bus.is_j1939()
            || self.found(Grade::Fault).is_some_and(|it| it.node.is_none());
        self.is_settled = !self.latest && is_sure && self.found(Grade::Fault).is_some();
    }

    /// A set point that does not act is a finding if it goes on.
    fn set_point(&mut self, point: &SetPoint, event: &Event, bus: &Bus) {
        let Some(id) = event.node.filter(|_| self.is_asked_for(event)) else { return };
        let is_neutral = point.to.number.is_none_or(|number| number == 0.0);
        let is_idle = point.effective == Effective::No && !is_neutral;
        let place = self.idle.iter().position(|idle| idle.node == id && same(&idle.point, point));
        match place {
            Some(place) if !is_idle => {
                self.idle.remove(place);
            }
            None if is_idle && self.idle.len() < IDLE_POINTS => {
                let is_wanted = self.latest || self.found(Grade::Minor).is_none();
                let moment = is_wanted.then(|| {
                    let mut moment = self.begin(FaultKind::SetPoint, event, Some(id));
                    moment.state = Some(self.state(bus, id));
                    moment
                });
                self.idle.push(Idle { node: id, point: point.clone(), moment });
            }
            _ => {}
        }
    }

    /// Keeps the beginnings of set points that have been without effect for long enough.
    fn judge_idle(&mut self, event: &Event) {
        let lasts = |moment: &mut Moment| match event.time.zip(moment.time) {
            Some((now, start)) => now.since(start) >= IDLE,
            None => event.frames.last.saturating_sub(moment.frame) >= IDLE_FRAMES,
        };
        let mut found: Vec<Moment> = Vec::new();
        for moment in self.idle.iter_mut().filter_map(|idle| idle.moment.take_if(lasts)) {
            match found.last_mut().filter(|last| last.node == moment.node) {
                Some(last) => last.merge(moment),
                None => found.push(moment),
            }
        }
        for moment in found {
            self.keep(moment);
        }
    }

    /// The gravest moment; the capture has ended.
    pub(super) fn finish(&mut self, bus: &Bus) -> Option<Moment> {
        self.close(bus);
        self.found.iter_mut().rev().find_map(Option::take)
    }

    /// Changes of a node and of the bus behind an event, oldest first.
    pub(super) fn changes_of(&self, node: Option<NodeId>, behind: u64) -> Vec<Event> {
        let node = node.and_then(|id| self.nodes.get(&id)).map(|node| &node.changes);
        Changes::last(node.into_iter().chain([&self.changes]), behind)
    }

    /// What had a beat and is silent.
    pub(super) fn quiet(&self, node: Option<NodeId>, now: Option<Timestamp>) -> Vec<Quiet> {
        let node = node.and_then(|id| self.nodes.get(&id));
        let own = node.into_iter().flat_map(|node| node.beats.quiet(now));
        self.beats.quiet(now).chain(own).collect()
    }

    /// How a node stands now.
    pub(super) fn state(&self, bus: &Bus, id: NodeId) -> NodeState {
        let points = self.nodes.get(&id).map_or(&[][..], |node| &node.points);
        NodeState::now(bus, id, points)
    }

    /// Time of the last event.
    pub(super) fn time(&self) -> Option<Timestamp> {
        self.time
    }

    /// Which bus.
    pub(super) fn index(&self) -> BusIndex {
        self.index
    }

    /// Nodes heard of.
    pub(super) fn nodes(&self) -> impl Iterator<Item = (NodeId, &NodeWatch)> {
        self.nodes.iter().map(|(id, node)| (*id, node))
    }
}

fn same(one: &SetPoint, other: &SetPoint) -> bool {
    (one.object, one.channel, &one.carrier) == (other.object, other.channel, &other.carrier)
}

impl NodeWatch {
    /// The set point as it came last.
    fn remember(&mut self, point: &SetPoint) {
        let has_room = self.points.len() < POINTS;
        match self.points.iter_mut().find(|known| same(known, point)) {
            Some(known) => known.clone_from(point),
            None if has_room => self.points.push(point.clone()),
            None => {}
        }
    }
}
