//! Overview of a capture: size, defects, findings, stories, statistics and load.

use serde::Serialize;

use super::numbers::{seconds_after, to_seconds};
use super::statistics::CaptureStatistics;
use super::statistics::phrases::protocol_names;
use super::stories::StoriesAnswer;
use crate::event::Kind;
use crate::finding::Severity;
use crate::frame::Timestamp;
use crate::profile::Catalogue;
use crate::reading::Survey;
use crate::replay::ReplayState;
use crate::session::Bus;
use crate::sink::findings::records::CheckRecord;
use crate::sink::findings::{CaptureResult, FindingsReport};
use crate::statistics::LoadOverTime;
use crate::suggestion::{Suggestion, suggest_profiles};
use crate::why::WhyReport;
use crate::wire::NodeId;

/// Overview of a capture.
#[derive(Debug, Clone, Serialize)]
pub struct OverviewAnswer<'a> {
    /// Buses, in the order of their first frames.
    pub buses: Vec<BusOverview>,
    /// Time from the first frame to the last, in s.
    pub duration: Option<f64>,
    /// Number of error frames.
    pub error_frames: u64,
    /// Number of findings with the severity error.
    pub errors: usize,
    /// Number of events.
    pub events: u64,
    /// Reason why the capture was not read to its end.
    pub failure: Option<&'a str>,
    /// Findings and summary, as check -f jsonl prints them.
    pub findings: Vec<CheckRecord<'a>>,
    /// Title of the capture format.
    pub format: &'a str,
    /// Number of frames.
    pub frames: u64,
    /// Kinds of events with their number, without those that do not occur.
    pub kinds: Vec<(&'static str, u64)>,
    /// Limits of what the capture can show.
    pub limits: Vec<String>,
    /// Number of frames lost by the recorder.
    pub lost: u64,
    /// Number of transfers beyond those kept.
    pub more_transfers: u64,
    /// Name of the capture.
    pub name: &'a str,
    /// Number of events with new information.
    pub news: u64,
    /// Number of notes.
    pub notes: usize,
    /// Problems in the files next to the capture.
    pub problems: &'a [String],
    /// Profiles that can be assigned.
    pub profiles: Vec<String>,
    /// Time of the first frame, if it has a date.
    pub start: Option<String>,
    /// Statistics.
    pub statistics: CaptureStatistics,
    /// Number of transfers kept.
    pub transfers: usize,
    /// Number of unreadable lines and records.
    pub unreadable: u64,
    /// Number of findings with the severity warning.
    pub warnings: usize,
    /// Stories, with the changes before them.
    pub why: StoriesAnswer,
    /// Time of the first frame.
    pub zero: Option<String>,
}

/// A bus with its load over time.
#[derive(Debug, Clone, Serialize)]
pub struct BusOverview {
    /// Bit rate in bit/s.
    pub bit_rate: Option<u32>,
    /// Index of the bus.
    pub bus: u8,
    /// Reason why the bus is not detected as CANopen.
    pub doubt: Option<String>,
    /// Load over time.
    pub load: Option<LoadCurve>,
    /// Name of the bus.
    pub name: String,
    /// Protocols.
    pub protocols: Vec<&'static str>,
    /// Profiles for nodes without one.
    pub suggestions: Vec<ProfileProposal>,
}

/// Load of a bus over time, in steps of equal length.
#[derive(Debug, Clone, Serialize)]
pub struct LoadCurve {
    /// Bits per step, with stuff bits as estimated.
    pub bits: Vec<u64>,
    /// Error frames per step.
    pub errors: Vec<u64>,
    /// Frames per step.
    pub frames: Vec<u64>,
    /// Seconds from the first frame of the capture to the first step.
    pub start: f64,
    /// Length of a step in s.
    pub step: f64,
}

/// A profile that the behaviour of a node suggests.
#[derive(Debug, Clone, Serialize)]
pub struct ProfileProposal {
    /// Reasons, from the hints of the profile.
    pub because: Vec<String>,
    /// A J1939 address.
    pub j1939: bool,
    /// Node-ID or J1939 address.
    pub node: u8,
    /// Id of the profile.
    pub profile: String,
    /// Device name.
    pub title: String,
}

/// Results of the first reading of a capture, of which an overview is made.
#[derive(Clone, Copy)]
pub struct OverviewSource<'a> {
    /// Transfers, load, kinds of events, statistics.
    pub survey: &'a Survey,
    /// Stories, with the changes before them.
    pub stories: &'a WhyReport,
    /// Findings of the capture.
    pub findings: &'a FindingsReport,
    /// State after the last frame.
    pub end: &'a ReplayState,
    /// Profiles.
    pub catalogue: &'a Catalogue,
    /// Title of the capture format.
    pub format: &'a str,
    /// Problems in the files next to the capture.
    pub problems: &'a [String],
    /// Number of events, and of those with new information.
    pub events: (u64, u64),
}

impl<'a> OverviewAnswer<'a> {
    /// The overview of `capture`, the only one of the findings.
    pub fn new(capture: &'a CaptureResult, source: &OverviewSource<'a>) -> Self {
        let OverviewSource { survey, end, .. } = *source;
        let (buses, zero, name) = (end.buses(), end.first_time(), capture.capture.as_str());
        let count = |severity| capture.findings.reported_count(severity);
        let kinds = Kind::ALL.iter().zip(&survey.kinds).filter(|(_, count)| **count > 0);
        let problems = end.problem_counts();
        let statistics =
            CaptureStatistics::new((name, source.format), &survey.statistics, buses, Bus::bit_rate);
        Self {
            buses: buses.iter().map(|bus| BusOverview::new(bus, survey, zero)).collect(),
            duration: seconds_after(end.last_time(), zero),
            error_frames: problems.errors,
            errors: count(Severity::Error),
            events: source.events.0,
            failure: capture.failure.as_deref(),
            findings: source.findings.records().collect(),
            format: source.format,
            frames: end.frames(),
            kinds: kinds.map(|(kind, count)| (kind.name(), *count)).collect(),
            limits: survey.statistics.quality.limit_texts(),
            lost: problems.lost,
            more_transfers: survey.transfers.more,
            name,
            news: source.events.1,
            notes: count(Severity::Note),
            problems: source.problems,
            profiles: source.catalogue.ids(),
            start: zero.filter(|zero| zero.has_date()).map(|zero| zero.to_string()),
            statistics,
            transfers: survey.transfers.len(),
            unreadable: problems.unreadable,
            warnings: count(Severity::Warning),
            why: StoriesAnswer::new(source.stories, buses, zero, None, name),
            zero: zero.map(|zero| zero.to_string()),
        }
    }
}

impl BusOverview {
    fn new(bus: &Bus, survey: &Survey, zero: Option<Timestamp>) -> Self {
        let load = survey.load.get(usize::from(bus.index().0));
        Self {
            bit_rate: bus.bit_rate(),
            bus: bus.index().0,
            doubt: bus.protocols().detection_doubt(),
            load: load.map(|load| LoadCurve::new(load, zero)),
            name: bus.name().to_owned(),
            protocols: protocol_names(bus),
            suggestions: suggest_profiles(bus, bus.catalogue(), None)
                .into_iter()
                .map(ProfileProposal::from)
                .collect(),
        }
    }
}

impl LoadCurve {
    fn new(load: &LoadOverTime, zero: Option<Timestamp>) -> Self {
        let start = load.start().zip(zero).map_or(0, |(start, zero)| start.saturating_sub(zero.0));
        let steps = load.steps();
        Self {
            bits: steps.iter().map(|step| step.bits).collect(),
            errors: steps.iter().map(|step| step.errors).collect(),
            frames: steps.iter().map(|step| step.frames).collect(),
            start: to_seconds(start),
            step: to_seconds(load.step()),
        }
    }
}

impl From<Suggestion> for ProfileProposal {
    fn from(Suggestion { node, profile, title, because, .. }: Suggestion) -> Self {
        Self { because, j1939: matches!(node, NodeId::J1939(_)), node: node.number(), profile, title }
    }
}
