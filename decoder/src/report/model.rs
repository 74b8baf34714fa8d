//! Contents of a report. All texts can contain names of the capture: writers escape them.

use crate::diagnosis::LineLabel;
use crate::finding::Severity;

/// Contents of a report on one capture.
#[derive(Debug, Clone, Default)]
pub struct CaptureReport {
    /// Name, format and size of the capture.
    pub capture: CaptureFacts,
    /// Selected part of the capture: `up to 90.000 s`; empty for the whole capture.
    pub scope: String,
    /// Stories with their evidence, most important first.
    pub claims: Vec<ReportClaim>,
    /// Titles of stories that have no claim here.
    pub further: Vec<String>,
    /// Findings that are notes only.
    pub notes: Vec<String>,
    /// Lines of `why` without a finding; empty if there are claims.
    pub account: Vec<String>,
    /// Whether it is about a fault at a known time.
    pub has_unjudged_fault: bool,
    /// Verdicts of all active rules.
    pub coverage: VerdictCoverage,
    /// Sources of the rules behind the claims.
    pub sources: Vec<RuleSource>,
    /// Measured properties of the capture.
    pub quality: Vec<String>,
    /// What the capture cannot show.
    pub blind: Vec<String>,
    /// Assumptions that the claims rest on.
    pub assumptions: Vec<String>,
    /// Source and zone of the timestamps.
    pub clock: Vec<String>,
    /// Nodes with the profile that decodes them.
    pub devices: Vec<String>,
    /// How the report was made.
    pub provenance: Provenance,
    /// The cut-out capture, if one was requested.
    pub attachment: Option<Attachment>,
}

impl CaptureReport {
    /// Title of the page: the first claim, else `no finding` with the selection.
    pub(super) fn title(&self) -> String {
        match self.claims.first() {
            Some(claim) => claim.title.clone(),
            None if self.has_unjudged_fault => {
                format!("{}; fault without a rule", self.within_scope("no finding"))
            }
            None => self.within_scope("no finding"),
        }
    }

    /// `verdict` with the selection that it is limited to.
    pub(super) fn within_scope(&self, verdict: &str) -> String {
        format!("{verdict} {}", self.scope).trim_end().to_owned()
    }
}

/// Name, format and size of a capture.
#[derive(Debug, Clone, Default)]
pub struct CaptureFacts {
    /// Name as in all output.
    pub name: String,
    /// Title of the format.
    pub format: String,
    /// Number of frames.
    pub frames: u64,
    /// Time from the first to the last frame: `143.001 s`; `None` without timestamps.
    pub duration: Option<String>,
    /// Why the capture was not read to its end.
    pub failure: Option<String>,
}

/// A story with its evidence.
#[derive(Debug, Clone)]
pub struct ReportClaim {
    /// Number on the page, from 1.
    pub number: usize,
    /// Highest severity of its findings.
    pub severity: Severity,
    /// Node and text of the cause, or of the first effect.
    pub title: String,
    /// Node with its device, or the bus.
    pub who: String,
    /// Time, date and duration.
    pub when: String,
    /// Lines of the story.
    pub lines: Vec<ClaimLine>,
    /// Sections of the manual and clauses of standards.
    pub sources: Vec<String>,
    /// Frames that show the claim, in order.
    pub evidence: Vec<EvidenceFrame>,
    /// Number of further frames not listed.
    pub omitted: usize,
    /// Changes before, states and gates at that time, as printed by `why`; for the first claim only.
    pub context: Vec<String>,
    /// Signals around the claim.
    pub plots: Vec<ClaimPlot>,
    /// Object values of its nodes when it began.
    pub values: Vec<NodeValues>,
}

/// A line of a story.
#[derive(Debug, Clone)]
pub struct ClaimLine {
    /// Number of the fact in the plots and the list of frames; `None` for steps and remarks.
    pub mark: Option<usize>,
    /// Meaning of the line.
    pub label: LineLabel,
    /// Text with frames in braces.
    pub text: String,
}

/// A frame that shows a claim.
#[derive(Debug, Clone, Default)]
pub struct EvidenceFrame {
    /// Number in the capture, from 1.
    pub number: u64,
    /// Seconds from the first frame: `7.204`; empty without timestamps.
    pub time: String,
    /// Name of the bus.
    pub bus: String,
    /// Identifier in hexadecimal, with the type of the frame if it is not a data frame.
    pub id: String,
    /// Payload in hexadecimal.
    pub bytes: String,
    /// Meaning, one line per event.
    pub meaning: Vec<String>,
    /// Facts of the story that it shows; see [`ClaimLine::mark`].
    pub marks: Vec<usize>,
    /// The meaning is presumed.
    pub is_presumed: bool,
}

/// Unit of the horizontal axis of a plot.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum PlotAxis {
    /// Seconds after the first frame.
    Seconds,
    /// Numbers of frames.
    Frames,
}

/// Signals with the same unit around a claim.
#[derive(Debug, Clone)]
pub struct ClaimPlot {
    /// Unit of the values; empty for plain numbers.
    pub unit: String,
    /// Unit of the horizontal axis.
    pub axis: PlotAxis,
    /// First and last position on the horizontal axis.
    pub range: (f64, f64),
    /// Signals.
    pub curves: Vec<SignalCurve>,
    /// Facts of the story on the horizontal axis.
    pub marks: Vec<PlotMark>,
}

/// Values of a signal.
#[derive(Debug, Clone)]
pub struct SignalCurve {
    /// Name, with `?` if its decoding is assumed.
    pub name: String,
    /// Message and node.
    pub source: String,
    /// Position and value, in order.
    pub points: Vec<(f64, f64)>,
}

/// A fact of the story in a plot.
#[derive(Debug, Clone)]
pub struct PlotMark {
    /// See [`ClaimLine::mark`].
    pub number: usize,
    /// Position on the horizontal axis.
    pub at: f64,
}

/// Object values of a node.
#[derive(Debug, Clone)]
pub struct NodeValues {
    /// Node with its device.
    pub who: String,
    /// Moment of the values: `after {104}`.
    pub at: String,
    /// Number of all objects with a known value.
    pub total: usize,
    /// Listed objects.
    pub rows: Vec<ObjectRow>,
}

/// Value of an object.
#[derive(Debug, Clone)]
pub struct ObjectRow {
    /// Index and subindex.
    pub object: String,
    /// Name in the dictionary; empty if unknown.
    pub name: String,
    /// Value with its unit; empty if only the bytes are known. `?` if it may have changed.
    pub value: String,
    /// Bytes in hexadecimal; `?` if they may have changed and the value is unknown.
    pub bytes: String,
    /// The value may have changed since.
    pub is_stale: bool,
    /// Source of the value: `written`, `read`, `sent`, `given`, `in DCF`.
    pub origin: &'static str,
    /// Frame of the value; 0 for a value from a file.
    pub frame: u64,
    /// The finding names the object.
    pub is_subject: bool,
}

/// Verdicts of all active rules.
#[derive(Debug, Clone, Default)]
pub struct VerdictCoverage {
    /// Rules without a defect, with the number of checks.
    pub passed: Vec<(String, u64)>,
    /// Rules with a defect, with the number of defects.
    pub failed: Vec<(String, u64)>,
    /// Rules without anything to check, with what was missing.
    pub not_exercised: Vec<(String, String)>,
}

/// Source of a rule.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct RuleSource {
    /// Name of the rule.
    pub rule: String,
    /// The defect.
    pub title: String,
    /// Section of the manual, clause, or the user's reason.
    pub source: String,
}

/// How a report was made.
#[derive(Debug, Clone, Default)]
pub struct Provenance {
    /// Command line.
    pub command: String,
    /// Version of the program.
    pub version: String,
    /// Files that the report is made from.
    pub files: Vec<HashedFile>,
}

/// A file with its hash.
#[derive(Debug, Clone)]
pub struct HashedFile {
    /// Use of the file: `capture`, `bus file`, `EDS`, `profile`.
    pub role: &'static str,
    /// Name as on the command line.
    pub name: String,
    /// Size in bytes.
    pub size: u64,
    /// SHA-256 in hexadecimal, or why there is none.
    pub sha256: String,
}

/// The cut-out capture.
#[derive(Debug, Clone)]
pub struct Attachment {
    /// File name.
    pub name: String,
    /// Number of frames.
    pub frames: usize,
    /// Size in bytes.
    pub size: usize,
    /// The window contains more frames than the file.
    pub is_cut: bool,
    /// The capture has timestamps; else those of the file are 0.
    pub is_timed: bool,
    /// SHA-256 in hexadecimal.
    pub sha256: String,
    /// Contents in base64, if embedded; else the file is next to the page.
    pub embedded: Option<String>,
    /// Name of the bus file with the state before the first frame, next to the page.
    pub bus_file: Option<String>,
}
