//! Which rules look at which values of a PDO or message, computed once per layout, so that a value that can change
//! nothing costs next to nothing.

use std::sync::Arc;

use super::plan::{RulePlan, triggers};
use crate::profile::device::{DeviceRule, RuleKind, Trigger, UpdateSource};
use crate::profile::{Cut, Field, Layout, integer};
use crate::wire::canopen::ObjectAddress;

/// What the rules of a node look at in a PDO or message.
#[derive(Debug)]
pub(super) struct CarrierPlan {
    pub(super) source: UpdateSource,
    pub(super) fields: Vec<WatchedField>,
    /// Rules that wait for the PDO or message itself.
    pub(super) rules: Vec<usize>,
}

/// A field whose value counts.
#[derive(Debug)]
pub(super) struct WatchedField {
    /// Its place in the layout.
    pub(super) field: usize,
    /// The place of its object in the plan.
    pub(super) place: usize,
    /// How it lies in eight bytes, where it does.
    cut: Option<Cut>,
    /// Conditions look at its values, which do not grow old.
    pub(super) decides: bool,
    /// Rules that judge its values.
    pub(super) clauses: Vec<Clause>,
    /// Rules whose `while` may hold or not hold from another value on.
    pub(super) stretches: Vec<usize>,
}

/// A rule that judges the values of a field.
#[derive(Debug, Clone, Copy)]
pub(super) struct Clause {
    pub(super) number: usize,
    /// It judges only where one of these bits changed; of none, each value.
    changed: Option<u64>,
}

/// A payload, and its first eight bytes as a number.
#[derive(Clone, Copy)]
pub(super) struct CarrierPayload<'a> {
    pub(super) layout: Option<&'a Layout>,
    pub(super) bytes: &'a [u8],
    word: u64,
}

impl<'a> CarrierPayload<'a> {
    /// Of the bytes of a message `length` count.
    #[inline]
    pub(super) fn new(layout: Option<&'a Arc<Layout>>, payload: &'a [u8], all: &[u8]) -> Self {
        let word = all.first_chunk().map_or(0, |bytes| u64::from_le_bytes(*bytes));
        Self { layout: layout.map(|layout| &**layout), bytes: payload, word }
    }
}

impl CarrierPlan {
    /// What rules look at of the values of a layout, and those that wait for what brings it.
    #[cold]
    pub(super) fn new(
        layout: Option<&Layout>,
        source: UpdateSource,
        rules: Vec<usize>,
        plan: &RulePlan,
    ) -> Self {
        let fields = layout.into_iter().flat_map(|layout| layout.fields.iter().enumerate());
        let fields = fields.filter_map(|(field, of)| WatchedField::new(field, of, source, plan)).collect();
        Self { source, fields, rules }
    }

    /// Whether there is nothing to look at.
    pub(super) fn is_empty(&self) -> bool {
        self.fields.is_empty() && self.rules.is_empty()
    }
}

impl WatchedField {
    fn new(field: usize, of: &Field, source: UpdateSource, plan: &RulePlan) -> Option<Self> {
        let object = of.object()?;
        let (place, watched) = plan.watched(object)?;
        let rules = watched.rules.iter();
        let clauses = rules.filter_map(|number| Clause::new(*number, plan.rule(*number)?.0, object, source));
        let is_followed = |number: &&usize| {
            let rule = plan.rule(**number).filter(|_| watched.is_condition);
            rule.is_some_and(|(rule, _)| plan.may_begin_or_end(rule, object))
        };
        Some(Self {
            field,
            place,
            cut: Cut::of(of),
            decides: watched.is_condition && !watched.is_measured,
            clauses: clauses.collect(),
            stretches: plan.stretches.iter().filter(is_followed).copied().collect(),
        })
    }

    /// The number in a payload, where it is one.
    #[inline]
    pub(super) fn number(&self, payload: &CarrierPayload<'_>) -> Option<i64> {
        match &self.cut {
            Some(cut) => cut.number(payload.word, payload.bytes.len()),
            None => self.other(payload),
        }
    }

    #[cold]
    fn other(&self, payload: &CarrierPayload<'_>) -> Option<i64> {
        let field = payload.layout?.fields.get(self.field)?;
        integer(&field.value(field.extract(payload.bytes)?))
    }
}

impl Clause {
    /// How a rule looks at values of an object from this source; `None` if it does not.
    fn new(number: usize, rule: &DeviceRule, object: ObjectAddress, source: UpdateSource) -> Option<Self> {
        let is_subject = rule.subjects().any(|of| of.object == object);
        let judges_all = match rule.kind {
            RuleKind::Limit => is_subject,
            RuleKind::Forbidden | RuleKind::Permitted => is_subject && source.is_command(),
            _ => false,
        };
        if judges_all {
            return Some(Self { number, changed: None });
        }
        let mut changed = 0;
        for trigger in triggers(rule) {
            match trigger {
                Trigger::Bit(bit, _) if bit.object.object == object => changed |= 1 << bit.bit,
                Trigger::Set(set) if set.object.object == object && source == UpdateSource::Received => {
                    if !set.changed {
                        return Some(Self { number, changed: None });
                    }
                    changed |= set.mask;
                }
                _ => {}
            }
        }
        (changed != 0).then_some(Self { number, changed: Some(changed) })
    }

    /// Whether the rule has something to judge of a value.
    #[inline]
    pub(super) fn judges(self, before: Option<i64>, raw: i64) -> bool {
        match (self.changed, before) {
            (Some(bits), Some(before)) => (before ^ raw).cast_unsigned() & bits != 0,
            _ => true,
        }
    }
}
