//! The two readings of a capture: findings first, then the evidence.

use std::collections::BTreeSet;
use std::sync::Arc;

use cobscope_decoder::Summary;
use cobscope_decoder::diagnosis;
use cobscope_decoder::event::Event;
use cobscope_decoder::finding::CaptureFindings;
use cobscope_decoder::frame::Frame;
use cobscope_decoder::reading::{FrameDemand, ReadingPart};
use cobscope_decoder::report::{CaptureReport, CommentedExcerpt, ReportDraft, ReportGround};
use cobscope_decoder::rules::RuleSetup;
use cobscope_decoder::session::{Bus, BusSnapshot, MessagePreview, SessionOptions};
use cobscope_decoder::sink::escape;
use cobscope_decoder::statistics::Statistics;
use cobscope_decoder::why::WhyScope;

use super::arguments::{AttachPlace, FindingArg, ReportArgs};
use super::provenance::provenance;
use crate::run::arguments::{InputArgs, SelectArgs};
use crate::run::capture_job::{CaptureJob, ReadCapture};
use crate::run::messages::{absent_value, print_note, print_warning};
use crate::run::selected_facts::{SelectedFacts, diagnosis, ensure_story, question, unknown_buses};
use crate::source::CaptureSeries;

/// What to report on.
pub(in crate::cmd) struct ReportScope<'a> {
    /// Input options.
    pub(in crate::cmd) input: &'a InputArgs,
    /// Range, filter and nodes.
    pub(in crate::cmd) select: &'a SelectArgs,
    /// Chosen node and story.
    pub(in crate::cmd) question: WhyScope,
    /// Only stories with this finding.
    pub(in crate::cmd) finding: Option<&'a FindingArg>,
    /// Only stories with one of these findings; `None` for all.
    pub(in crate::cmd) kept: Option<&'a BTreeSet<u64>>,
    /// Whether the cut-out capture is written next to the page, with its bus file.
    pub(in crate::cmd) is_cut: bool,
    /// Whether stderr belongs to the terminal UI: nothing is printed.
    pub(in crate::cmd) is_quiet: bool,
}

impl<'a> ReportScope<'a> {
    /// The scope of a command line.
    pub(super) fn of(arguments: &'a ReportArgs) -> Self {
        Self {
            input: &arguments.input,
            select: &arguments.select,
            question: question(&arguments.input, &arguments.select, arguments.story),
            finding: arguments.finding.as_ref(),
            kept: None,
            is_cut: arguments.attach == Some(AttachPlace::File),
            is_quiet: false,
        }
    }
}

/// A report with the frames around its claims.
pub(in crate::cmd) struct ComposedReport {
    /// The report.
    pub(in crate::cmd) report: CaptureReport,
    /// Frames around the claims.
    pub(in crate::cmd) excerpt: CommentedExcerpt,
    /// All findings.
    pub(in crate::cmd) findings: CaptureFindings,
    /// Error that ended reading early.
    pub(in crate::cmd) failure: Option<anyhow::Error>,
    /// State before the frames around the claims, for a file next to the page.
    pub(in crate::cmd) start: Option<ReportCutStart>,
}

/// State before a cut-out capture.
pub(in crate::cmd) struct ReportCutStart {
    /// State of all buses.
    pub(super) state: BusSnapshot,
    /// Options with the files of the user.
    pub(super) input: InputArgs,
    /// First line of the bus file.
    pub(super) title: String,
}

/// Reads a capture twice.
///
/// # Errors
/// If the capture cannot be opened or recognised, contains no frames, or the requested story or finding does not exist.
pub(in crate::cmd) fn compose(
    series: &CaptureSeries,
    scope: &ReportScope<'_>,
    options: &SessionOptions,
    setup: &Arc<RuleSetup>,
) -> anyhow::Result<ComposedReport> {
    let name = series.name();
    let job = CaptureJob::new(series, scope.input, options, Some(setup)).quiet(scope.is_quiet);
    let facts = SelectedFacts::new(scope.question.clone(), scope.select)?;
    let read =
        job.read_from((Statistics::default(), facts), |part, first, span| part.1.begin(first, span))?;
    if !scope.is_quiet {
        read.report();
        report_selection(&name, scope.select, &read.summary);
    }
    let failure_text = read.failure_text();
    let ReadCapture { summary, format, failure, .. } = read;
    let first = summary.first_time();
    let Summary { findings, part: (statistics, facts), decoder, .. } = summary;
    let buses = decoder.buses();
    let (why, selected, limits) = facts.results(&findings, first);
    let setting = diagnosis::DiagnosisContext { zero: first, end: None, is_growing: false };
    let mut diagnosis = diagnosis(&findings, &selected, setting, (&scope.question, buses));
    let wanted = wanted(scope, &findings);
    diagnosis
        .stories
        .retain(|story| wanted.as_ref().is_none_or(|it| it.iter().any(|id| story.findings.contains(id))));
    ensure_story(&name, scope.question.story, &diagnosis, failure.as_ref())?;
    if let Some(finding) = scope.finding.filter(|_| diagnosis.stories.is_empty()) {
        let shown = match finding {
            FindingArg::Id(id) => id.to_string(),
            FindingArg::Rule(rule) => rule.clone(),
        };
        let text = format!("{name}: --finding {shown}: {}", without_story(&findings, wanted.as_ref()));
        return Err(absent_value(text, failure.as_ref()));
    }
    let answer = why.build_report(diagnosis, buses, &options.catalogue);
    let draft = ReportDraft::new(&ReportGround {
        answer: &answer,
        findings: &findings,
        statistics: &statistics,
        buses,
        first,
        capture: &name,
        format,
        failure: failure_text.as_deref(),
        scope: &limits,
    });
    let evidence = CaptureJob { setup: None, ..job };
    let Summary { part: draft, decoder, .. } = evidence.read(draft)?.summary;
    let made = provenance(series, scope.input, (&options.catalogue, decoder.buses()));
    let (report, excerpt) = draft.finish_report(decoder.buses(), made);
    let first = excerpt.first_frame().filter(|_| scope.is_cut);
    let start = first.map(|first| start_of_cut(series, scope.input, options, first)).transpose()?;
    Ok(ComposedReport { report, excerpt, findings, failure, start })
}

/// Prints notes on a range after the end of the capture, and on unknown buses.
fn report_selection<P>(name: &str, select: &SelectArgs, summary: &Summary<(P, SelectedFacts)>) {
    if let Some(missed) = summary.part.1.missed(summary.frames(), summary.last_time()) {
        print_note(&format!("{name}: {missed}"));
    }
    for unknown in unknown_buses(name, select, summary.buses()) {
        print_warning(&unknown);
    }
}

/// Reads the capture up to the first frame of the cut-out capture.
///
/// # Errors
/// If the capture can no longer be read.
fn start_of_cut(
    series: &CaptureSeries,
    input: &InputArgs,
    options: &SessionOptions,
    first: u64,
) -> anyhow::Result<ReportCutStart> {
    let read = CaptureJob::new(series, input, options, None).quiet(true).read(UntilFrame(first))?;
    let title = format!("State before frame {first} of {}", escape(&series.name()));
    Ok(ReportCutStart { state: BusSnapshot::snapshot_of(read.summary.buses()), input: input.clone(), title })
}

/// Ends decoding before a frame.
struct UntilFrame(u64);

impl ReadingPart for UntilFrame {
    fn event(&mut self, _event: &Event, _bus: &Bus) {}

    fn need(&self, _preview: &MessagePreview, _bus: &Bus) -> bool {
        false
    }

    fn demand(&self) -> FrameDemand {
        FrameDemand::Each
    }

    fn ends_before(&mut self, frame: &Frame) -> bool {
        frame.number >= self.0
    }
}

/// Findings of the stories to report; `None` for all.
fn wanted(scope: &ReportScope<'_>, findings: &CaptureFindings) -> Option<BTreeSet<u64>> {
    let is_meant = |id: u64, rule: &str| match scope.finding {
        Some(FindingArg::Id(wanted)) => *wanted == id,
        Some(FindingArg::Rule(wanted)) => wanted == rule,
        None => true,
    };
    let is_kept = |id: u64| scope.kept.is_none_or(|kept| kept.contains(&id));
    let is_all = scope.finding.is_none() && scope.kept.is_none();
    let all = findings.groups.iter().filter(|group| is_meant(group.id, &group.rule) && is_kept(group.id));
    (!is_all).then(|| all.map(|group| group.id).collect())
}

/// Reason why no story contains the requested findings.
fn without_story(findings: &CaptureFindings, wanted: Option<&BTreeSet<u64>>) -> String {
    let reason = wanted.into_iter().flatten().find_map(|id| findings.group_by_id(*id)?.omission());
    let no_such = "no such finding (cobscope check -f jsonl)".to_owned();
    reason.map_or(no_such, |reason| format!("{reason}, in no story; a report needs a story"))
}
