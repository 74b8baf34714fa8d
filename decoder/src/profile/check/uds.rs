//! Checks of UDS identifiers.

use std::collections::BTreeSet;

use super::Check;
use crate::profile::lookup::units;

impl Check<'_> {
    pub(super) fn uds(&mut self) {
        let mut seen = BTreeSet::new();
        for identifier in &self.device.uds.identifier {
            let (span, identifier) = (identifier.span(), identifier.get_ref());
            self.only(&identifier.only, &span);
            if !seen.insert(identifier.id) {
                self.report(&span, format!("duplicate UDS identifier {:04X}", identifier.id));
            }
            let numbers = identifier.range.into_iter().flatten().chain(identifier.default);
            let Some(data_type) = identifier.data_type else {
                if numbers.count() > 0 || identifier.values.is_some() {
                    self.report(&span, "type is missing; expected a data type");
                }
                continue;
            };
            self.names(identifier.values.as_ref(), data_type, "values", &span);
            for number in numbers {
                self.number(number, data_type, "range or default", &span);
            }
            match (identifier.range, identifier.default) {
                (Some([least, most]), _) if least > most => {
                    self.report(&span, format!("range {least} to {most}; expected the minimum first"));
                }
                (Some([least, most]), Some(default)) if !(least..=most).contains(&default) => {
                    self.report(&span, format!("default {default} is outside range {least} to {most}"));
                }
                _ => {}
            }
            if !identifier.unit.is_empty() && !units().contains(&identifier.unit) {
                self.report(&span, format!("unknown unit '{}'", identifier.unit));
            }
        }
    }
}
