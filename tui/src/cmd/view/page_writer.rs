//! Report pages that the user requests in the terminal UI.

use std::sync::Arc;
use std::sync::mpsc::Sender;

use anyhow::{Context as _, bail};
use cobscope_decoder::rules::RuleSetup;

use crate::app::{ReportRequest, WriteReport};
use crate::cmd::report::PageJob;
use crate::run::arguments::InputArgs;
use crate::run::input::{capture_paths, join_options, read_options};
use crate::source::{CaptureFile, relate_files};
use crate::timeline::TimelineNews;

/// Writes each page in a thread of its own; the result is sent to `news`.
pub(super) fn page_writer(
    input: &InputArgs,
    rules: &Arc<RuleSetup>,
    news: &Sender<TimelineNews>,
) -> WriteReport {
    let (input, rules, news) = (input.clone(), Arc::clone(rules), news.clone());
    Box::new(move |request, options| {
        let ReportRequest { finding, path } = request;
        let files = capture_paths(&input);
        if files.iter().any(|file| file.as_os_str() == "-") {
            bail!("a report reads a capture twice; stdin cannot be read again, open a file");
        }
        let files = CaptureFile::files_named(&files);
        let mut all = relate_files(&files, &read_options(&input), join_options(&input)).series().into_iter();
        let (Some(series), None) = (all.next(), all.next()) else {
            bail!("a report covers one capture; open a single one, or use cobscope report");
        };
        let (options, rules) = (options.clone(), Arc::clone(&rules));
        let job = PageJob { series, input: input.clone(), options, rules, finding, path };
        let news = news.clone();
        let run = move || {
            let result = job.write().map_err(|error| format!("{error:#}"));
            // The application may have ended.
            let _ = news.send(TimelineNews::Exported(result));
        };
        std::thread::Builder::new().name("report".into()).spawn(run).context("cannot start a thread")?;
        Ok(())
    })
}
