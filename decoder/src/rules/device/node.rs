//! State of the device rules at one node.

use std::sync::Arc;

use super::carrier::CarrierPlan;
use super::plan::{RulePlan, waits_for};
use super::progress::RuleProgress;
use super::proofs::RuleProofs;
use super::values::LastValues;
use crate::event::J1939Message;
use crate::profile::device::{RuleKind, UpdateSource};
use crate::profile::{PayloadLayout, PdoName};
use crate::wire::j1939::Pgn;

/// State of a node with device rules.
pub(super) struct NodeRules {
    pub(super) record: JudgedNode,
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
pub(super) struct CarrierPlans(Vec<(Pgn, Option<Arc<PayloadLayout>>, CarrierPlan)>);

/// Maximum number of cached dispatch tables.
const CARRIER_LIMIT: usize = 64;

/// State of a node shared by all its rules.
pub(super) struct JudgedNode {
    pub(super) plan: Arc<RulePlan>,
    pub(super) last: LastValues,
    pub(super) proofs: RuleProofs,
    /// Time of the last state change, by output of the device.
    changes: Vec<(Option<u8>, i64)>,
    /// Time of the node's last frame before the current event.
    pub(super) received: Option<i64>,
    /// Time of the node's first frame.
    pub(super) present: Option<i64>,
}

impl NodeRules {
    pub(super) fn new(plan: &Arc<RulePlan>) -> Self {
        let record = JudgedNode {
            plan: Arc::clone(plan),
            last: LastValues::new(plan.watched_count()),
            proofs: RuleProofs::new(plan),
            changes: Vec::new(),
            received: None,
            present: None,
        };
        Self {
            record,
            progress: vec![RuleProgress::default(); plan.places.len()],
            is_present: false,
            scratch: Vec::new(),
            carriers: CarrierPlans::default(),
        }
    }

    /// Clears all measurements and counts after a restart or a change of the node-ID.
    pub(super) fn reset_measurements(&mut self) {
        self.carriers = CarrierPlans::default();
        self.record.last.count_change();
        self.progress.iter_mut().for_each(RuleProgress::reset_after_restart);
    }

    /// Interrupts all intervals, counts and orders after a silence or lost frames.
    pub(super) fn interrupt_measurements(&mut self) {
        for (progress, rule) in self.progress.iter_mut().zip(self.record.plan.all_rules()) {
            if matches!(rule.kind, RuleKind::MinInterval | RuleKind::MaxInterval | RuleKind::MaxCount) {
                progress.interrupt_intervals();
            }
            // The event that must come first may be in the gap.
            if rule.kind == RuleKind::Order && progress.is_prepared == Some(false) {
                progress.is_prepared = None;
            }
        }
    }

    /// Handles the reconfiguration of a PDO: its absence proves nothing until it occurs again.
    pub(super) fn on_reconfiguration(&mut self, name: PdoName) {
        for (progress, rule) in self.progress.iter_mut().zip(self.record.plan.all_rules()) {
            if matches!(rule.kind, RuleKind::MaxInterval | RuleKind::Follow) && waits_for(rule, name) {
                (progress.last, progress.deadline, progress.is_counting) = (None, None, false);
            }
        }
    }
}

impl CarrierPlans {
    /// Removes and returns the dispatch table of a message.
    pub(super) fn take_plan(&mut self, message: &J1939Message, source: UpdateSource) -> Option<CarrierPlan> {
        let is_same = |known: &Option<Arc<PayloadLayout>>| match (known, &message.layout) {
            (Some(known), Some(layout)) => Arc::ptr_eq(known, layout),
            (None, None) => true,
            _ => false,
        };
        let place = self.0.iter().position(|(pgn, layout, plan)| {
            *pgn == message.id.pgn && plan.source == source && is_same(layout)
        })?;
        Some(self.0.swap_remove(place).2)
    }

    pub(super) fn put_plan(&mut self, message: &J1939Message, plan: CarrierPlan) {
        if self.0.len() >= CARRIER_LIMIT {
            self.0.clear();
        }
        self.0.push((message.id.pgn, message.layout.clone(), plan));
    }
}

impl JudgedNode {
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
