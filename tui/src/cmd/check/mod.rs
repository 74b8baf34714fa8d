//! `cobscope check`: checks captures against rules.

mod arguments;
mod judge;
mod known;
mod pages;

use std::io::{self, Write};
use std::sync::Arc;

use anyhow::Context as _;
use cobscope_decoder::event::KindSet;
use cobscope_decoder::rules::{RuleSelection, RuleSetup};
use cobscope_decoder::session::SessionOptions;
use cobscope_decoder::sink::findings::{FindingTextOptions, FindingsReport};
use cobscope_decoder::words::count_noun;
use serde_json::Value;

use super::report;
use crate::exit_code::ExitStatus;
use crate::path_text::path_text;
use crate::run::captures::{self, InputFile, SourceSeries};
use crate::run::input::{
    build_setup, check_rules_of, common_catalogue, load_catalogue, options_of, with_user_folder,
};
use crate::run::messages::{Refusal, print_error, print_note, print_warning};
use crate::run::output::{ensure_not_read, files_read, is_colored, write_result};
use crate::run::replaced::{OwnFile, open_replacing};
pub use arguments::CheckArgs;
#[cfg(feature = "parquet")]
pub(super) use judge::{line_numbers, parts};
use known::KnownFindings;

/// Runs the command.
pub fn run(arguments: &CheckArgs) -> ExitStatus {
    match checked(arguments) {
        Ok(exit) => exit,
        Err((exit, error)) => {
            print_error(&error);
            exit
        }
    }
}

fn checked(arguments: &CheckArgs) -> Result<ExitStatus, Refusal> {
    let (options, setup) = ready(arguments)?;
    check_names(arguments, &setup)?;
    if arguments.report.is_some() {
        report::ensure_files(&arguments.input.captures).map_err(|error| (ExitStatus::Usage, error))?;
    }
    let captures = captures_to_read(arguments).map_err(|error| (ExitStatus::Usage, error))?;
    let known = KnownFindings::read(arguments)?;
    // Opens the output before the check, so that an error is reported at once.
    let mut output = open_replacing(arguments.output.as_deref(), OwnFile::Findings, &arguments.baseline)
        .map_err(|error| (ExitStatus::Usage, error))?;

    let captures = captures::series(&captures, &arguments.input);
    let CheckResults { report, found, mut exit } = judged(arguments, &captures, (&options, &setup), known)?;
    if let Some(folder) = &arguments.report {
        exit = exit.max(pages::write(&report, &found, (folder, arguments), (&options, &setup))?);
    }
    let written = write(&report, arguments, &mut output).and_then(|()| output.finish());
    Ok(exit.max(write_result(written)))
}

/// Results of all captures.
struct CheckResults<'a> {
    report: FindingsReport,
    /// Captures of a known format.
    found: Vec<&'a SourceSeries>,
    exit: ExitStatus,
}

/// Checks captures.
///
/// # Errors
/// If the baseline cannot be written.
fn judged<'a>(
    arguments: &CheckArgs,
    captures: &'a [SourceSeries],
    (options, setup): (&SessionOptions, &Arc<RuleSetup>),
    known: KnownFindings<'_>,
) -> Result<CheckResults<'a>, Refusal> {
    let judged = judge::judge_all(captures, arguments, options, setup);
    let mut exit = ExitStatus::Clean;
    let mut messages: Vec<String> = judged.iter().flat_map(|one| one.messages.clone()).collect();
    let found: Vec<_> = captures.iter().zip(&judged).filter(|(_, one)| one.judged.is_some()).collect();
    let found: Vec<_> = found.into_iter().map(|(source, _)| source).collect();
    let empty = captures::without_captures(&arguments.input.captures, &found);
    if !empty.is_empty() || judged.iter().any(|one| one.has_failed) {
        exit = exit.max(ExitStatus::Capture);
    }
    messages.extend(empty.iter().map(|folder| format!("{}: no captures", path_text(folder))));
    for message in messages {
        print_warning(&message);
    }
    let judged = judged.into_iter().filter_map(|one| Some((one.judged?, one.selected)));
    let (results, selected): (Vec<_>, Vec<_>) = judged.unzip();
    let mut report = FindingsReport {
        captures: results,
        least: arguments.fail_on.lowest_severity(),
        ..FindingsReport::default()
    };
    report.require_rules(&arguments.require_exercised);
    known.apply(&mut report, exit).map_err(|error| (ExitStatus::Capture, error))?;
    // The baseline covers all findings, also those that are not printed.
    for (capture, selected) in report.captures.iter_mut().zip(selected) {
        if let Some(selected) = selected {
            let all = capture.new_findings().count();
            capture.findings.groups.retain(|group| selected.contains(&group.id));
            let hidden = all.saturating_sub(capture.new_findings().count());
            if hidden > 0 {
                let name = &capture.capture;
                print_note(&format!("{name}: {} of {all} not selected", count_noun(hidden, "finding")));
            }
        }
    }
    if report.has_failed() {
        exit = exit.max(ExitStatus::Findings);
    }
    Ok(CheckResults { report, found, exit })
}

/// Findings of `-f jsonl` and the exit status, without any output of the command.
///
/// # Errors
/// As for the command.
pub(super) fn lines(arguments: &CheckArgs) -> Result<(Vec<u8>, Vec<Value>, ExitStatus), Refusal> {
    let (options, setup) = ready(arguments)?;
    check_names(arguments, &setup)?;
    let captures = captures_to_read(arguments).map_err(|error| (ExitStatus::Usage, error))?;
    let known = KnownFindings::read(arguments)?;
    let captures = captures::series(&captures, &arguments.input);
    let judged = judged(arguments, &captures, (&options, &setup), known)?;
    let mut lines = Vec::new();
    write(&judged.report, arguments, &mut lines).map_err(|error| (ExitStatus::Capture, error.into()))?;
    let records = judged.report.records().filter_map(|record| serde_json::to_value(record).ok());
    Ok((lines, records.collect(), judged.exit))
}

/// Checks the rules that the options name.
fn check_names(arguments: &CheckArgs, setup: &RuleSetup) -> Result<(), Refusal> {
    for rule in &arguments.require_exercised {
        let known = setup.check_name(rule).map_err(anyhow::Error::msg);
        known.context("--require-exercised").map_err(|error| (ExitStatus::Usage, error))?;
    }
    known::check_update(arguments).map_err(|error| (ExitStatus::Usage, error))?;
    check_selection(arguments, setup).map_err(|error| (ExitStatus::Usage, error))
}

/// Captures to check. None of them is overwritten; an output file in a checked folder is not checked.
fn captures_to_read(arguments: &CheckArgs) -> anyhow::Result<Vec<InputFile>> {
    let mut captures = captures::captures(&arguments.input.captures);
    let baseline = arguments.baseline.iter().filter(|_| arguments.update_baseline);
    for path in arguments.output.iter().chain(baseline) {
        ensure_not_read(path, &files_read(&arguments.input))?;
        for source in &captures {
            let other = ensure_not_read(path, [&source.path]);
            if other.is_err() && captures::is_capture(source, &arguments.input) {
                other?;
            }
        }
        captures.retain(|source| ensure_not_read(path, [&source.path]).is_ok());
    }
    Ok(captures)
}

/// Checks the options that select findings.
///
/// # Errors
/// If the filter cannot match a finding or names an unknown rule, or the range is empty.
fn check_selection(arguments: &CheckArgs, setup: &RuleSetup) -> anyhow::Result<()> {
    arguments.select.selection()?;
    let filter = arguments.select.filter.as_ref();
    check_rules_of(filter, setup)?;
    if let Some(filter) = filter {
        anyhow::ensure!(
            filter.kinds().and(KindSet::FINDINGS) != KindSet::NONE,
            "--filter '{filter}': never true for a finding; its fields are rule, severity, node, object, text"
        );
    }
    Ok(())
}

/// Options for decoding and rules.
///
/// # Errors
/// If a rule of `--select` or `--ignore` is unknown, or the bus file or a profile is not valid.
pub(super) fn ready(arguments: &CheckArgs) -> Result<(SessionOptions, Arc<RuleSetup>), Refusal> {
    let folders = &arguments.input.profiles;
    let profile = |error| (ExitStatus::Profile, with_user_folder(error, folders));
    let catalogue = if arguments.user_profiles { load_catalogue(folders) } else { common_catalogue(folders) };
    let options = options_of(&arguments.input, catalogue).map_err(profile)?;
    let setup = build_setup(&arguments.input, &options.catalogue, arguments.today).map_err(profile)?;
    let (select, ignore) = (&arguments.selected_rules, &arguments.ignored_rules);
    for (option, patterns) in [("--select", select), ("--ignore", ignore)] {
        for pattern in patterns {
            let known = setup.check_pattern(pattern).map_err(anyhow::Error::msg);
            known.context(option).map_err(|error| (ExitStatus::Usage, error))?;
        }
    }
    let selection = RuleSelection { select: select.clone(), ignore: ignore.clone() };
    let setup =
        setup.select_rules(selection).map_err(|error| (ExitStatus::Usage, anyhow::Error::msg(error)))?;
    Ok((options, Arc::new(setup)))
}

fn write(report: &FindingsReport, arguments: &CheckArgs, output: &mut dyn Write) -> io::Result<()> {
    let color = is_colored(arguments.color, arguments.output.is_some());
    let options = FindingTextOptions { color, verbose: arguments.verbose, coverage: arguments.coverage };
    (arguments.format.write)(report, options, output)
}
