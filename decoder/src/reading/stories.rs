//! Stories of the findings of a reading.

use super::pass::Summary;
use crate::diagnosis::{Diagnosis, DiagnosisContext};
use crate::finding::{CaptureFindings, FindingGroup};
use crate::frame::Timestamp;

/// Stories of all findings that count in the output.
pub fn diagnosis(findings: &CaptureFindings, setting: DiagnosisContext) -> Diagnosis {
    Diagnosis::diagnose_findings(findings, findings.reported_groups(), setting)
}

/// Stories of some of the findings.
pub fn diagnosis_of<'a>(
    findings: &'a CaptureFindings,
    groups: impl Iterator<Item = &'a FindingGroup>,
    zero: Option<Timestamp>,
) -> Diagnosis {
    Diagnosis::diagnose_findings(findings, groups, DiagnosisContext { zero, ..DiagnosisContext::default() })
}

impl<P> Summary<P> {
    /// Stories of all findings that count in the output.
    pub fn diagnosis(&self) -> Diagnosis {
        diagnosis(&self.findings, DiagnosisContext { zero: self.first_time(), ..DiagnosisContext::default() })
    }
}
