//! Results of one pass over a capture: findings, stories, statistics and signals, each as its command writes it.

use std::sync::Arc;

use anyhow::bail;
use cobscope_decoder::Summary;
use cobscope_decoder::answers::statistics::CaptureStatistics;
use cobscope_decoder::answers::stories::StoriesAnswer;
use cobscope_decoder::decoder::Decoder;
use cobscope_decoder::diagnosis::DiagnosisContext;
use cobscope_decoder::frame::Frame;
use cobscope_decoder::reading::{ListedSignal, SignalList};
use cobscope_decoder::rules::RuleSetup;
use cobscope_decoder::session::{Bus, SessionOptions};
use cobscope_decoder::sink::findings::{CaptureResult, FindingsReport};
use cobscope_decoder::statistics::Statistics;
use serde_json::Value;

use super::capture_job::{CaptureJob, ReadCapture};
use super::selected_facts::{SelectedFacts, diagnosis, question};
use crate::run::arguments::{InputArgs, SelectArgs};
use crate::source::CaptureSeries;

/// Results of one pass.
pub struct PassResults {
    /// State after the last frame.
    pub decoder: Decoder,
    /// The first frame.
    pub first: Frame,
    /// The object of `stats -f json`.
    pub statistics: Value,
    /// The object of `why -f json`.
    pub why: Value,
    /// The objects of `check -f jsonl`.
    pub findings: Vec<Value>,
    /// All signals, in order.
    pub signals: Vec<ListedSignal>,
    pub warnings: Vec<String>,
    /// Error that ended reading early.
    pub failure: Option<String>,
}

impl PassResults {
    /// Reads a capture.
    ///
    /// # Errors
    /// It cannot be opened, has an unknown format, or contains no frames.
    pub fn of(
        series: &CaptureSeries,
        input: &InputArgs,
        options: &SessionOptions,
        rules: &Arc<RuleSetup>,
    ) -> anyhow::Result<Self> {
        let (name, select) = (series.name(), SelectArgs::default());
        let question = question(input, &select, None);
        let parts =
            (Statistics::default(), SelectedFacts::new(question.clone(), &select)?, SignalList::default());
        let job = CaptureJob::new(series, input, options, Some(rules)).quiet(true);
        let read = job.read_from(parts, |parts, first, span| parts.1.begin(first, span))?;
        let failure = read.failure_text();
        let ReadCapture { summary, format, mut warnings, unreadable, .. } = read;
        let (frames, last) = (summary.frames(), summary.last_time());
        let Summary { findings, part: (statistics, facts, signals), decoder, first } = summary;
        let Some(first) = first else { bail!("{name}: contains no frames") };
        let buses = decoder.buses();
        let (why_facts, selected, _) = facts.results(&findings, first.time);
        let setting = DiagnosisContext { zero: first.time, end: None, is_growing: false };
        let stories = diagnosis(&findings, &selected, setting, (&question, buses));
        let answer = why_facts.build_report(stories, buses, &options.catalogue);
        let why = serde_json::to_value(StoriesAnswer::new(&answer, buses, first.time, None, &name))?;
        let statistics = CaptureStatistics::new((&name, format), &statistics, buses, Bus::bit_rate);
        let statistics = serde_json::to_value(statistics)?;
        let findings = findings_of(CaptureResult {
            capture: name.clone(),
            frames,
            first: first.time,
            last,
            findings,
            ..CaptureResult::default()
        })?;
        warnings.extend(unreadable);
        let signals = signals.into_sorted();
        Ok(Self { decoder, first, statistics, why, findings, signals, warnings, failure })
    }
}

/// The objects of `check -f jsonl`.
///
/// # Errors
/// If they cannot be written.
pub fn findings_of(judged: CaptureResult) -> anyhow::Result<Vec<Value>> {
    let report = FindingsReport { captures: vec![judged], ..FindingsReport::default() };
    report.records().map(|record| Ok(serde_json::to_value(record)?)).collect()
}
