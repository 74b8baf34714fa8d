//! A moment at which something went wrong: the faults that came together, and what surrounded them.

use super::cadence::Quiet;
use super::change::{SHOWN, reach, short};
use super::fault::{FaultKind, Grade};
use super::state::NodeState;
use crate::event::{Event, EventKind};
use crate::frame::{BusIndex, Timestamp};
use crate::wire::NodeId;

/// Faults within this time are one, in nanoseconds.
const TOGETHER: i64 = 20_000_000;

/// A state whose cause is the fault belongs to it within this time, in nanoseconds.
const CONSEQUENCE: i64 = 1_000_000_000;

/// The same in frames, in a capture without times.
const CONSEQUENCE_FRAMES: u64 = 200;

/// How an event lies to a moment.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Distance {
    /// At once.
    Together,
    /// Soon after: consequences are still part of it.
    Soon,
    /// Too late.
    Over,
}

/// A moment at which something went wrong.
#[derive(Debug, Clone)]
pub struct Moment {
    /// What, first first.
    pub kinds: Vec<FaultKind>,
    /// When.
    pub time: Option<Timestamp>,
    /// Frame of the first fault.
    pub frame: u64,
    /// Where.
    pub bus: BusIndex,
    /// The node of the first fault; none where it is the bus.
    pub node: Option<NodeId>,
    /// Faults and what follows from them, in order.
    pub events: Vec<Event>,
    /// Further ones that are not kept.
    pub more: u64,
    /// The last changes before, oldest first.
    pub before: Vec<Event>,
    /// How the node stood then.
    pub state: Option<NodeState>,
    /// What had come with a beat and was silent then.
    pub quiet: Vec<Quiet>,
    /// Its first and last event, counted over all of its bus.
    pub(super) began: u64,
    pub(super) sequence: u64,
}

impl Moment {
    /// It begins with `event`.
    pub(super) fn new(kind: FaultKind, event: &Event, sequence: u64) -> Self {
        Self {
            kinds: vec![kind],
            time: event.time,
            frame: event.frames.last,
            bus: event.bus,
            node: event.node,
            events: vec![short(event)],
            more: 0,
            before: Vec::new(),
            state: None,
            quiet: Vec::new(),
            began: sequence,
            sequence,
        }
    }

    /// The gravest of its faults.
    pub fn grade(&self) -> Grade {
        self.kinds.iter().map(|kind| kind.grade()).max().unwrap_or(Grade::Refused)
    }

    /// Whether it is a start at which settings went.
    pub(super) fn lost_settings(&self) -> bool {
        self.events.iter().any(|event| matches!(event.kind, EventKind::BootUp { lost, .. } if lost > 0))
    }

    /// Order in time.
    pub(super) fn order(&self) -> (Option<Timestamp>, u64) {
        (self.time, self.frame)
    }

    /// How an event lies to it.
    pub(super) fn distance(&self, event: &Event) -> Distance {
        let (together, soon) = if let Some((time, start)) = event.time.zip(self.time) {
            (time.since(start) <= TOGETHER, time.since(start) <= CONSEQUENCE)
        } else {
            let frames = event.frames.last.saturating_sub(self.frame);
            (frames == 0, frames <= CONSEQUENCE_FRAMES)
        };
        match (together, soon) {
            (true, _) => Distance::Together,
            (false, true) => Distance::Soon,
            (false, false) => Distance::Over,
        }
    }

    /// Adds a fault that came with it.
    pub(super) fn join(&mut self, kind: FaultKind, event: &Event, sequence: u64) {
        if !self.kinds.contains(&kind) {
            self.kinds.push(kind);
        }
        self.add(event, sequence);
    }

    /// Adds what began at the same moment.
    pub(super) fn merge(&mut self, other: Self) {
        for event in &other.events {
            self.add(event, other.sequence);
        }
        self.state = other.state;
    }

    /// Adds an event.
    pub(super) fn add(&mut self, event: &Event, sequence: u64) {
        self.sequence = sequence;
        if self.events.len() < SHOWN {
            self.events.push(short(event));
        } else {
            self.more = self.more.saturating_add(1);
        }
    }

    /// Whether an event that is no fault tells more of this one.
    pub(super) fn is_told_by(&self, event: &Event) -> bool {
        // Changes alone: what an NMT command or a boot-up tells of a state is in their own lines.
        if event.node != self.node || reach(event).is_none() {
            return false;
        }
        match self.distance(event) {
            Distance::Over => false,
            Distance::Soon => self.is_cause_of(event),
            Distance::Together => matches!(
                event.kind,
                EventKind::NmtState(_)
                    | EventKind::DeviceState(_)
                    | EventKind::Mode(_)
                    | EventKind::Procedure(_)
            ),
        }
    }

    /// Whether an event that is not worth a line lets the node be seen as the fault left it.
    pub(super) fn shows_state(&self, event: &Event) -> bool {
        let is_status = matches!(
            event.kind,
            EventKind::Pdo(_)
                | EventKind::SetPoint(_)
                | EventKind::BitsChanged(_)
                | EventKind::Emcy(_)
                | EventKind::Dtc(_)
        );
        is_status && event.node == self.node && self.distance(event) == Distance::Together
    }

    /// Whether an event names a fault of this moment as its cause.
    pub(super) fn is_cause_of(&self, event: &Event) -> bool {
        let cause = match &event.kind {
            EventKind::NmtState(change) => change.cause_frame,
            EventKind::DeviceState(state) => state.cause_frame,
            _ => 0,
        };
        cause != 0 && self.events.iter().any(|known| known.frames.last == cause)
    }
}
