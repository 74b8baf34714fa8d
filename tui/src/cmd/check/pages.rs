//! `check --report`: a page per failed capture, and an index page of all captures.

use std::collections::BTreeSet;
use std::path::Path;
use std::sync::Arc;

use cobscope_decoder::rules::Setup;
use cobscope_decoder::session::SessionOptions;
use cobscope_decoder::sink::findings::{Outcome, Report};
use cobscope_decoder::why::Question;

use crate::cli::{CheckArgs, PageStyle};
use crate::cmd::captures::SourceSeries;
use crate::cmd::messages::{Refusal, complain};
use crate::cmd::output::files_read;
use crate::cmd::report::{FolderCapture, PageFolder, ReportScope, compose, counts};
use crate::exit_code::Exit;

/// Writes the pages; `sources` are the captures of the report, in its order.
///
/// # Errors
/// If the folder or a page cannot be written.
pub(super) fn write(
    report: &Report,
    sources: &[&SourceSeries],
    (folder, arguments): (&Path, &CheckArgs),
    (options, setup): (&SessionOptions, &Arc<Setup>),
) -> Result<Exit, Refusal> {
    let read = sources.iter().flat_map(|source| source.series.parts.clone());
    let read = read.chain(files_read(&arguments.input)).collect();
    let mut pages =
        PageFolder::create(folder, PageStyle::Html, read).map_err(|error| (Exit::Usage, error))?;
    let mut exit = Exit::Clean;
    for (source, judged) in sources.iter().zip(&report.captures) {
        let outcome = judged.outcome(report.least);
        let kept: BTreeSet<u64> = judged.telling().map(|group| group.id).collect();
        let scope = ReportScope {
            input: &arguments.input,
            select: &arguments.select,
            question: Question::default(),
            finding: None,
            kept: Some(&kept),
            is_cut: false,
            is_quiet: false,
        };
        let is_reported = outcome == Outcome::Failed || (outcome == Outcome::Unreadable && judged.frames > 0);
        let composed = is_reported.then(|| compose(&source.series, &scope, options, setup));
        let mut composed = match composed {
            Some(Ok(composed)) => Some(composed),
            // The capture was readable before: it has changed, or is a pipe.
            Some(Err(error)) => {
                complain(&error);
                exit = exit.max(Exit::Capture);
                None
            }
            None => None,
        };
        let remark = judged.failure.clone().unwrap_or_else(|| outcome.name().to_owned());
        let own = FolderCapture {
            capture: &judged.capture,
            composed: composed.as_mut(),
            remark,
            rules: counts(judged.telling()),
        };
        exit = exit.max(pages.add(own, None)?);
    }
    let names: Vec<_> = arguments.input.captures.iter().map(|path| path.display().to_string()).collect();
    Ok(exit.max(pages.finish(&names.join(", "))?))
}
