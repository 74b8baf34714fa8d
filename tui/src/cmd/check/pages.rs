//! `check --report`: a page per failed capture, and an index page of all captures.

use std::collections::BTreeSet;
use std::path::Path;
use std::sync::Arc;

use cobscope_decoder::rules::RuleSetup;
use cobscope_decoder::session::SessionOptions;
use cobscope_decoder::sink::findings::{CaptureOutcome, FindingsReport};
use cobscope_decoder::why::WhyScope;

use super::arguments::CheckArgs;
use crate::cmd::report::PageStyle;
use crate::cmd::report::{FolderCapture, PageFolder, ReportScope, compose, counts};
use crate::exit_code::ExitStatus;
use crate::run::captures::SourceSeries;
use crate::run::messages::{Refusal, print_error};
use crate::run::output::files_read;

/// Writes the pages; `sources` are the captures of the report, in its order.
///
/// # Errors
/// If the folder or a page cannot be written.
pub(super) fn write(
    report: &FindingsReport,
    sources: &[&SourceSeries],
    (folder, arguments): (&Path, &CheckArgs),
    (options, setup): (&SessionOptions, &Arc<RuleSetup>),
) -> Result<ExitStatus, Refusal> {
    let read = sources.iter().flat_map(|source| source.series.parts.clone());
    let read = read.chain(files_read(&arguments.input)).collect();
    let mut pages =
        PageFolder::create(folder, PageStyle::Html, read).map_err(|error| (ExitStatus::Usage, error))?;
    let mut exit = ExitStatus::Clean;
    for (source, judged) in sources.iter().zip(&report.captures) {
        let outcome = judged.overall_outcome(report.least);
        let kept: BTreeSet<u64> = judged.new_findings().map(|group| group.id).collect();
        let scope = ReportScope {
            input: &arguments.input,
            select: &arguments.select,
            question: WhyScope::default(),
            finding: None,
            kept: Some(&kept),
            is_cut: false,
            is_quiet: false,
        };
        let is_reported =
            outcome == CaptureOutcome::Failed || (outcome == CaptureOutcome::Unreadable && judged.frames > 0);
        let composed = is_reported.then(|| compose(&source.series, &scope, options, setup));
        let mut composed = match composed {
            Some(Ok(composed)) => Some(composed),
            // The capture was readable before: it has changed, or is a pipe.
            Some(Err(error)) => {
                print_error(&error);
                exit = exit.max(ExitStatus::Capture);
                None
            }
            None => None,
        };
        let remark = judged.failure.clone().unwrap_or_else(|| outcome.name().to_owned());
        let own = FolderCapture {
            capture: &judged.capture,
            composed: composed.as_mut(),
            remark,
            rules: counts(judged.new_findings()),
        };
        exit = exit.max(pages.add(own, None)?);
    }
    let names: Vec<_> = arguments.input.captures.iter().map(|path| path.display().to_string()).collect();
    Ok(exit.max(pages.finish(&names.join(", "))?))
}
