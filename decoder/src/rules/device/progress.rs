//! State of one rule at one node.

use std::collections::VecDeque;

use crate::wire::canopen::ObjectAddress;

/// Time (as in [`crate::rules::Context::now`]) and number of a frame.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub(super) struct FrameTime {
    pub(super) time: i64,
    pub(super) frame: u64,
}

/// What a PDO does to a rule that does not rest.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum PdoTask {
    /// It is counted until the next SYNC, if the node is operational.
    Count,
    /// It is the awaited event.
    Answer,
    /// The rule must be evaluated.
    Evaluate,
}

/// State of one rule at one node.
#[derive(Debug, Clone, Default)]
pub(super) struct RuleProgress {
    /// `while` held at the last update.
    pub(super) holds: bool,
    /// Start of the interval.
    pub(super) last: Option<FrameTime>,
    /// Time of the next check.
    pub(super) deadline: Option<i64>,
    /// Time of the pending wake-up; only one is requested for a deadline that is postponed.
    pub(super) wake: Option<i64>,
    /// Number of counted events; `first` is the frame of the first one.
    pub(super) count: u32,
    pub(super) first: u64,
    /// Start of the counted interval; None if it was not seen.
    pub(super) since: Option<i64>,
    /// The start of the counted interval was seen.
    pub(super) is_counting: bool,
    /// Whether the required earlier event has occurred; None if unknown.
    pub(super) is_prepared: Option<bool>,
    /// Bit mask of the steps of a sequence that have occurred.
    pub(super) done: u64,
    /// A forbidden event could have occurred, in the current interval of `while`, or of `since` and `until`.
    pub(super) is_exercised: bool,
    /// An event of `on` occurred.
    pub(super) has_begun: bool,
    /// Time at which the required earlier event became necessary again.
    pub(super) voided: Option<i64>,
    /// Recent events, by object if each object has its own count.
    recent: Vec<(Option<ObjectAddress>, VecDeque<FrameTime>)>,
}

/// Maximum number of objects with their own count; further ones are ignored.
const OBJECT_LIMIT: usize = 256;

impl RuleProgress {
    /// Recent events of an object (or of all); None above [`OBJECT_LIMIT`].
    pub(super) fn recent_events(
        &mut self,
        object: Option<ObjectAddress>,
    ) -> Option<&mut VecDeque<FrameTime>> {
        let place = match self.recent.iter().position(|(known, _)| *known == object) {
            Some(place) => place,
            None if self.recent.len() < OBJECT_LIMIT => {
                self.recent.push((object, VecDeque::new()));
                self.recent.len() - 1
            }
            None => return None,
        };
        self.recent.get_mut(place).map(|(_, recent)| recent)
    }

    /// The node restarted: all but the order of events is void.
    pub(super) fn reset_after_restart(&mut self) {
        let Self { is_prepared, is_exercised, has_begun, voided, .. } = *self;
        *self = Self { is_prepared, is_exercised, has_begun, voided, ..Self::default() };
    }

    /// Neither an interval nor a count continues.
    pub(super) fn interrupt_intervals(&mut self) {
        self.recent.clear();
        (self.last, self.since, self.count, self.is_counting) = (None, None, 0, false);
    }
}
