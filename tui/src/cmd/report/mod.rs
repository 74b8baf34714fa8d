//! `cobscope report`: a page with claim, evidence and origin.
//!
//! ```text
//! capture ─▶ reading (findings, then evidence) ─▶ attach ─▶ page: HTML or Markdown
//! folder  ─▶ one page per capture ─▶ folder: index page
//! ```

mod arguments;
mod attach;
mod background;
#[cfg(feature = "parquet")]
mod fleet;
mod folder;
mod page;
mod provenance;
mod reading;

use std::path::PathBuf;
use std::sync::Arc;

use cobscope_decoder::rules::RuleSetup;
use cobscope_decoder::session::SessionOptions;

pub(super) use background::PageJob;
pub(super) use folder::{FolderCapture, PageFolder, counts};
pub(super) use provenance::provenance;
pub(super) use reading::{ReportScope, compose};

use crate::exit_code::ExitStatus;
use crate::run::captures::{self, SourceSeries};
use crate::run::input::{build_setup, check_rules_of, session_options};
use crate::run::messages::{Refusal, exit_of, print_error};
use crate::run::output::files_read;
use crate::run::replaced::{OwnFile, ensure_replaceable};
use arguments::FindingArg;
pub use arguments::{PageStyle, ReportArgs};

/// Runs the command.
pub fn run(arguments: &ReportArgs) -> ExitStatus {
    match reported(arguments) {
        Ok(exit) => exit,
        Err((exit, error)) => {
            print_error(&error);
            exit
        }
    }
}

fn reported(arguments: &ReportArgs) -> Result<ExitStatus, Refusal> {
    #[cfg(feature = "parquet")]
    if let Some(lake) = &arguments.lake {
        return fleet::write(lake, arguments.output.as_deref());
    }
    let usage = |error| (ExitStatus::Usage, error);
    let profile = |error| (ExitStatus::Profile, error);
    arguments.select.selection().map_err(usage)?;
    attach::check(arguments).map_err(usage)?;
    let input = &arguments.input;
    let named = &input.captures;
    ensure_files(named).map_err(usage)?;
    let options = session_options(input).map_err(profile)?;
    let rules = Arc::new(build_setup(input, &options.catalogue, None).map_err(profile)?);
    if let Some(FindingArg::Rule(rule)) = &arguments.finding {
        rules.check_name(rule).map_err(|error| usage(anyhow::anyhow!("--finding: {error}")))?;
    }
    check_rules_of(arguments.select.filter.as_ref(), &rules).map_err(usage)?;
    let all = captures::series(&captures::captures(named), input);
    match all.as_slice() {
        [one] if one.folder.is_none() => single(one, arguments, &options, &rules),
        all => folder::write(all, arguments, &options, &rules),
    }
}

/// Checks that all captures can be read twice.
///
/// # Errors
/// If one of them is stdin.
pub(super) fn ensure_files(captures: &[PathBuf]) -> anyhow::Result<()> {
    let is_stdin = captures.is_empty() || captures.iter().any(|path| path.as_os_str() == "-");
    anyhow::ensure!(!is_stdin, "a report reads a capture twice; stdin cannot be read again, give a file");
    Ok(())
}

/// One capture: a page to a file or to stdout.
fn single(
    source: &SourceSeries,
    arguments: &ReportArgs,
    options: &SessionOptions,
    rules: &Arc<RuleSetup>,
) -> Result<ExitStatus, Refusal> {
    let read = files_read(&arguments.input);
    let path = arguments.output.as_deref();
    ensure_replaceable(path, OwnFile::Page, &read).map_err(|error| (ExitStatus::Usage, error))?;
    let mut composed = compose(&source.series, &ReportScope::of(arguments), options, rules)
        .map_err(|error| (exit_of(&error), error))?;
    attach::attach(&mut composed, arguments.attach, path, &read)?;
    let mut exit = page::write(&composed.report, arguments.format, path, &read)?;
    if let Some(failure) = &composed.failure {
        print_error(failure);
        exit = exit.max(ExitStatus::Capture);
    }
    Ok(exit)
}
