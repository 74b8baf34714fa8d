//! Objects of a profile: types, ranges, names of values and bits, scales, duplicates, cycles.

use std::collections::BTreeSet;
use std::ops::Range;

use super::{Check, is_kebab};
use crate::profile::data_type::DataType;
use crate::profile::dictionary::{Dictionary, Entry, Object};
use crate::profile::formula::formula;
use crate::profile::names::{BitNames, Names};
use crate::profile::object::{Given, Look, Role, Scale, When};
use crate::wire::canopen::ObjectAddress;

impl Check<'_> {
    pub(super) fn objects(&mut self, objects: &[Object]) {
        for object in objects {
            self.only(&object.only, &object.span);
            for entry in &object.entries {
                self.only(&entry.only, &entry.span);
                self.entry(object, entry);
            }
        }
    }

    fn entry(&mut self, object: &Object, entry: &Entry) {
        let Some(data_type) = entry.data_type else {
            let plain = entry.look == Look { name: entry.look.name.clone(), ..Look::default() };
            if !plain || entry.default.is_some() {
                self.say(&entry.span, "a value that is described needs its type");
            }
            return;
        };
        self.look(object, entry, &entry.look, data_type);
        for (when, look) in &entry.modes {
            self.look(object, entry, look, data_type);
            self.when(object, entry, when);
        }
        if let Some(Given::Number(default)) = entry.default {
            self.number(default, data_type, "default", &entry.span);
            if let Some([least, most]) = entry.look.range
                && !(least..=most).contains(&default)
            {
                self.say(&entry.span, format!("default {default} lies outside range {least} to {most}"));
            }
        }
        if let Some(Given::Text(text)) = &entry.default
            && data_type.is_integer()
        {
            self.formula(text, data_type, &entry.span);
        }
        if let Some(save) = entry.save {
            self.known(save, &entry.span, "save");
        }
        self.open_loop(entry, data_type);
    }

    fn open_loop(&mut self, entry: &Entry, data_type: DataType) {
        if !entry.open_loop.is_empty() && entry.look.role != Some(Role::Mode) {
            self.say(&entry.span, "open_loop stands at a mode: role = \"mode\"");
        }
        for value in &entry.open_loop {
            self.number(*value, data_type, "open_loop", &entry.span);
            if entry.look.values.as_ref().is_some_and(|names| names.get(*value).is_none()) {
                self.say(&entry.span, format!("open_loop {value} is none of its values"));
            }
        }
    }

    /// A default that depends on the node-ID; that of node 127 is the largest.
    fn formula(&mut self, text: &str, data_type: DataType, span: &Range<usize>) {
        let bits = u32::from(data_type.bits().unwrap_or(64));
        match formula(text, Some(127)) {
            None => self.say(span, format!("default '{text}' is no number: write 5 or \"$NODEID+0x200\"")),
            Some(most) if most > u64::MAX >> (64 - bits) => {
                self.say(span, format!("default {text} does not fit {}", data_type.name()));
            }
            Some(_) => {}
        }
    }

    fn look(&mut self, object: &Object, entry: &Entry, look: &Look, data_type: DataType) {
        let span = &entry.span;
        if let Some([least, most]) = look.range {
            self.number(least, data_type, "range", span);
            self.number(most, data_type, "range", span);
        }
        self.ascends(look.range, look.limits, span);
        for (key, names) in [("values", &look.values), ("special", &look.special)] {
            self.names(names.as_deref(), data_type, key, span);
        }
        if let Some(bits) = &look.bits {
            self.bits(bits, data_type, span);
        }
        match look.scale {
            Some(Scale::Factor(0.0)) => self.say(span, "scale is 0"),
            Some(Scale::Anchor { raw, value }) if raw == 0.0 || value == 0.0 => {
                self.say(span, "raw and value of a scale are not 0");
            }
            Some(Scale::ByObject { object: by, .. }) => self.reference(by, object, span, "scale"),
            _ => {}
        }
        if let Some(of) = look.of {
            self.reference(of, object, span, "of");
        }
    }

    fn when(&mut self, object: &Object, entry: &Entry, when: &When) {
        self.reference(when.object, object, &entry.span, "when");
    }

    /// A range, or limits, from the least to the most.
    pub(super) fn ascends(&mut self, range: Option<[i64; 2]>, limits: Option<[f64; 2]>, span: &Range<usize>) {
        if let Some([least, most]) = range.filter(|[least, most]| least > most) {
            self.say(span, format!("range {least} to {most} ends before it begins"));
        }
        if let Some([least, most]) = limits.filter(|[least, most]| least > most) {
            self.say(span, format!("limits {least} to {most} end before they begin"));
        }
    }

    pub(super) fn number(&mut self, number: i64, data_type: DataType, key: &str, span: &Range<usize>) {
        if !fits(number, data_type) {
            self.say(span, format!("{key} {number} does not fit {}", data_type.name()));
        }
    }

    pub(super) fn names(
        &mut self,
        names: Option<&Names>,
        data_type: DataType,
        key: &str,
        span: &Range<usize>,
    ) {
        for value in names.into_iter().flat_map(|names| names.0.keys()) {
            self.number(*value, data_type, key, span);
        }
    }

    fn bits(&mut self, bits: &BitNames, data_type: DataType, span: &Range<usize>) {
        let width = u32::from(data_type.bits().unwrap_or(64));
        let mut taken: u64 = 0;
        for bit in &bits.list {
            let end = u32::from(bit.bit) + u32::from(bit.width);
            if bit.width == 0 || end > width {
                let name = data_type.name();
                self.say(span, format!("bits {} to {} do not fit {name}", bit.bit, end.saturating_sub(1)));
                continue;
            }
            let mask = (u64::MAX >> (64 - u32::from(bit.width))) << bit.bit;
            if taken & mask != 0 {
                self.say(span, format!("bit {} is named twice", (taken & mask).trailing_zeros()));
            }
            if bit.name.is_empty() && !bit.reserved {
                self.say(span, format!("bit {} needs a name, or reserved = true", bit.bit));
            } else if !bit.name.is_empty() && !is_kebab(&bit.name) {
                let said = format!("'{}' is no name of a bit: small letters, digits and hyphens", bit.name);
                self.say(span, said);
            }
            taken |= mask;
        }
    }

    pub(super) fn duplicates(&mut self, objects: &[Object]) {
        let mut seen = BTreeSet::new();
        for object in objects {
            for nth in 0..object.repeat.count {
                let index = object.index.wrapping_add(nth.wrapping_mul(object.repeat.stride));
                for entry in &object.entries {
                    for sub in entry.sub..=entry.to {
                        if !seen.insert((index, sub)) {
                            let address = ObjectAddress::new(index, sub);
                            self.say(&entry.span, format!("{address} is described twice"));
                        }
                    }
                }
            }
        }
    }

    pub(super) fn cycles(&mut self, objects: &[Object]) {
        for object in objects {
            for entry in &object.entries {
                let start = ObjectAddress::new(object.index, entry.sub);
                if leads_back(&self.device.dictionary, start) {
                    self.say(&entry.span, format!("the scale of {start} depends on itself"));
                }
            }
        }
    }
}

/// Whether a raw number fits a type; types that hold no integer take any.
pub(super) fn fits(number: i64, data_type: DataType) -> bool {
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

/// Whether scales lead from an object back to it.
fn leads_back(dictionary: &Dictionary, start: ObjectAddress) -> bool {
    let mut open = vec![start];
    let mut seen = Vec::new();
    while let Some(address) = open.pop() {
        let Some(found) = dictionary.find(address) else { continue };
        let Some(entry) = found.entry else { continue };
        let looks = std::iter::once(&entry.look).chain(entry.modes.iter().map(|(_, look)| look));
        for look in looks {
            let Some(Scale::ByObject { object, .. }) = look.scale else { continue };
            let next = found.shifted(object);
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
