//! `cobscope why`: the diagnosis as stories, the changes before the first one, and the gates closed at that
//! time.

use std::fmt::Write as _;
use std::sync::Arc;

use clap::Args;
use cobscope_decoder::Summary;
use cobscope_decoder::answers::format_line;
use cobscope_decoder::answers::stories::StoriesAnswer;
use cobscope_decoder::answers::stories::text::{self, WhyTextContext};
use cobscope_decoder::diagnosis;
use cobscope_decoder::rules::RuleSetup;
use cobscope_decoder::session::SessionOptions;
use cobscope_decoder::sink::escape;
use cobscope_decoder::why::WhyScope;

use crate::exit_code::ExitStatus;
use crate::run::arguments::{
    InputArgs, NODE_HELP, ReportFormat, SelectArgs, examples, finding_filter_help, from_help, parse_count,
};
use crate::run::capture_job::{CaptureJob, ReadCapture, report_with};
use crate::run::input::{build_setup, check_rules_of, session_options};
use crate::run::messages::{Refusal, print_error, print_warning};
use crate::run::selected_facts::{SelectedFacts, diagnosis, ensure_story, question, unknown_buses};
use crate::select::{RangeBound, TimeLimit};

/// Examples in the help.
const EXAMPLES: &str = examples![
    "cobscope why customer.log",
    "cobscope why --node 5 --at 12.5 customer.log",
    "cobscope why --node 5 --node 5=wandfluh-md2 -f json customer.log",
];

/// Show the most likely cause, its effects, and the steps to take
///
/// --node 5 selects the node; --node 5=PROFILE assigns its profile. They can be combined.
#[derive(Debug, Args)]
#[command(after_help = EXAMPLES)]
#[command(mut_arg("node", |arg| arg.value_name("[BUS:]ID[=PROFILE]").help(NODE_HELP)))]
#[command(mut_arg("filter", |arg| arg.help("Report only faults whose event matches EXPR").long_help(finding_filter_help!("Report only faults whose event matches EXPR"))))]
#[command(mut_arg("from", |arg| arg.help("Report only faults from WHEN on: 12.5 (seconds), #1234 (frame), 22:13:25, a date, or both").long_help(from_help!("Report only faults from WHEN on"))))]
#[command(mut_arg("to", |arg| arg.help("Report only faults up to WHEN, in the form of --from")))]
#[command(mut_arg("only_node", |arg| arg.help("Report only faults of a node: 5, can0:5, sa:0x80 (repeatable)")))]
pub struct WhyArgs {
    #[command(flatten)]
    pub input: InputArgs,
    #[command(flatten)]
    pub select: SelectArgs,
    /// Show the latest story before TIME: 12.5 (seconds from the first frame), #1234 (frame), 22:13:25, a date,
    /// or both
    #[arg(long, value_name = "TIME")]
    pub at: Option<RangeBound>,
    /// Show story N only; stories are numbered by importance
    #[arg(long, value_name = "N", value_parser = parse_count)]
    pub story: Option<std::num::NonZeroUsize>,
    /// Output format
    #[arg(short, long, value_name = "FORMAT", default_value = "text")]
    pub format: ReportFormat,
}

/// Runs the command.
pub fn run(arguments: &WhyArgs) -> ExitStatus {
    let (options, setup) = match ready(arguments) {
        Ok(ready) => ready,
        Err((exit, error)) => {
            print_error(&error);
            return exit;
        }
    };
    let several = arguments.input.captures.len() > 1;
    report_with(&arguments.input, &options, |series, options, output| {
        let question = question(&arguments.input, &arguments.select, arguments.story);
        let question = WhyScope { latest: arguments.at.is_some(), ..question };
        let facts = SelectedFacts::new(question.clone(), &arguments.select)?;
        let limit = TimeLimit::new(arguments.at, arguments.select.to);
        let job = CaptureJob::new(series, &arguments.input, options, Some(&setup));
        let read = job.read_from((facts, limit), |(facts, limit), first, span| {
            limit.begin_capture(first, span)?;
            facts.begin(first, span)
        })?;
        let name = series.name();
        read.report();
        let ReadCapture { summary, failure, .. } = read;
        let (last, frames) = (summary.last_time(), summary.frames());
        let Summary { findings, part: (facts, limit), decoder, .. } = summary;
        let (buses, first) = (decoder.buses(), limit.first_time());
        if let Some(missed) = facts.missed(frames, last) {
            print_error(&anyhow::anyhow!("{name}: {missed}"));
        }
        for unknown in unknown_buses(&name, &arguments.select, buses) {
            print_warning(&unknown);
        }
        let is_of_moment = question.latest;
        let end = limit.end_text();
        let (at, to) = if is_of_moment { (end.as_deref(), None) } else { (None, end.as_deref()) };
        let setting = diagnosis::DiagnosisContext {
            zero: first,
            end: last.filter(|_| is_of_moment),
            is_growing: limit.passed_bound().is_some(),
        };
        let (why, selected, scope) = facts.results(&findings, first);
        let diagnosis = diagnosis(&findings, &selected, setting, (&question, buses));
        ensure_story(&name, question.story, &diagnosis, failure.as_ref())?;
        let answer = why.build_report(diagnosis, buses, &options.catalogue);
        match arguments.format {
            ReportFormat::Text => {
                if several && !series.is_joined_from(&arguments.input.captures) {
                    let _ = writeln!(output, "== {}", escape(&name));
                }
                text::write_report(&answer, &WhyTextContext { buses, first, at, to, scope: &scope }, output);
            }
            ReportFormat::Json => {
                output.push_str(&format_line(&StoriesAnswer::new(&answer, buses, first, at, &name)));
            }
        }
        Ok(failure)
    })
}

/// Options for decoding, and rules.
///
/// # Errors
/// If an option, the bus file or a profile is not valid.
fn ready(arguments: &WhyArgs) -> Result<(SessionOptions, Arc<RuleSetup>), Refusal> {
    let (usage, profile) = (|error| (ExitStatus::Usage, error), |error| (ExitStatus::Profile, error));
    arguments.select.selection().map_err(usage)?;
    let options = session_options(&arguments.input).map_err(profile)?;
    let setup = build_setup(&arguments.input, &options.catalogue, None).map_err(profile)?;
    check_rules_of(arguments.select.filter.as_ref(), &setup).map_err(usage)?;
    Ok((options, Arc::new(setup)))
}
