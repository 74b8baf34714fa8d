//! What is remembered of one node for the rules of its device.

use std::collections::VecDeque;
use std::sync::Arc;

use super::dispatch::waits_for;
use super::plan::Plan;
use crate::profile::PdoName;
use crate::profile::device::RuleKind;
use crate::wire::canopen::ObjectAddress;

/// A time in the clock of the rules, and the frame that came then.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub(super) struct Moment {
    pub(super) time: i64,
    pub(super) frame: u64,
}

/// A node whose device has rules.
pub(super) struct Attached {
    pub(super) plan: Arc<Plan>,
    pub(super) seen: Seen,
    /// What each rule remembers.
    pub(super) courses: Vec<Course>,
    /// When outputs of the device changed their state.
    changes: Vec<(Option<u8>, i64)>,
    /// When the node itself was heard last before the present event.
    pub(super) heard: Option<i64>,
    /// Something of the node was seen.
    pub(super) is_present: bool,
    /// Room for the values of one PDO: before, and now.
    pub(super) scratch: Vec<(Option<i64>, Option<i64>)>,
}

/// Last values in PDOs and messages of the objects that count, by their places in the plan.
#[derive(Debug, Default)]
pub(super) struct Seen {
    values: Vec<Option<SeenValue>>,
    /// The node's start was seen: bits nobody wrote since are clear.
    pub(super) is_fresh: bool,
}

/// A value as it came last.
#[derive(Debug, Clone, Copy)]
pub(super) struct SeenValue {
    pub(super) raw: i64,
    pub(super) time: i64,
    pub(super) frame: u64,
    /// The device itself sent it.
    pub(super) is_sent: bool,
}

/// What one rule remembers of a node.
#[derive(Debug, Clone, Default)]
pub(super) struct Course {
    /// `while` held when it was looked at last.
    pub(super) holds: bool,
    /// What an interval is counted from.
    pub(super) last: Option<Moment>,
    /// When it is to be looked at again.
    pub(super) deadline: Option<i64>,
    /// How many came, and the first of them.
    pub(super) count: u32,
    pub(super) first: u64,
    /// The counted stretch has a beginning.
    pub(super) is_counting: bool,
    /// Whether what must come first did; `None` while that is not known.
    pub(super) is_prepared: Option<bool>,
    /// The last ones, by object where each counts for itself.
    pub(super) recent: Vec<(Option<ObjectAddress>, VecDeque<Moment>)>,
}

/// Objects one rule counts by themselves; further ones are not judged.
const OBJECT_LIMIT: usize = 256;

impl Attached {
    pub(super) fn new(plan: &Arc<Plan>) -> Self {
        Self {
            plan: Arc::clone(plan),
            seen: Seen { values: vec![None; plan.watched_count()], is_fresh: false },
            courses: vec![Course::default(); plan.device.rules.len()],
            changes: Vec::new(),
            heard: None,
            is_present: false,
            scratch: Vec::new(),
        }
    }

    /// An output of the device changed its state.
    pub(super) fn changed(&mut self, channel: Option<u8>, now: i64) {
        match self.changes.iter_mut().find(|(known, _)| *known == channel) {
            Some((_, time)) => *time = now,
            None => self.changes.push((channel, now)),
        }
    }

    /// Whether an output, or any if none is named, changed its state within `settling`.
    pub(super) fn is_settling(&self, channel: Option<u8>, now: i64, settling: i64) -> bool {
        self.changes.iter().any(|(of, time)| {
            (channel.is_none() || of.is_none() || *of == channel) && now.saturating_sub(*time) <= settling
        })
    }

    /// The node starts anew, or with another number: what was measured and counted is void.
    pub(super) fn withdraw(&mut self) {
        for course in &mut self.courses {
            *course = Course { is_prepared: course.is_prepared, ..Course::default() };
        }
    }

    /// All traffic stopped, or frames were lost: no interval and no count goes across.
    pub(super) fn interrupted(&mut self) {
        for (course, rule) in self.courses.iter_mut().zip(&self.plan.device.rules) {
            if matches!(rule.kind, RuleKind::MinInterval | RuleKind::MaxInterval | RuleKind::MaxCount) {
                course.recent.clear();
                (course.last, course.count, course.is_counting) = (None, 0, false);
            }
        }
    }

    /// A PDO is set up anew: that it does not come tells nothing before it did.
    pub(super) fn set_up_anew(&mut self, name: PdoName) {
        for (course, rule) in self.courses.iter_mut().zip(&self.plan.device.rules) {
            if matches!(rule.kind, RuleKind::MaxInterval | RuleKind::Follow) && waits_for(rule, name) {
                (course.last, course.deadline, course.is_counting) = (None, None, false);
            }
        }
    }
}

impl Seen {
    /// The value at a place of the plan.
    pub(super) fn get(&self, place: usize) -> Option<SeenValue> {
        self.values.get(place).copied().flatten()
    }

    /// Takes a value; gives the one before.
    pub(super) fn put(&mut self, place: usize, value: SeenValue) {
        if let Some(known) = self.values.get_mut(place) {
            *known = Some(value);
        }
    }

    /// Nothing is known any more.
    pub(super) fn clear(&mut self) {
        self.values.fill(None);
        self.is_fresh = false;
    }

    /// Nothing is known any more of what the device itself sent.
    pub(super) fn forget_sent(&mut self) {
        for value in &mut self.values {
            value.take_if(|value| value.is_sent);
        }
    }
}

impl Course {
    /// The last ones of an object, or of all; `None` where too many objects came.
    pub(super) fn recent(&mut self, object: Option<ObjectAddress>) -> Option<&mut VecDeque<Moment>> {
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
}
