//! Checks of UDS identifiers.

use std::collections::BTreeSet;

use super::ProfileCheck;
use crate::profile::lookup::unit_names;

impl ProfileCheck<'_> {
    pub(super) fn check_uds(&mut self) {
        let mut seen = BTreeSet::new();
        for identifier in &self.device.uds.identifier {
            let (span, identifier) = (identifier.span(), identifier.get_ref());
            self.check_variants(&identifier.only, &span);
            if !seen.insert(identifier.id) {
                self.report_problem(&span, format!("duplicate UDS identifier {:04X}", identifier.id));
            }
            let numbers = identifier.range.into_iter().flatten().chain(identifier.default);
            let Some(data_type) = identifier.data_type else {
                if numbers.count() > 0 || identifier.values.is_some() {
                    self.report_problem(&span, "type is missing; expected a data type");
                }
                continue;
            };
            self.check_names(identifier.values.as_ref(), data_type, "values", &span);
            for number in numbers {
                self.check_number(number, data_type, "range or default", &span);
            }
            match (identifier.range, identifier.default) {
                (Some([least, most]), _) if least > most => {
                    self.report_problem(
                        &span,
                        format!("range {least} to {most}; expected the minimum first"),
                    );
                }
                (Some([least, most]), Some(default)) if !(least..=most).contains(&default) => {
                    self.report_problem(
                        &span,
                        format!("default {default} is outside range {least} to {most}"),
                    );
                }
                _ => {}
            }
            if !identifier.unit.is_empty() && !unit_names().contains(&identifier.unit) {
                self.report_problem(&span, format!("unknown unit '{}'", identifier.unit));
            }
        }
    }
}
