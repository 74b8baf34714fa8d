//! The comparison of two captures, as `cobscope diff -f json` prints it.

use serde::Serialize;

use super::numbers::to_seconds;
use crate::bus_file::DiffTolerances;
use crate::comparison::{
    CaptureComparison, CaptureRecord, ComparedSide, Difference, EvidenceMark, Observation, UnobservedSubject,
};

/// Differences between two captures.
#[derive(Debug, Clone, Serialize)]
pub struct ComparisonAnswer {
    /// Second capture.
    pub bad: ComparedCapture,
    /// Differences, most important first.
    pub differences: Vec<DifferenceRecord>,
    /// No difference within the tolerances; false if nothing was compared (see not_compared).
    pub equal: bool,
    /// Numbers of equal subjects.
    pub equal_counts: Vec<EqualSubjects>,
    /// First capture.
    pub good: ComparedCapture,
    /// Reasons why something was not compared.
    pub not_compared: Vec<String>,
    /// Subjects that one capture never showed; they are not differences.
    pub not_seen: Vec<UnseenSubject>,
    /// Tolerances in use: \[diff\] of the bus file, or the defaults.
    pub tolerances: ToleranceRecord,
}

/// One of the captures.
#[derive(Debug, Clone, Serialize)]
pub struct ComparedCapture {
    /// Names of the buses.
    pub buses: Vec<String>,
    /// Name of the capture.
    pub capture: String,
    /// Number of error frames.
    pub error_frames: u64,
    /// Number of frames.
    pub frames: u64,
    /// Time from the first frame to the last; null without timestamps.
    pub seconds: Option<f64>,
    /// The timestamps are those of a recorder.
    pub timed: bool,
}

/// A difference.
#[derive(Debug, Clone, Serialize)]
pub struct DifferenceRecord {
    /// Object, message, state, rule or code.
    pub aspect: String,
    /// Value in the second capture; null if it has none.
    pub bad: Option<ObservedValue>,
    /// Value in the first capture; null if it has none.
    pub good: Option<ObservedValue>,
    /// Kind of difference.
    pub kind: &'static str,
    /// Origin of the values, effects, reasons; may be empty.
    pub note: String,
    /// Section.
    pub section: &'static str,
    /// Node, bus or identifier; empty for the only bus.
    pub subject: String,
    /// Importance; the list is in descending order of it.
    pub weight: f64,
}

/// A value in one capture.
#[derive(Debug, Clone, Serialize)]
pub struct ObservedValue {
    /// Frame that shows it.
    pub frame: Option<u64>,
    /// Time from the first frame of the capture.
    pub seconds: Option<f64>,
    /// Value.
    pub text: String,
}

/// A subject that one capture never showed.
#[derive(Debug, Clone, Serialize)]
pub struct UnseenSubject {
    /// Object, message, state or code with its value in the other capture.
    pub aspect: String,
    /// Capture that did not show it.
    pub by: &'static str,
    /// Frame in the other capture.
    pub frame: Option<u64>,
    /// Kind of subject.
    pub kind: &'static str,
    /// Time in the other capture.
    pub seconds: Option<f64>,
    /// Section.
    pub section: &'static str,
    /// Node, bus or identifier.
    pub subject: String,
    /// Importance; 0 for a subject that text output only counts.
    pub weight: f64,
}

/// A number of equal subjects.
#[derive(Debug, Clone, Serialize)]
pub struct EqualSubjects {
    /// Number.
    pub count: u64,
    /// Section.
    pub section: &'static str,
    /// Kind of subject.
    pub subject: &'static str,
}

/// Tolerances of a comparison.
#[derive(Debug, Clone, Serialize)]
pub struct ToleranceRecord {
    /// Key count-percent.
    pub count_percent: f64,
    /// Key gap-percent.
    pub gap_percent: f64,
    /// Key latency-percent.
    pub latency_percent: f64,
    /// Key load-percent.
    pub load_percent: f64,
    /// Key longest-gap-percent.
    pub longest_gap_percent: f64,
    /// Key period-percent.
    pub period_percent: f64,
    /// Key set-point-percent.
    pub set_point_percent: f64,
    /// Key time-ms.
    pub time_ms: f64,
}

impl ComparisonAnswer {
    /// The comparison of `good` with `bad`.
    pub fn new(
        comparison: &CaptureComparison,
        (good, bad): (&CaptureRecord, &CaptureRecord),
        tolerances: &DiffTolerances,
    ) -> Self {
        let equal = comparison.equal.iter().map(|((section, subject), count)| EqualSubjects {
            count: *count,
            section: section.name(),
            subject: subject.name(),
        });
        Self {
            bad: ComparedCapture::new(bad),
            differences: comparison.differences.iter().map(DifferenceRecord::new).collect(),
            equal: comparison.is_equal(),
            equal_counts: equal.collect(),
            good: ComparedCapture::new(good),
            not_compared: comparison.limits.iter().map(|(_, text)| text.clone()).collect(),
            not_seen: comparison.not_seen.iter().map(UnseenSubject::new).collect(),
            tolerances: ToleranceRecord::new(tolerances),
        }
    }
}

impl ComparedCapture {
    fn new(record: &CaptureRecord) -> Self {
        Self {
            buses: record.buses.iter().map(|bus| bus.name.clone()).collect(),
            capture: record.name.clone(),
            error_frames: record.error_frames,
            frames: record.frames,
            seconds: record.duration.map(to_seconds),
            timed: record.is_timed,
        }
    }
}

impl DifferenceRecord {
    fn new(difference: &Difference) -> Self {
        let Difference { section, kind, subject, aspect, good, bad, note, weight } = difference.clone();
        Self {
            aspect,
            bad: bad.map(ObservedValue::new),
            good: good.map(ObservedValue::new),
            kind: kind.name(),
            note,
            section: section.name(),
            subject,
            weight,
        }
    }
}

impl ObservedValue {
    fn new(value: Observation) -> Self {
        let (frame, seconds) = place(value.mark);
        Self { frame, seconds, text: value.text }
    }
}

impl UnseenSubject {
    fn new(unseen: &UnobservedSubject) -> Self {
        let (frame, seconds) = place(unseen.mark);
        Self {
            aspect: unseen.aspect.clone(),
            by: if unseen.by == ComparedSide::Good { "good" } else { "bad" },
            frame,
            kind: unseen.noun.name(),
            seconds,
            section: unseen.section.name(),
            subject: unseen.subject.clone(),
            weight: unseen.weight,
        }
    }
}

impl ToleranceRecord {
    fn new(tolerances: &DiffTolerances) -> Self {
        Self {
            count_percent: tolerances.count,
            gap_percent: tolerances.gap,
            latency_percent: tolerances.latency,
            load_percent: tolerances.load,
            longest_gap_percent: tolerances.longest_gap,
            period_percent: tolerances.period,
            set_point_percent: tolerances.set_point,
            time_ms: tolerances.time_ms,
        }
    }
}

/// Frame and time in s, if known.
fn place(mark: EvidenceMark) -> (Option<u64>, Option<f64>) {
    (Some(mark.frame).filter(|frame| *frame > 0), mark.time.map(to_seconds))
}
