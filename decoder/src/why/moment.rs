//! A moment with a fault: simultaneous faults and their context.

use super::cadence::StoppedMessage;
use super::change::{SHOWN, change_scope, shorten_event};
use super::fault::{FaultGrade, FaultKind};
use super::state::NodeState;
use crate::event::{Event, EventKind};
use crate::frame::{BusIndex, Timestamp};
use crate::session::MessagePreview;
use crate::wire::NodeId;

/// Faults within this time are one moment, in ns.
const TOGETHER: i64 = 20_000_000;

/// Maximum delay of a state change caused by the fault, in ns.
const CONSEQUENCE: i64 = 1_000_000_000;

/// Maximum delay in frames, for a capture without timestamps.
const CONSEQUENCE_FRAMES: u64 = 200;

/// Position of an event relative to a moment.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum MomentDistance {
    /// Simultaneous.
    Together,
    /// Soon after: consequences still belong to the moment.
    Soon,
    /// Too late to belong to the moment.
    Over,
}

/// A moment with a fault.
#[derive(Debug, Clone)]
pub struct WhyMoment {
    /// Kinds of fault in order of time; empty if a rule found the fault.
    pub kinds: Vec<FaultKind>,
    /// Findings that began at this moment.
    pub findings: Vec<u64>,
    /// Time of the first fault.
    pub time: Option<Timestamp>,
    /// Frame of the first fault.
    pub frame: u64,
    /// Bus of the first fault.
    pub bus: BusIndex,
    /// Node of the first fault; `None` for a fault of the bus.
    pub node: Option<NodeId>,
    /// Faults and their consequences in order of time.
    pub events: Vec<Event>,
    /// Number of further events not stored.
    pub more: u64,
    /// Last changes before the fault, oldest first.
    pub before: Vec<Event>,
    /// State of the node at the fault.
    pub state: Option<NodeState>,
    /// Periodic messages that had stopped at the fault.
    pub quiet: Vec<StoppedMessage>,
    /// Sequence numbers of the first and last event on the bus.
    pub(super) began: u64,
    pub(super) sequence: u64,
}

impl WhyMoment {
    /// Starts a moment with `event`.
    pub(super) fn new(kind: Option<FaultKind>, event: &Event, sequence: u64) -> Self {
        Self {
            kinds: kind.into_iter().collect(),
            findings: Vec::new(),
            time: event.time,
            frame: event.frames.last,
            bus: event.bus,
            node: event.node,
            events: vec![shorten_event(event)],
            more: 0,
            before: Vec::new(),
            state: None,
            quiet: Vec::new(),
            began: sequence,
            sequence,
        }
    }

    /// Highest grade of the faults.
    pub fn highest_grade(&self) -> FaultGrade {
        self.kinds.iter().map(|kind| kind.fault_grade()).max().unwrap_or(FaultGrade::Refused)
    }

    /// Whether volatile settings were lost at a boot-up.
    pub(super) fn lost_settings(&self) -> bool {
        self.events.iter().any(|event| matches!(event.kind, EventKind::BootUp { lost, .. } if lost > 0))
    }

    /// Sort key by time.
    pub(super) fn sort_key(&self) -> (Option<Timestamp>, u64) {
        (self.time, self.frame)
    }

    /// Position of an event relative to the moment.
    pub(super) fn distance_of(&self, event: &Event) -> MomentDistance {
        self.distance_at(event.time, event.frames.last)
    }

    fn distance_at(&self, time: Option<Timestamp>, frame: u64) -> MomentDistance {
        let (together, soon) = if let Some((time, start)) = time.zip(self.time) {
            (time.since(start) <= TOGETHER, time.since(start) <= CONSEQUENCE)
        } else {
            let frames = frame.saturating_sub(self.frame);
            (frames == 0, frames <= CONSEQUENCE_FRAMES)
        };
        match (together, soon) {
            (true, _) => MomentDistance::Together,
            (false, true) => MomentDistance::Soon,
            (false, false) => MomentDistance::Over,
        }
    }

    /// Adds a simultaneous fault.
    pub(super) fn join_fault(&mut self, kind: FaultKind, event: &Event, sequence: u64) {
        if !self.kinds.contains(&kind) {
            self.kinds.push(kind);
        }
        self.add_event(event, sequence);
    }

    /// Merges a moment that starts at the same time.
    pub(super) fn merge_moment(&mut self, other: Self) {
        for event in &other.events {
            self.add_event(event, other.sequence);
        }
        self.state = other.state;
    }

    /// Adds an event.
    pub(super) fn add_event(&mut self, event: &Event, sequence: u64) {
        self.sequence = sequence;
        if self.events.len() < SHOWN {
            self.events.push(shorten_event(event));
        } else {
            self.more = self.more.saturating_add(1);
        }
    }

    /// Whether an event without a fault adds information on this moment.
    pub(super) fn is_explained_by(&self, event: &Event) -> bool {
        // States that follow from an NMT command or a boot-up are already in the line of that event.
        if event.node != self.node || change_scope(event).is_none() {
            return false;
        }
        match self.distance_of(event) {
            MomentDistance::Over => false,
            MomentDistance::Soon => self.is_cause_of(event),
            MomentDistance::Together => matches!(
                event.kind,
                EventKind::NmtState(_)
                    | EventKind::DeviceState(_)
                    | EventKind::Mode(_)
                    | EventKind::Procedure(_)
            ),
        }
    }

    /// Whether an event without a line of its own updates the node state left by the fault.
    pub(super) fn shows_state(&self, event: &Event) -> bool {
        let is_status = matches!(
            event.kind,
            EventKind::Pdo(_)
                | EventKind::SetPoint(_)
                | EventKind::BitsChanged(_)
                | EventKind::Emcy(_)
                | EventKind::Dtc(_)
        );
        is_status && event.node == self.node && self.distance_of(event) == MomentDistance::Together
    }

    /// Whether a frame is too late for this moment.
    pub(super) fn is_over(&self, preview: &MessagePreview) -> bool {
        self.distance_at(Some(preview.time), preview.frame) == MomentDistance::Over
    }

    /// Whether a PDO of a node updates the node state left by the fault; see [`Self::shows_state`].
    pub(super) fn is_updated_by_pdo(&self, node: NodeId, preview: &MessagePreview) -> bool {
        let is_together = self.distance_at(Some(preview.time), preview.frame) == MomentDistance::Together;
        is_together && self.node == Some(node)
    }

    /// Whether a fault of this moment is the cause of an event.
    pub(super) fn is_cause_of(&self, event: &Event) -> bool {
        let cause = match &event.kind {
            EventKind::NmtState(change) => change.cause_frame,
            EventKind::DeviceState(state) => state.cause_frame,
            _ => 0,
        };
        cause != 0 && self.events.iter().any(|known| known.frames.last == cause)
    }
}
