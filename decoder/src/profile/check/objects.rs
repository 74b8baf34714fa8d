//! Checks of objects: types, ranges, names of values and bits, scales, duplicates, cycles.

use std::collections::BTreeSet;
use std::ops::Range;

use super::{ProfileCheck, is_kebab};
use crate::profile::data_type::DataType;
use crate::profile::dictionary::Dictionary;
use crate::profile::entry::{ObjectEntry, SubEntry};
use crate::profile::formula::evaluate_formula;
use crate::profile::names::{BitNames, ValueNames};
use crate::profile::object::{DefaultValue, ObjectCondition, ObjectRole, RawScale, ValueInterpretation};
use crate::wire::canopen::ObjectAddress;

impl ProfileCheck<'_> {
    pub(super) fn check_objects(&mut self, objects: &[ObjectEntry]) {
        for object in objects {
            self.check_variants(&object.only, &object.span);
            for entry in &object.entries {
                self.check_variants(&entry.only, &entry.span);
                self.check_entry(object, entry);
            }
        }
    }

    fn check_entry(&mut self, object: &ObjectEntry, entry: &SubEntry) {
        let Some(data_type) = entry.data_type else {
            let plain = entry.look
                == ValueInterpretation { name: entry.look.name.clone(), ..ValueInterpretation::default() };
            if !plain || entry.default.is_some() {
                self.report_problem(&entry.span, "type is missing; expected a data type");
            }
            return;
        };
        self.check_interpretation(object, entry, &entry.look, data_type);
        for (when, look) in &entry.modes {
            self.check_interpretation(object, entry, look, data_type);
            self.check_condition_keys(object, entry, when);
        }
        if let Some(DefaultValue::Number(default)) = entry.default {
            self.check_number(default, data_type, "default", &entry.span);
            if let Some([least, most]) = entry.look.range
                && !(least..=most).contains(&default)
            {
                self.report_problem(
                    &entry.span,
                    format!("default {default} is outside range {least} to {most}"),
                );
            }
        }
        if let Some(DefaultValue::Text(text)) = &entry.default
            && data_type.is_integer()
        {
            self.check_formula(text, data_type, &entry.span);
        }
        if let Some(save) = entry.save {
            self.check_known(save, &entry.span, "save");
        }
        self.open_loop(entry, data_type);
    }

    fn open_loop(&mut self, entry: &SubEntry, data_type: DataType) {
        if !entry.open_loop.is_empty()
            && !matches!(entry.look.role, Some(ObjectRole::Mode | ObjectRole::Control | ObjectRole::Status))
        {
            self.report_problem(&entry.span, "open_loop requires role = \"mode\", \"control\" or \"status\"");
        }
        for value in &entry.open_loop {
            self.check_number(*value, data_type, "open_loop", &entry.span);
            if entry.look.values.as_ref().is_some_and(|names| names.get(*value).is_none()) {
                self.report_problem(&entry.span, format!("open_loop {value} is not in values"));
            }
        }
    }

    /// Checks a default that depends on the node-ID, with the largest node-ID 127.
    fn check_formula(&mut self, text: &str, data_type: DataType, span: &Range<usize>) {
        let bits = u32::from(data_type.bits().unwrap_or(64));
        match evaluate_formula(text, Some(127)) {
            None => self.report_problem(
                span,
                format!("default '{text}' is not a number; expected e.g. 5 or \"$NODEID+0x200\""),
            ),
            Some(most) if most > u64::MAX >> (64 - bits) => {
                self.report_problem(span, format!("default {text} does not fit {}", data_type.name()));
            }
            Some(_) => {}
        }
    }

    fn check_interpretation(
        &mut self,
        object: &ObjectEntry,
        entry: &SubEntry,
        look: &ValueInterpretation,
        data_type: DataType,
    ) {
        let span = &entry.span;
        if let Some([least, most]) = look.range {
            self.check_number(least, data_type, "range", span);
            self.check_number(most, data_type, "range", span);
        }
        self.check_ascending(look.range, look.limits, span);
        for (key, names) in [("values", &look.values), ("special", &look.special)] {
            self.check_names(names.as_deref(), data_type, key, span);
        }
        if let Some(bits) = &look.bits {
            self.check_bits(bits, data_type, span);
        }
        match look.scale {
            Some(RawScale::Factor(0.0)) => self.report_problem(span, "scale is 0; expected another factor"),
            Some(RawScale::Anchor { raw, value }) if raw == 0.0 || value == 0.0 => {
                self.report_problem(span, "raw or value of the scale is 0; expected other numbers");
            }
            Some(RawScale::Reciprocal { reciprocal: 0.0 }) => {
                self.report_problem(span, "reciprocal is 0; expected the value of raw number 1");
            }
            Some(RawScale::ByObject { object: by, .. }) => self.check_reference(by, object, span, "scale"),
            _ => {}
        }
        if let Some(of) = look.of {
            self.check_reference(of, object, span, "of");
        }
    }

    fn check_condition_keys(&mut self, object: &ObjectEntry, entry: &SubEntry, when: &ObjectCondition) {
        self.check_reference(when.object, object, &entry.span, "when");
    }

    /// Checks that range and limits are in ascending order.
    pub(super) fn check_ascending(
        &mut self,
        range: Option<[i64; 2]>,
        limits: Option<[f64; 2]>,
        span: &Range<usize>,
    ) {
        if let Some([least, most]) = range.filter(|[least, most]| least > most) {
            self.report_problem(span, format!("range {least} to {most}; expected the minimum first"));
        }
        if let Some([least, most]) = limits.filter(|[least, most]| least > most) {
            self.report_problem(span, format!("limits {least} to {most}; expected the minimum first"));
        }
    }

    pub(super) fn check_number(&mut self, number: i64, data_type: DataType, key: &str, span: &Range<usize>) {
        if !fits_type(number, data_type) {
            self.report_problem(span, format!("{key} {number} does not fit {}", data_type.name()));
        }
    }

    pub(super) fn check_names(
        &mut self,
        names: Option<&ValueNames>,
        data_type: DataType,
        key: &str,
        span: &Range<usize>,
    ) {
        for value in names.into_iter().flat_map(|names| names.0.keys()) {
            self.check_number(*value, data_type, key, span);
        }
    }

    fn check_bits(&mut self, bits: &BitNames, data_type: DataType, span: &Range<usize>) {
        let width = u32::from(data_type.bits().unwrap_or(64));
        let mut taken: u64 = 0;
        for bit in &bits.list {
            let end = u32::from(bit.bit) + u32::from(bit.width);
            if bit.width == 0 || end > width {
                let name = data_type.name();
                self.report_problem(
                    span,
                    format!("bits {} to {} do not fit {name}", bit.bit, end.saturating_sub(1)),
                );
                continue;
            }
            let mask = (u64::MAX >> (64 - u32::from(bit.width))) << bit.bit;
            if taken & mask != 0 {
                self.report_problem(
                    span,
                    format!("duplicate entry for bit {}", (taken & mask).trailing_zeros()),
                );
            }
            if bit.name.is_empty() && !bit.reserved {
                self.report_problem(
                    span,
                    format!("bit {} has no name; expected a name or reserved = true", bit.bit),
                );
            } else if !bit.name.is_empty() && !is_kebab(&bit.name) {
                let message = format!("invalid bit name '{}'; expected a-z, 0-9 and hyphens", bit.name);
                self.report_problem(span, message);
            }
            taken |= mask;
        }
    }

    pub(super) fn check_duplicates(&mut self, objects: &[ObjectEntry]) {
        let mut seen = BTreeSet::new();
        for object in objects {
            for nth in 0..object.repeat.count {
                let index = object.index.wrapping_add(nth.wrapping_mul(object.repeat.stride));
                for entry in &object.entries {
                    for sub in entry.sub..=entry.to {
                        if !seen.insert((index, sub)) {
                            let address = ObjectAddress::new(index, sub);
                            self.report_problem(&entry.span, format!("duplicate entry for {address}"));
                        }
                    }
                }
            }
        }
    }

    pub(super) fn check_cycles(&mut self, objects: &[ObjectEntry]) {
        for object in objects {
            for entry in &object.entries {
                let start = ObjectAddress::new(object.index, entry.sub);
                if leads_back(&self.device.dictionary, start) {
                    self.report_problem(&entry.span, format!("the scale of {start} depends on itself"));
                }
            }
        }
    }
}

/// Whether a raw number fits the type; false for types without a fixed length, always true for floats.
pub(super) fn fits_type(number: i64, data_type: DataType) -> bool {
    let Some(bits) = data_type.bits() else { return false };
    let number = i128::from(number);
    match data_type {
        DataType::Real32 | DataType::Real64 => true,
        _ if data_type.is_signed() => {
            let limit = 1_i128 << (bits - 1);
            (-limit..limit).contains(&number)
        }
        _ => (0..1_i128 << bits).contains(&number),
    }
}

/// Whether the scales form a cycle through the object `start`.
fn leads_back(dictionary: &Dictionary, start: ObjectAddress) -> bool {
    let mut open = vec![start];
    let mut seen = Vec::new();
    while let Some(address) = open.pop() {
        let Some(found) = dictionary.find_object(address) else { continue };
        let Some(entry) = found.entry else { continue };
        let looks = std::iter::once(&entry.look).chain(entry.modes.iter().map(|(_, look)| look));
        for look in looks {
            let Some(RawScale::ByObject { object, .. }) = look.scale else { continue };
            let next = found.shift_reference(object);
            if next == start {
                return true;
            }
            if !seen.contains(&next) {
                seen.push(next);
                open.push(next);
            }
        }
    }
    false
}
