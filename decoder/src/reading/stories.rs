//! Stories of the findings of a reading.

use super::pass::Summary;
use crate::diagnosis::{Diagnosis, Setting};
use crate::finding::{Findings, Group};
use crate::frame::Timestamp;

/// Stories of all findings that count in the output.
pub fn diagnosis(findings: &Findings, setting: Setting) -> Diagnosis {
    Diagnosis::of(findings, findings.counting(), setting)
}

/// Stories of some of the findings.
pub fn diagnosis_of<'a>(
    findings: &'a Findings,
    groups: impl Iterator<Item = &'a Group>,
    zero: Option<Timestamp>,
) -> Diagnosis {
    Diagnosis::of(findings, groups, Setting { zero, ..Setting::default() })
}

impl<P> Summary<P> {
    /// Stories of all findings that count in the output.
    pub fn diagnosis(&self) -> Diagnosis {
        diagnosis(&self.findings, Setting { zero: self.first_time(), ..Setting::default() })
    }
}
