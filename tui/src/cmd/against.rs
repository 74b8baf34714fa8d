//! Comparison of the captures in the terminal UI with another one.

use std::path::Path;
use std::sync::mpsc::Sender;

use anyhow::{Context as _, ensure};
use cobscope_decoder::session::SessionOptions;

use super::diff::{ComparisonJob, one};
use super::input::{captures, join_options, read_options};
use crate::cli::InputArgs;
use crate::source::{CaptureFile, relate};
use crate::timeline::News;

/// Prepares the comparison of the captures with `good`.
///
/// # Errors
/// If `good` is missing, or the other captures are several ones or stdin.
pub(super) fn job(good: &Path, input: &InputArgs, options: &SessionOptions) -> anyhow::Result<ComparisonJob> {
    let shown = good.display();
    std::fs::metadata(good).with_context(|| format!("--against {shown}: cannot be opened"))?;
    let paths = captures(input);
    ensure!(
        paths.iter().all(|path| path.as_os_str() != "-"),
        "--against reads a capture twice; stdin cannot be read again, open a file"
    );
    let files = paths.into_iter().map(|path| CaptureFile { path, is_listed: true }).collect();
    let mut all = relate(files, &read_options(input), join_options(input)).series();
    let count = all.len();
    let bad = all.pop().filter(|_| count == 1);
    let bad = bad.with_context(|| format!("--against compares one capture; found {count}"))?;
    Ok(ComparisonJob { good: one(good, input)?, bad, input: input.clone(), options: options.clone() })
}

/// Runs a comparison in a thread of its own; the result is sent to `news`.
///
/// # Errors
/// If the thread cannot be started.
pub(super) fn start(job: ComparisonJob, news: Sender<News>) -> anyhow::Result<()> {
    let run = move || {
        let result = job.run().map(Box::new).map_err(|error| format!("{error:#}"));
        // The application may have ended.
        let _ = news.send(News::Compared(result));
    };
    std::thread::Builder::new().name("against".into()).spawn(run).context("cannot start a thread")?;
    Ok(())
}
