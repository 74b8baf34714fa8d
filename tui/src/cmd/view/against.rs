//! Comparison of the captures in the terminal UI with another one.

use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::mpsc::Sender;

use anyhow::{Context as _, ensure};
use cobscope_decoder::session::SessionOptions;

use crate::app::Compare;
use crate::cmd::diff::{ComparisonJob, one};
use crate::run::arguments::InputArgs;
use crate::run::input::{capture_paths, join_options, read_options};
use crate::source::{CaptureFile, relate_files};
use crate::timeline::TimelineNews;

/// Prepares the comparison of the captures with `good`.
///
/// # Errors
/// If `good` is missing, or the other captures are several ones or stdin.
pub(super) fn job(good: &Path, input: &InputArgs, options: &SessionOptions) -> anyhow::Result<ComparisonJob> {
    let shown = good.display();
    std::fs::metadata(good).with_context(|| format!("--against {shown}: cannot be opened"))?;
    let paths = capture_paths(input);
    ensure!(
        paths.iter().all(|path| path.as_os_str() != "-"),
        "--against reads a capture twice; stdin cannot be read again, open a file"
    );
    let mut all =
        relate_files(&CaptureFile::files_named(&paths), &read_options(input), join_options(input)).series();
    let count = all.len();
    let bad = all.pop().filter(|_| count == 1);
    let bad = bad.with_context(|| format!("--against compares one capture; found {count}"))?;
    Ok(ComparisonJob { good: one(good, input)?, bad, input: input.clone(), options: options.clone() })
}

/// Runs each comparison in a thread of its own; the result of the last one is sent to `news`.
pub(super) fn comparer(job: ComparisonJob, news: Sender<TimelineNews>) -> Compare {
    let last = Arc::new(AtomicU64::new(0));
    Box::new(move |options| {
        let job = ComparisonJob { options: options.clone(), ..job.clone() };
        let number = last.fetch_add(1, Ordering::AcqRel) + 1;
        let (last, news) = (Arc::clone(&last), news.clone());
        let run = move || {
            let result = job.run().map(Box::new).map_err(|error| format!("{error:#}"));
            if last.load(Ordering::Acquire) == number {
                // The application may have ended.
                let _ = news.send(TimelineNews::Compared(result));
            }
        };
        std::thread::Builder::new().name("against".into()).spawn(run).context("cannot start a thread")?;
        Ok(())
    })
}
