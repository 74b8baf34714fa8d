//! Report pages requested in the terminal UI: written by a thread of their own.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use anyhow::{Context as _, ensure};
use cobscope_decoder::rules::RuleSetup;
use cobscope_decoder::session::SessionOptions;
use cobscope_decoder::why::WhyScope;
use cobscope_decoder::words::count_noun;

use super::arguments::{FindingArg, PageStyle};
use super::page;
use super::reading::{ReportScope, compose};
use crate::path_text::path_text;
use crate::run::arguments::{InputArgs, SelectArgs};
use crate::run::output::ensure_folder;
use crate::source::CaptureSeries;

/// A page to write.
pub(in crate::cmd) struct PageJob {
    /// The capture.
    pub(in crate::cmd) series: CaptureSeries,
    /// Options with the files that the page names.
    pub(in crate::cmd) input: InputArgs,
    /// Options of the decoder.
    pub(in crate::cmd) options: SessionOptions,
    /// Selection and tolerances of the rules.
    pub(in crate::cmd) rules: Arc<RuleSetup>,
    /// Finding whose story is reported.
    pub(in crate::cmd) finding: u64,
    /// File of the page.
    pub(in crate::cmd) path: PathBuf,
}

impl PageJob {
    /// Writes the page; returns a summary.
    ///
    /// # Errors
    /// If the capture cannot be read, has no story with the finding, or the file exists or cannot be written.
    pub(in crate::cmd) fn write(&self) -> anyhow::Result<String> {
        let shown = path_text(&self.path);
        ensure!(self.path.symlink_metadata().is_err(), "{shown}: file exists; choose another name");
        ensure_folder(&self.path)?;
        let finding = FindingArg::Id(self.finding);
        let scope = ReportScope {
            input: &self.input,
            select: &SelectArgs::default(),
            question: WhyScope::default(),
            finding: Some(&finding),
            kept: None,
            is_cut: false,
            is_quiet: true,
        };
        let composed = compose(&self.series, &scope, &self.options, &self.rules)?;
        page::create(&composed.report, style(&self.path), &self.path)
            .with_context(|| format!("{shown}: cannot be written"))?;
        Ok(format!("{shown}: report of {}", count_noun(composed.report.claims.len(), "story")))
    }
}

fn style(path: &Path) -> PageStyle {
    let is_markdown = path.extension().is_some_and(|suffix| suffix.eq_ignore_ascii_case("md"));
    if is_markdown { PageStyle::Md } else { PageStyle::Html }
}
