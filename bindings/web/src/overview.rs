//! Results of a whole capture: the first thing that the page shows.

use cobscope_decoder::event::Kind;
use cobscope_decoder::profile::device::Severity;
use cobscope_decoder::session::Bus;
use cobscope_decoder::sink::findings::{CaptureResult, FINDING_FORMATS, Report, TextOptions};
use cobscope_decoder::statistics::{BusStatistics, LoadOverTime};
use cobscope_decoder::suggestion::suggestions;
use cobscope_decoder::why;
use serde_json::{Value, json};

use crate::capture::Captures;
use crate::rows::seconds;
use crate::survey::CaptureSurvey;

/// Name and decoder state of what was opened.
pub struct Opened<'a> {
    /// Name of the capture, or of several.
    pub name: &'a str,
    /// The captures.
    pub captures: &'a Captures,
    /// Problems in the files beside the captures.
    pub problems: &'a [String],
}

/// Findings as `cobscope check -f jsonl` prints them: one line per finding, then the summary of the capture.
pub fn findings(survey: &CaptureSurvey, name: &str) -> String {
    let result = CaptureResult {
        capture: name.to_owned(),
        frames: survey.end.frames(),
        first: survey.zero(),
        last: survey.end.time(),
        findings: survey.findings.clone(),
        failure: survey.failure.clone(),
        ..CaptureResult::default()
    };
    let report = Report { captures: vec![result], ..Report::default() };
    let mut text = Vec::new();
    if let Some(format) = FINDING_FORMATS.iter().find(|format| format.name == "jsonl") {
        // Writing to memory does not fail.
        let _ = (format.write)(&report, TextOptions::default(), &mut text);
    }
    String::from_utf8(text).unwrap_or_default()
}

/// The overview as JSON.
pub fn overview(survey: &CaptureSurvey, opened: &Opened<'_>) -> Value {
    let buses = survey.end.buses();
    let number = |severity| survey.findings.number(severity);
    let why = why::json::line(&survey.answer, buses, survey.zero(), None, opened.name);
    let lines = findings(survey, opened.name);
    let parsed = |text: &str| serde_json::from_str::<Value>(text).ok();
    let kinds = Kind::ALL.iter().zip(&survey.overview.kinds).filter(|(_, count)| **count > 0);
    let quality = &survey.overview.statistics.quality;
    let counts = survey.end.counts();
    json!({
        "name": opened.name,
        "format": opened.captures.format,
        "frames": survey.end.frames(),
        "duration": seconds(survey.end.time(), survey.zero()),
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
        "limits": quality.limits(),
        "events": survey.all.total(),
        "news": survey.news.total(),
        "transfers": survey.overview.transfers.len(),
        "more_transfers": survey.overview.transfers.more,
        "kinds": kinds.map(|(kind, count)| json!([kind.name(), count])).collect::<Vec<_>>(),
        "why": parsed(&why),
        "findings": lines.lines().filter_map(parsed).collect::<Vec<_>>(),
        "buses": buses.iter().map(|bus| bus_facts(survey, bus)).collect::<Vec<_>>(),
        "profiles": opened.captures.options().catalogue.ids(),
    })
}

fn bus_facts(survey: &CaptureSurvey, bus: &Bus) -> Value {
    let place = usize::from(bus.index().0);
    let zero = survey.zero();
    let load = survey.overview.load.get(place).map(|load| load_steps(load, zero.map(|zero| zero.0)));
    let statistics = survey.overview.statistics.buses.get(place);
    let proposals = suggestions(bus, bus.catalogue(), None);
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
        "protocols": protocols(bus),
        "doubt": bus.doubt(),
        "load": load,
        "statistics": statistics.map(|statistics| figures(survey, statistics)),
        "suggestions": proposals.collect::<Vec<_>>(),
    })
}

fn protocols(bus: &Bus) -> Vec<&'static str> {
    let all = [(bus.is_canopen(), "CANopen"), (bus.is_j1939(), "J1939"), (bus.is_uds(), "UDS")];
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

#[expect(clippy::cast_precision_loss, reason = "for display")]
fn figures(survey: &CaptureSurvey, statistics: &BusStatistics) -> Value {
    let millis = |nanoseconds: i64| nanoseconds as f64 / 1e6;
    let end = survey.overview.statistics.quality.last;
    let ids = statistics.ids().into_iter().map(|(id, is_remote, own)| {
        json!({
            "id": id.to_string(),
            "remote": is_remote,
            "frames": own.frames,
            "mean": own.intervals.mean().map(millis),
            "jitter": own.intervals.jitter().map(millis),
            "silent": own.intervals.silent_since(end).is_some(),
        })
    });
    json!({
        "frames": statistics.load.frames,
        "bits": statistics.load.bits,
        "worst_frames": statistics.load.worst_frames().0,
        "worst_bits": statistics.load.worst_bits().0,
        "undecoded": statistics.undecoded,
        "malformed": statistics.malformed,
        "ids": ids.collect::<Vec<_>>(),
        "other_ids": statistics.other_ids,
        "syncs": statistics.master.syncs,
        "guard_requests": statistics.master.guard_requests,
    })
}
