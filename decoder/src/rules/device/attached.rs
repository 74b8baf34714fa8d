//! What is remembered of one node for the rules of its device.

use std::collections::VecDeque;
use std::sync::Arc;

use super::carried::Load;
use super::dispatch::waits_for;
use super::happening::Way;
use super::plan::Plan;
use super::proofs::Proofs;
use crate::event::J1939Message;
use crate::profile::device::RuleKind;
use crate::profile::{Layout, PdoName};
use crate::wire::canopen::ObjectAddress;
use crate::wire::j1939::Pgn;

/// A time in the clock of the rules, and the frame that came then.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub(super) struct Moment {
    pub(super) time: i64,
    pub(super) frame: u64,
}

/// A node whose device has rules.
pub(super) struct Attached {
    pub(super) known: Known,
    /// What each rule remembers.
    pub(super) courses: Vec<Course>,
    /// Something of the node was seen.
    pub(super) is_present: bool,
    /// Room for the values of one PDO: before, and now.
    pub(super) scratch: Vec<(Option<i64>, Option<i64>)>,
    pub(super) loads: Loads,
}

/// What rules look at of the messages that came last.
#[derive(Debug, Default)]
pub(super) struct Loads(Vec<(Pgn, Option<Arc<Layout>>, Load)>);

/// Messages whose loads are kept.
const LOAD_LIMIT: usize = 64;

/// What all rules of a node see of it.
pub(super) struct Known {
    pub(super) plan: Arc<Plan>,
    pub(super) seen: Seen,
    pub(super) proofs: Proofs,
    /// When outputs of the device changed their state.
    changes: Vec<(Option<u8>, i64)>,
    /// When the node itself was heard last before the present event.
    pub(super) heard: Option<i64>,
}

/// Last values in PDOs and messages of the objects that count, by their places in the plan.
#[derive(Debug, Default)]
pub(super) struct Seen {
    values: Vec<Option<SeenValue>>,
    /// The node's start was seen: bits nobody wrote since are clear.
    pub(super) is_fresh: bool,
    /// Counts changes of values that conditions look at.
    pub(super) changes: u64,
    /// Changes of the node's store when such a value came last.
    stored: u64,
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
    /// When it will be woken next: a deadline that moves on asks for it once.
    pub(super) wake: Option<i64>,
    /// How many came, and the first of them.
    pub(super) count: u32,
    pub(super) first: u64,
    /// When the counted stretch began, if that was seen.
    pub(super) since: Option<i64>,
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
        let known = Known {
            plan: Arc::clone(plan),
            seen: Seen { values: vec![None; plan.watched_count()], ..Seen::default() },
            proofs: Proofs::new(plan),
            changes: Vec::new(),
            heard: None,
        };
        Self {
            known,
            courses: vec![Course::default(); plan.device.rules.len()],
            is_present: false,
            scratch: Vec::new(),
            loads: Loads::default(),
        }
    }

    /// The node starts anew, or with another number: what was measured and counted is void.
    pub(super) fn withdraw(&mut self) {
        self.loads = Loads::default();
        self.known.seen.changed();
        for course in &mut self.courses {
            *course = Course { is_prepared: course.is_prepared, ..Course::default() };
        }
    }

    /// All traffic stopped, or frames were lost: no interval and no count goes across.
    pub(super) fn interrupted(&mut self) {
        for (course, rule) in self.courses.iter_mut().zip(&self.known.plan.device.rules) {
            if matches!(rule.kind, RuleKind::MinInterval | RuleKind::MaxInterval | RuleKind::MaxCount) {
                course.recent.clear();
                (course.last, course.since, course.count, course.is_counting) = (None, None, 0, false);
            }
        }
    }

    /// A PDO is set up anew: that it does not come tells nothing before it did.
    pub(super) fn set_up_anew(&mut self, name: PdoName) {
        for (course, rule) in self.courses.iter_mut().zip(&self.known.plan.device.rules) {
            if matches!(rule.kind, RuleKind::MaxInterval | RuleKind::Follow) && waits_for(rule, name) {
                (course.last, course.deadline, course.is_counting) = (None, None, false);
            }
        }
    }
}

impl Loads {
    /// What rules look at of a message, where that is known.
    pub(super) fn take(&mut self, message: &J1939Message, way: Way) -> Option<Load> {
        let is_same = |known: &Option<Arc<Layout>>| match (known, &message.layout) {
            (Some(known), Some(layout)) => Arc::ptr_eq(known, layout),
            (None, None) => true,
            _ => false,
        };
        let place = self
            .0
            .iter()
            .position(|(pgn, layout, load)| *pgn == message.id.pgn && load.way == way && is_same(layout))?;
        Some(self.0.swap_remove(place).2)
    }

    pub(super) fn put(&mut self, message: &J1939Message, load: Load) {
        if self.0.len() >= LOAD_LIMIT {
            self.0.clear();
        }
        self.0.push((message.id.pgn, message.layout.clone(), load));
    }
}

impl Known {
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
}

impl Seen {
    /// The value at a place of the plan.
    pub(super) fn get(&self, place: usize) -> Option<SeenValue> {
        self.values.get(place).copied().flatten()
    }

    /// Its number.
    #[inline]
    pub(super) fn raw(&self, place: usize) -> Option<i64> {
        self.values.get(place)?.map(|value| value.raw)
    }

    /// A value that conditions look at came; whether it is another one. After a change of what the node holds it
    /// counts as one also where it is as before: it is the later one again.
    #[inline]
    pub(super) fn decides(&mut self, is_other: bool, stored: u64) {
        if is_other || self.stored != stored {
            self.changed();
            self.stored = stored;
        }
    }

    /// What conditions look at is not what it was.
    pub(super) fn changed(&mut self) {
        self.changes = self.changes.wrapping_add(1);
    }

    /// Takes a value.
    #[inline]
    pub(super) fn put(&mut self, place: usize, value: SeenValue) {
        if let Some(known) = self.values.get_mut(place) {
            *known = Some(value);
        }
    }

    /// Nothing is known any more.
    pub(super) fn clear(&mut self) {
        self.changed();
        self.values.fill(None);
        self.is_fresh = false;
    }

    /// Nothing is known any more of what the device itself sent.
    pub(super) fn forget_sent(&mut self) {
        self.changed();
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
