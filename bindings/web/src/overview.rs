//! Results of a whole capture: the first thing that the page shows.

use cobscope_decoder::answers::statistics::CaptureStatistics;
use cobscope_decoder::answers::stories::StoriesAnswer;
use cobscope_decoder::event::Kind;
use cobscope_decoder::profile::device::Severity;
use cobscope_decoder::session::Bus;
use cobscope_decoder::sink::findings::{CaptureResult, FindingsReport};
use cobscope_decoder::statistics::LoadOverTime;
use cobscope_decoder::suggestion::suggest_profiles;
use serde_json::{Value, json};

use crate::capture::CaptureSet;
use crate::rows::seconds_since;
use crate::survey::CaptureSurvey;

/// Name and decoder state of what was opened.
pub struct CaptureOverview<'a> {
    /// Name of the capture, or of several.
    pub name: &'a str,
    /// The captures.
    pub captures: &'a CaptureSet,
    /// Problems in the files next to the captures.
    pub problems: &'a [String],
}

/// Findings as `cobscope check -f jsonl` prints them: one object per finding, then the summary of the capture.
fn findings_text(survey: &CaptureSurvey, name: &str) -> Vec<Value> {
    let result = CaptureResult {
        capture: name.to_owned(),
        frames: survey.end.frames(),
        first: survey.zero(),
        last: survey.end.last_time(),
        findings: survey.findings.clone(),
        failure: survey.failure.clone(),
        ..CaptureResult::default()
    };
    let report = FindingsReport { captures: vec![result], ..FindingsReport::default() };
    report.records().filter_map(|record| serde_json::to_value(record).ok()).collect()
}

/// The overview as JSON.
pub fn build_overview(survey: &CaptureSurvey, opened: &CaptureOverview<'_>) -> Value {
    let buses = survey.end.buses();
    let number = |severity| survey.findings.reported_count(severity);
    let name = (opened.name, opened.captures.format);
    let figures = CaptureStatistics::new(name, &survey.overview.statistics, buses, Bus::bit_rate);
    let kinds = Kind::ALL.iter().zip(&survey.overview.kinds).filter(|(_, count)| **count > 0);
    let quality = &survey.overview.statistics.quality;
    let counts = survey.end.problem_counts();
    json!({
        "name": opened.name,
        "format": opened.captures.format,
        "frames": survey.end.frames(),
        "duration": seconds_since(survey.end.last_time(), survey.zero()),
        "zero": survey.zero().map(|zero| zero.to_string()),
        "start": survey.zero().filter(|zero| zero.has_date()).map(|zero| zero.to_string()),
        "failure": survey.failure,
        "problems": opened.problems,
        "errors": number(Severity::Error),
        "warnings": number(Severity::Warning),
        "notes": number(Severity::Note),
        "unreadable": counts.unreadable,
        "lost": counts.lost,
        "error_frames": counts.errors,
        "limits": quality.limit_texts(),
        "events": survey.all.total(),
        "news": survey.news.total(),
        "transfers": survey.overview.transfers.len(),
        "more_transfers": survey.overview.transfers.more,
        "kinds": kinds.map(|(kind, count)| json!([kind.name(), count])).collect::<Vec<_>>(),
        "why": StoriesAnswer::new(&survey.answer, buses, survey.zero(), None, opened.name),
        "findings": findings_text(survey, opened.name),
        "statistics": figures,
        "buses": buses.iter().map(|bus| bus_facts(survey, bus)).collect::<Vec<_>>(),
        "profiles": opened.captures.options().catalogue.ids(),
    })
}

fn bus_facts(survey: &CaptureSurvey, bus: &Bus) -> Value {
    let place = usize::from(bus.index().0);
    let zero = survey.zero();
    let load = survey.overview.load.get(place).map(|load| load_steps(load, zero.map(|zero| zero.0)));
    let proposals = suggest_profiles(bus, bus.catalogue(), None);
    let proposals = proposals.iter().map(|it| {
        json!({
            "node": it.node.number(),
            "j1939": matches!(it.node, cobscope_decoder::NodeId::J1939(_)),
            "profile": it.profile,
            "title": it.title,
            "because": it.because,
        })
    });
    json!({
        "bus": bus.index().0,
        "name": bus.name(),
        "bit_rate": bus.bit_rate(),
        "protocols": protocol_names(bus),
        "doubt": bus.protocols().detection_doubt(),
        "load": load,
        "suggestions": proposals.collect::<Vec<_>>(),
    })
}

fn protocol_names(bus: &Bus) -> Vec<&'static str> {
    let all = [
        (bus.protocols().is_canopen(), "CANopen"),
        (bus.protocols().is_j1939(), "J1939"),
        (bus.protocols().is_uds(), "UDS"),
    ];
    all.into_iter().filter(|(is_on, _)| *is_on).map(|(_, name)| name).collect()
}

fn load_steps(load: &LoadOverTime, zero: Option<i64>) -> Value {
    let start = load.start().zip(zero).map_or(0, |(start, zero)| start.saturating_sub(zero));
    #[expect(clippy::cast_precision_loss, reason = "for display")]
    let seconds = |nanoseconds: i64| nanoseconds as f64 / 1e9;
    let steps = load.steps();
    json!({
        "start": seconds(start),
        "step": seconds(load.step()),
        "frames": steps.iter().map(|step| step.frames).collect::<Vec<_>>(),
        "bits": steps.iter().map(|step| step.bits).collect::<Vec<_>>(),
        "errors": steps.iter().map(|step| step.errors).collect::<Vec<_>>(),
    })
}
