//! State of the device rules at one node.

use std::sync::Arc;

use super::carrier::CarrierPlan;
use super::plan::{RulePlan, waits_for};
use super::progress::RuleProgress;
use super::proofs::RuleProofs;
use crate::event::J1939Message;
use crate::profile::device::{RuleKind, UpdateSource};
use crate::profile::{Layout, PdoName};
use crate::wire::j1939::Pgn;

/// State of a node with device rules.
pub(super) struct NodeRules {
    pub(super) record: NodeRecord,
    /// State of each rule, in the order of the profile.
    pub(super) progress: Vec<RuleProgress>,
    /// Whether the node has sent a frame.
    pub(super) is_present: bool,
    /// Buffer for the values of one PDO: previous and current.
    pub(super) scratch: Vec<(Option<i64>, Option<i64>)>,
    pub(super) carriers: CarrierPlans,
}

/// Cached dispatch tables of recent messages.
#[derive(Debug, Default)]
pub(super) struct CarrierPlans(Vec<(Pgn, Option<Arc<Layout>>, CarrierPlan)>);

/// Maximum number of cached dispatch tables.
const CARRIER_LIMIT: usize = 64;

/// State of a node shared by all its rules.
pub(super) struct NodeRecord {
    pub(super) plan: Arc<RulePlan>,
    pub(super) last: LastValues,
    pub(super) proofs: RuleProofs,
    /// Time of the last state change, by output of the device.
    changes: Vec<(Option<u8>, i64)>,
    /// Time of the node's last frame before the current event.
    pub(super) heard: Option<i64>,
    /// Time of the node's first frame.
    pub(super) present: Option<i64>,
}

/// Last values in PDOs and messages, by object index in the plan.
#[derive(Debug, Default)]
pub(super) struct LastValues {
    values: Vec<Option<LastValue>>,
    /// The boot-up was seen: bits not written since then are 0.
    pub(super) is_fresh: bool,
    /// Number of value changes that conditions use.
    pub(super) changes: u64,
    /// Change count of the node's store at the last such value.
    stored: u64,
}

/// Last value of an object.
#[derive(Debug, Clone, Copy)]
pub(super) struct LastValue {
    pub(super) raw: i64,
    pub(super) time: i64,
    pub(super) frame: u64,
    /// The device itself sent the value.
    pub(super) is_sent: bool,
}

impl NodeRules {
    pub(super) fn new(plan: &Arc<RulePlan>) -> Self {
        let record = NodeRecord {
            plan: Arc::clone(plan),
            last: LastValues { values: vec![None; plan.watched_count()], ..LastValues::default() },
            proofs: RuleProofs::new(plan),
            changes: Vec::new(),
            heard: None,
            present: None,
        };
        Self {
            record,
            progress: vec![RuleProgress::default(); plan.device.rules.len()],
            is_present: false,
            scratch: Vec::new(),
            carriers: CarrierPlans::default(),
        }
    }

    /// Clears all measurements and counts after a restart or a change of the node-ID.
    pub(super) fn reset(&mut self) {
        self.carriers = CarrierPlans::default();
        self.record.last.count_change();
        self.progress.iter_mut().for_each(RuleProgress::reset);
    }

    /// Interrupts all intervals, counts and orders after a silence or lost frames.
    pub(super) fn interrupt(&mut self) {
        for (progress, rule) in self.progress.iter_mut().zip(&self.record.plan.device.rules) {
            if matches!(rule.kind, RuleKind::MinInterval | RuleKind::MaxInterval | RuleKind::MaxCount) {
                progress.interrupt();
            }
            // The event that must come first may be in the gap.
            if rule.kind == RuleKind::Order && progress.is_prepared == Some(false) {
                progress.is_prepared = None;
            }
        }
    }

    /// Handles the reconfiguration of a PDO: its absence proves nothing until it occurs again.
    pub(super) fn reconfigure(&mut self, name: PdoName) {
        for (progress, rule) in self.progress.iter_mut().zip(&self.record.plan.device.rules) {
            if matches!(rule.kind, RuleKind::MaxInterval | RuleKind::Follow) && waits_for(rule, name) {
                (progress.last, progress.deadline, progress.is_counting) = (None, None, false);
            }
        }
    }
}

impl CarrierPlans {
    /// Removes and returns the dispatch table of a message.
    pub(super) fn take(&mut self, message: &J1939Message, source: UpdateSource) -> Option<CarrierPlan> {
        let is_same = |known: &Option<Arc<Layout>>| match (known, &message.layout) {
            (Some(known), Some(layout)) => Arc::ptr_eq(known, layout),
            (None, None) => true,
            _ => false,
        };
        let place = self.0.iter().position(|(pgn, layout, plan)| {
            *pgn == message.id.pgn && plan.source == source && is_same(layout)
        })?;
        Some(self.0.swap_remove(place).2)
    }

    pub(super) fn put(&mut self, message: &J1939Message, plan: CarrierPlan) {
        if self.0.len() >= CARRIER_LIMIT {
            self.0.clear();
        }
        self.0.push((message.id.pgn, message.layout.clone(), plan));
    }
}

impl NodeRecord {
    /// Records a state change of an output.
    pub(super) fn note_change(&mut self, channel: Option<u8>, now: i64) {
        match self.changes.iter_mut().find(|(known, _)| *known == channel) {
            Some((_, time)) => *time = now,
            None => self.changes.push((channel, now)),
        }
    }

    /// Whether an output (any output if None) changed its state within `settling`.
    pub(super) fn is_settling(&self, channel: Option<u8>, now: i64, settling: i64) -> bool {
        self.changes.iter().any(|(of, time)| {
            (channel.is_none() || of.is_none() || *of == channel) && now.saturating_sub(*time) <= settling
        })
    }
}

impl LastValues {
    /// Last value by object index in the plan.
    pub(super) fn get(&self, place: usize) -> Option<LastValue> {
        self.values.get(place).copied().flatten()
    }

    /// Last raw value by object index in the plan.
    #[inline]
    pub(super) fn raw(&self, place: usize) -> Option<i64> {
        self.values.get(place)?.map(|value| value.raw)
    }

    /// Counts a value change that conditions use. After a change of the node's store, an equal value counts
    /// too, since it is newer than the stored one.
    #[inline]
    pub(super) fn count_value(&mut self, is_other: bool, stored: u64) {
        if is_other || self.stored != stored {
            self.count_change();
            self.stored = stored;
        }
    }

    fn count_change(&mut self) {
        self.changes = self.changes.wrapping_add(1);
    }

    #[inline]
    pub(super) fn put(&mut self, place: usize, value: LastValue) {
        if let Some(known) = self.values.get_mut(place) {
            *known = Some(value);
        }
    }

    pub(super) fn clear(&mut self) {
        self.count_change();
        self.values.fill(None);
        self.is_fresh = false;
    }

    /// Removes values sent by the device itself.
    pub(super) fn forget_sent(&mut self) {
        self.count_change();
        for value in &mut self.values {
            value.take_if(|value| value.is_sent);
        }
    }
}
