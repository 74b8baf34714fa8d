//! Results about the whole capture: findings, transfers, errors, load. Filled by
//! [`threads::survey`](super::threads::survey).

use cobscope_decoder::diagnosis::Diagnosis;
use cobscope_decoder::finding::CaptureFindings;
use cobscope_decoder::frame::Timestamp;
use cobscope_decoder::profile::device::Severity;
use cobscope_decoder::reading::Survey;

/// Results about the whole capture so far.
#[derive(Default)]
pub struct SurveyResults {
    /// Number of frames surveyed.
    pub frames: u64,
    /// Whether these are all frames.
    pub is_complete: bool,
    /// Transfers, errors, opened findings, NMT, load, kinds of events, statistics.
    pub overview: Survey,
    /// Findings in groups; None until the end.
    pub findings: Option<CaptureFindings>,
    /// Stories of the findings so far; None before the first one.
    pub diagnosis: Option<Diagnosis>,
    /// Number of errors and warnings in the diagnosis.
    pub diagnosed: (usize, usize),
    /// Number of diagnoses so far; a new number means that lines may have changed.
    pub revision: u64,
    /// Positions of the kept occurrences of findings, in order.
    pub places: Vec<FindingOccurrence>,
    /// Names of all buses, including those without frames; not escaped. Empty until the end.
    pub buses: Vec<String>,
}

impl SurveyResults {
    /// Replaces the stories and the numbers of errors and warnings.
    pub(super) fn set_diagnosis(&mut self, (diagnosis, diagnosed): (Diagnosis, (usize, usize))) {
        self.diagnosis = Some(diagnosis);
        self.diagnosed = diagnosed;
        self.revision += 1;
    }
}

/// An occurrence of a finding.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct FindingOccurrence {
    /// Frame of evidence.
    pub frame: u64,
    /// Time of the frame.
    pub time: Option<Timestamp>,
    /// Id of the finding.
    pub id: u64,
    /// Severity of the finding.
    pub severity: Severity,
}
