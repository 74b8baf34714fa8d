//! `cobscope why`: the diagnosis as stories, the changes before the first one, and the gates closed at that
//! time.

use std::fmt::Write as _;
use std::sync::Arc;

use cobscope_decoder::Summary;
use cobscope_decoder::answers::format_line;
use cobscope_decoder::answers::stories::StoriesAnswer;
use cobscope_decoder::diagnosis;
use cobscope_decoder::rules::RuleSetup;
use cobscope_decoder::session::SessionOptions;
use cobscope_decoder::sink::escape;
use cobscope_decoder::why::WhyScope;
use cobscope_decoder::why::text::{self, WhyTextContext};

use super::decoding::{CaptureJob, ReadCapture, report_with};
use super::facts::{SelectedFacts, diagnosis, ensure_story, question, unknown_buses};
use super::input::{build_setup, check_rules_of, session_options};
use super::messages::{Refusal, print_error, print_warning};
use crate::cli::{ReportFormat, WhyArgs};
use crate::exit_code::ExitStatus;
use crate::select::TimeLimit;

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
