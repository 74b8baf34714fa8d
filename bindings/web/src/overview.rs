//! Results of a whole capture: the first thing that the page shows.

use cobscope_decoder::answers::overview::{OverviewAnswer, OverviewSource};
use cobscope_decoder::sink::findings::{CaptureResult, FindingsReport};
use serde_json::Value;

use crate::capture::CaptureSet;
use crate::survey::CaptureSurvey;

/// The overview of the captures `name` as JSON; `problems` are those in the files next to them.
///
/// # Errors
/// If it cannot be written.
pub fn build_overview(
    survey: &CaptureSurvey,
    name: &str,
    captures: &CaptureSet,
    problems: &[String],
) -> Result<Value, String> {
    let result = CaptureResult {
        capture: name.to_owned(),
        frames: survey.end.frames(),
        first: survey.zero(),
        last: survey.end.last_time(),
        findings: survey.findings.clone(),
        failure: survey.failure.clone(),
        ..CaptureResult::default()
    };
    let findings = FindingsReport { captures: vec![result], ..FindingsReport::default() };
    let source = OverviewSource {
        survey: &survey.overview,
        stories: &survey.answer,
        findings: &findings,
        end: &survey.end,
        catalogue: &captures.options().catalogue,
        format: captures.format,
        problems,
        events: (survey.all.total(), survey.news.total()),
    };
    let answers = findings.captures.iter().map(|capture| OverviewAnswer::new(capture, &source));
    answers.map(serde_json::to_value).next().unwrap_or(Ok(Value::Null)).map_err(|error| error.to_string())
}
