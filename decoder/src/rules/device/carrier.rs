//! Dispatch table from the fields of a PDO or message to rules, computed once per layout. Values that no rule
//! uses cost almost no time.

use std::sync::Arc;

use super::plan::{RulePlan, rule_triggers};
use crate::profile::device::{DeviceRule, ProfileTrigger, RuleKind, UpdateSource};
use crate::profile::object::NumberList;
use crate::profile::{FixedBits, IntegerPosition, PayloadLayout, SignalField, as_integer};
use crate::wire::canopen::ObjectAddress;

/// Fields and rules that matter for a PDO or message.
#[derive(Debug)]
pub(super) struct CarrierPlan {
    pub(super) source: UpdateSource,
    pub(super) fields: Vec<RuleField>,
    /// Rules that trigger on the PDO or message itself.
    pub(super) rules: Vec<usize>,
    /// Rules about events that must not occur, with which a value or the message is compared.
    pub(super) forbidding: Vec<usize>,
    /// Bits with a fixed content, and the rules about them.
    pub(super) fixed: FixedBits,
    pub(super) constants: Vec<usize>,
    /// The fixed bits depend on an assumed mapping.
    pub(super) is_fixed_assumed: bool,
    /// Bits whose change concerns conditions, or rules that check changes; `None` if the values cannot be read from the
    /// first eight bytes on demand.
    pub(super) watched: Option<u64>,
}

/// Evidence for the place of a field in a PDO or message.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum FieldEvidence {
    Unknown,
    /// Default of the profile, which nothing contradicts.
    Assumed,
    Certain,
}

/// A field that at least one rule uses.
#[derive(Debug)]
pub(super) struct RuleField {
    /// Index of the field in the layout.
    pub(super) field: usize,
    /// Index of the object in the rule plan.
    pub(super) place: usize,
    /// Fast extraction from the first eight bytes, if possible.
    pub(super) cut: Option<IntegerPosition>,
    /// The place of the field is assumed: its value proves no condition.
    pub(super) is_assumed: bool,
    /// Conditions use the value, and it never expires.
    pub(super) decides: bool,
    /// Rules that check the value.
    pub(super) clauses: Vec<FieldClause>,
    /// Rules whose `while` depends on the value.
    pub(super) stretches: Vec<usize>,
}

/// Use of a field value by a rule.
#[derive(Debug, Clone, Copy)]
pub(super) struct FieldClause {
    pub(super) number: usize,
    /// Bits that must change for a check; None: every value is checked.
    changed: Option<u64>,
    /// Bits of which one must be set for a check; 0: no condition.
    set: u64,
}

/// A payload, and its first eight bytes as a number.
#[derive(Clone, Copy)]
pub(super) struct CarrierPayload<'a> {
    pub(super) layout: Option<&'a PayloadLayout>,
    pub(super) bytes: &'a [u8],
    pub(super) word: u64,
}

impl<'a> CarrierPayload<'a> {
    /// `payload` is the part of `all` that belongs to the message.
    #[inline]
    pub(super) fn new(layout: Option<&'a Arc<PayloadLayout>>, payload: &'a [u8], all: &[u8]) -> Self {
        let word = all.first_chunk().map_or(0, |bytes| u64::from_le_bytes(*bytes));
        Self { layout: layout.map(|layout| &**layout), bytes: payload, word }
    }
}

impl CarrierPlan {
    /// Builds the table for the fields of a layout with a known or assumed place; `rules` trigger on the PDO or message
    /// itself.
    #[cold]
    pub(super) fn new(
        layout: Option<&PayloadLayout>,
        evidence: &dyn Fn(&SignalField) -> FieldEvidence,
        source: UpdateSource,
        rules: Vec<usize>,
        plan: &RulePlan,
    ) -> Self {
        let fields = layout.into_iter().flat_map(|layout| layout.fields.iter().enumerate());
        let fields = fields.filter_map(|(field, of)| match evidence(of) {
            FieldEvidence::Certain => RuleField::new(field, of, source, plan),
            FieldEvidence::Assumed => RuleField::new(field, of, source, plan)?.only_assumed(),
            FieldEvidence::Unknown => None,
        });
        let fields: Vec<_> = fields.collect();
        let watched = watched_bits(&fields);
        let is_forbidden = |number: &usize| {
            rules.contains(number)
                || fields.iter().any(|field| field.clauses.iter().any(|clause| clause.number == *number))
        };
        let forbidding = plan.forbidding.iter().copied().filter(is_forbidden).collect();
        let (fixed, constants, is_fixed_assumed) = (FixedBits::default(), Vec::new(), false);
        Self { source, fields, rules, forbidding, fixed, constants, is_fixed_assumed, watched }
    }

    /// Adds the rules about bits with a fixed content.
    pub(super) fn with_constants(
        mut self,
        (layout, is_assumed): (Option<&PayloadLayout>, bool),
        rules: Vec<usize>,
    ) -> Self {
        if let Some(layout) = layout.filter(|layout| layout.fixed.mask != 0 && !rules.is_empty()) {
            (self.fixed, self.constants, self.is_fixed_assumed) = (layout.fixed, rules, is_assumed);
        }
        self
    }

    /// Whether no rule uses the PDO or message.
    pub(super) fn is_empty(&self) -> bool {
        self.fields.is_empty() && self.rules.is_empty() && self.constants.is_empty()
    }
}

/// See [`CarrierPlan::watched`].
fn watched_bits(fields: &[RuleField]) -> Option<u64> {
    let mut watched = 0;
    for (place, field) in fields.iter().enumerate() {
        let bits = field.cut?.bits();
        let is_repeated = fields.iter().take(place).any(|other| other.place == field.place);
        if is_repeated {
            return None;
        }
        let checks_changes = field.clauses.iter().any(|clause| clause.changed.is_some());
        if checks_changes || field.decides || !field.stretches.is_empty() {
            watched |= bits;
        }
    }
    Some(watched)
}

impl RuleField {
    fn new(field: usize, of: &SignalField, source: UpdateSource, plan: &RulePlan) -> Option<Self> {
        let object = of.object()?;
        let (place, watched) = plan.watched_object(object)?;
        let rules = watched.rules.iter();
        let clauses = rules
            .filter_map(|number| FieldClause::new(*number, plan.active_rule(*number)?.0, object, source));
        let is_followed = |number: &&usize| {
            let rule = plan.active_rule(**number).filter(|_| watched.is_condition);
            rule.is_some_and(|(rule, _)| plan.may_begin_or_end(rule, object))
        };
        Some(Self {
            field,
            place,
            cut: IntegerPosition::position_of(of),
            is_assumed: false,
            decides: watched.is_condition && !watched.is_measured,
            clauses: clauses.collect(),
            stretches: plan.stretches.iter().filter(is_followed).copied().collect(),
        })
    }

    /// The field for an assumed place: only rules that check each value on its own use it.
    fn only_assumed(mut self) -> Option<Self> {
        self.clauses.retain(|clause| clause.is_for_each());
        (self.is_assumed, self.decides, self.stretches) = (true, false, Vec::new());
        (!self.clauses.is_empty()).then_some(self)
    }

    /// Value of the field if it is numeric.
    #[inline]
    pub(super) fn field_number(&self, payload: &CarrierPayload<'_>) -> Option<i64> {
        match &self.cut {
            Some(cut) => cut.number(payload.word, payload.bytes.len()),
            None => self.other_number(payload),
        }
    }

    #[cold]
    fn other_number(&self, payload: &CarrierPayload<'_>) -> Option<i64> {
        let field = payload.layout?.fields.get(self.field)?;
        as_integer(&field.convert_raw(field.extract_bits(payload.bytes)?))
    }
}

impl FieldClause {
    /// Use of an object by a rule, for values from this source; None if the rule ignores them.
    fn new(number: usize, rule: &DeviceRule, object: ObjectAddress, source: UpdateSource) -> Option<Self> {
        let is_subject = rule.rule_objects().any(|of| of.object == object);
        let judges_all = match rule.kind {
            RuleKind::Limit => is_subject,
            RuleKind::Forbidden | RuleKind::Permitted => is_subject && source.is_command(),
            _ => false,
        };
        if judges_all {
            return Some(Self { number, changed: None, set: 0 });
        }
        if let Some(set) = proving_bits(rule, object, source) {
            return Some(Self { number, changed: None, set });
        }
        let mut changed = 0;
        for trigger in rule_triggers(rule) {
            match trigger {
                ProfileTrigger::Bit(bit, _) if bit.object.object == object => changed |= 1 << bit.bit,
                ProfileTrigger::Set(set)
                    if set.object.object == object && source == UpdateSource::Received =>
                {
                    changed |= set.mask;
                }
                _ => {}
            }
        }
        (changed != 0).then_some(Self { number, changed: Some(changed), set: 0 })
    }

    /// Whether the rule checks values that are not changed, too.
    pub(super) const fn is_for_each(self) -> bool {
        self.changed.is_none()
    }

    /// Whether the rule must check a value.
    #[inline]
    pub(super) fn needs_check(self, before: Option<i64>, raw: i64) -> bool {
        if self.set != 0 {
            return raw.cast_unsigned() & self.set != 0;
        }
        match (self.changed, before) {
            (Some(bits), Some(before)) => (before ^ raw).cast_unsigned() & bits != 0,
            _ => true,
        }
    }
}

/// Bits of which one must be set in a value that a rule checks, changed or not; 0 if it checks all values. None if
/// it checks changes only.
///
/// Bits are known if the only trigger on the object excludes 0.
fn proving_bits(rule: &DeviceRule, object: ObjectAddress, source: UpdateSource) -> Option<u64> {
    let of_object = |trigger: &&ProfileTrigger| match trigger {
        ProfileTrigger::Set(set) => source == UpdateSource::Received && set.object.object == object,
        ProfileTrigger::Shows(set) => source == UpdateSource::Sent && set.object.object == object,
        ProfileTrigger::Bit(bit, _) => bit.object.object == object,
        _ => false,
    };
    let mut matching = rule_triggers(rule).filter(of_object);
    let (first, is_only) = (matching.next()?, matching.next().is_none());
    let is_each = |trigger: &ProfileTrigger| matches!(trigger, ProfileTrigger::Set(set) | ProfileTrigger::Shows(set) if !set.changed);
    match first {
        ProfileTrigger::Set(set) | ProfileTrigger::Shows(set) if is_only && !set.changed => {
            let is_nonzero = set.negated && set.values == Some(NumberList::One(0));
            Some(if is_nonzero { set.mask } else { 0 })
        }
        _ => rule_triggers(rule).filter(of_object).any(is_each).then_some(0),
    }
}
