//! Diagnosis of the findings so far, while the rules still run.

use std::time::{Duration, Instant};

use cobscope_decoder::diagnosis::{Diagnosis, DiagnosisContext};
use cobscope_decoder::finding::{CaptureFindings, Severity};
use cobscope_decoder::frame::Timestamp;
use cobscope_decoder::reading;

/// Minimum time between two diagnoses: each copies all findings.
const INTERVAL: Duration = Duration::from_secs(1);

/// Decides when a diagnosis is due.
#[derive(Debug, Default)]
pub(super) struct DiagnosisSchedule {
    /// A finding opened or closed since the last diagnosis.
    has_changed: bool,
    /// The last diagnosis followed a change: a cause may be reported shortly after its effect.
    is_fresh: bool,
    last: Option<Instant>,
}

impl DiagnosisSchedule {
    /// Notes that a finding opens or closes.
    pub(super) fn note_change(&mut self) {
        self.has_changed = true;
    }

    /// Whether a diagnosis is due now or later.
    pub(super) fn is_pending(&self) -> bool {
        self.has_changed || self.is_fresh
    }

    /// Whether a diagnosis is due; it counts as made.
    pub(super) fn is_due(&mut self, now: Instant) -> bool {
        let is_early = self.last.is_some_and(|last| now.saturating_duration_since(last) < INTERVAL);
        if !self.is_pending() || is_early {
            return false;
        }
        (self.is_fresh, self.has_changed, self.last) = (self.has_changed, false, Some(now));
        true
    }
}

/// Diagnosis with the number of its errors and warnings.
pub(super) fn diagnose_findings(
    findings: &CaptureFindings,
    zero: Option<Timestamp>,
    is_growing: bool,
) -> (Diagnosis, (usize, usize)) {
    let setting = DiagnosisContext { zero, is_growing, ..DiagnosisContext::default() };
    let diagnosis = reading::diagnosis(findings, setting);
    (diagnosis, (findings.reported_count(Severity::Error), findings.reported_count(Severity::Warning)))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The moments are simulated.
    #[test]
    fn a_change_is_diagnosed_at_once_then_once_per_second_and_once_more() {
        let start = Instant::now();
        let at = |millis| start + Duration::from_millis(millis);
        let mut diagnosing = DiagnosisSchedule::default();
        assert!(!diagnosing.is_due(at(0)), "nothing was found");
        diagnosing.has_changed = true;
        assert!(diagnosing.is_due(at(10)));
        diagnosing.has_changed = true;
        assert!(!diagnosing.is_due(at(900)) && diagnosing.is_pending());
        assert!(diagnosing.is_due(at(1_010)));
        assert!(diagnosing.is_due(at(2_100)), "causes that follow their effects");
        assert!(!diagnosing.is_due(at(9_000)) && !diagnosing.is_pending());
    }
}
