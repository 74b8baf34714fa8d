//! What one rule remembers of a node.

use std::collections::VecDeque;

use crate::wire::canopen::ObjectAddress;

/// A frame, and its time in the clock of the rules.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub(super) struct FrameTime {
    pub(super) time: i64,
    pub(super) frame: u64,
}

/// State of one rule at one node.
#[derive(Debug, Clone, Default)]
pub(super) struct RuleProgress {
    /// `while` held at the last look.
    pub(super) holds: bool,
    /// Start of the interval.
    pub(super) last: Option<FrameTime>,
    /// Time of the next look.
    pub(super) deadline: Option<i64>,
    /// Time of the next wake-up: a deadline that moves on requests one only.
    pub(super) wake: Option<i64>,
    /// Number of events counted, and the frame of the first of them.
    pub(super) count: u32,
    pub(super) first: u64,
    /// Start of the counted stretch; `None` if it was not seen.
    pub(super) since: Option<i64>,
    /// The counted stretch has a beginning.
    pub(super) is_counting: bool,
    /// Whether the event that must be first occurred; `None` while that is not known.
    pub(super) is_prepared: Option<bool>,
    /// The last events, by object where each object counts for itself.
    recent: Vec<(Option<ObjectAddress>, VecDeque<FrameTime>)>,
}

/// Objects one rule counts by themselves; further ones are not judged.
const OBJECT_LIMIT: usize = 256;

impl RuleProgress {
    /// The last events of an object, or of all; `None` above the limit of objects.
    pub(super) fn recent(&mut self, object: Option<ObjectAddress>) -> Option<&mut VecDeque<FrameTime>> {
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
    pub(super) fn reset(&mut self) {
        *self = Self { is_prepared: self.is_prepared, ..Self::default() };
    }

    /// Neither an interval nor a count continues.
    pub(super) fn interrupt(&mut self) {
        self.recent.clear();
        (self.last, self.since, self.count, self.is_counting) = (None, None, 0, false);
    }
}
