//! Pages of several captures in a folder, with an index page.

use std::collections::{BTreeMap, BTreeSet};
use std::io::Write as _;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use anyhow::Context as _;
use cobscope_decoder::finding::{FindingGroup, Severity};
use cobscope_decoder::report::html::{IndexPage, IndexRow, RuleCount, write_index};
use cobscope_decoder::rules::RuleSetup;
use cobscope_decoder::session::SessionOptions;
use cobscope_decoder::words::count_noun;

use super::arguments::{AttachPlace, PageStyle, ReportArgs};
use super::provenance::command;
use super::reading::{ComposedReport, ReportScope, compose};
use super::{attach, page};
use crate::exit_code::ExitStatus;
use crate::path_text;
use crate::run::captures::{SourceSeries, is_no_capture, passed_over, without_captures};
use crate::run::messages::{Refusal, exit_of, print_error, print_note, print_warning};
use crate::run::output::{ensure_not_read, files_read, write_result};
use crate::run::replaced::{OwnFile, open_replacing};

/// Name of the index page.
const INDEX: &str = "index";

/// Maximum length of the name of a page, without its suffix.
const LONGEST_NAME: usize = 100;

/// A folder of pages in preparation.
pub(in crate::cmd) struct PageFolder {
    folder: PathBuf,
    style: PageStyle,
    names: BTreeSet<String>,
    rows: Vec<IndexRow>,
    read: Vec<PathBuf>,
}

/// A capture of the index.
pub(in crate::cmd) struct FolderCapture<'a> {
    /// Name of the capture.
    pub(in crate::cmd) capture: &'a str,
    /// Its report, if there is one.
    pub(in crate::cmd) composed: Option<&'a mut ComposedReport>,
    /// Verdict, or why the capture was not read.
    pub(in crate::cmd) remark: String,
    /// Rules with findings.
    pub(in crate::cmd) rules: Vec<RuleCount>,
}

impl PageFolder {
    /// Creates the folder; none of its pages may be one of the files `read`.
    ///
    /// # Errors
    /// If the folder cannot be created.
    pub(in crate::cmd) fn create(
        folder: &Path,
        style: PageStyle,
        read: Vec<PathBuf>,
    ) -> anyhow::Result<Self> {
        let shown = path_text::path_text(folder);
        std::fs::create_dir_all(folder).with_context(|| format!("{shown}: cannot create the folder"))?;
        let names = BTreeSet::from([INDEX.to_owned()]);
        Ok(Self { folder: folder.to_owned(), style, names, rows: Vec::new(), read })
    }

    /// Writes the page of a capture, if it has a report, and adds it to the index.
    ///
    /// # Errors
    /// If a file cannot be written.
    pub(in crate::cmd) fn add(
        &mut self,
        own: FolderCapture<'_>,
        place: Option<AttachPlace>,
    ) -> Result<ExitStatus, Refusal> {
        let FolderCapture { capture, composed, remark, rules } = own;
        let mut exit = ExitStatus::Clean;
        let mut written = None;
        let mut remark = remark;
        if let Some(composed) = composed {
            let name = format!("{}.{}", self.name_of(capture), self.suffix());
            let path = self.folder.join(&name);
            attach::attach(composed, place, Some(&path), &self.read)?;
            exit = page::write(&composed.report, self.style, Some(&path), &self.read)?;
            written = Some(name).filter(|_| exit == ExitStatus::Clean);
        }
        if exit != ExitStatus::Clean {
            remark.push_str(", page incomplete");
        }
        self.rows.push(IndexRow { capture: capture.to_owned(), page: written, rules, remark });
        Ok(exit)
    }

    const fn suffix(&self) -> &'static str {
        match self.style {
            PageStyle::Html => "html",
            PageStyle::Md => "md",
        }
    }

    /// A new name for the page of a capture: its path with letters, digits, `.`, `-` and `_` only.
    fn name_of(&mut self, capture: &str) -> String {
        let is_plain = |letter: char| letter.is_ascii_alphanumeric() || "-._".contains(letter);
        let plain: String = capture.chars().map(|it| if is_plain(it) { it } else { '_' }).collect();
        let plain = plain.trim_start_matches(['.', '_', '-']);
        let start = plain.len().saturating_sub(LONGEST_NAME);
        let plain = plain.get(start..).filter(|name| !name.is_empty()).unwrap_or("capture");
        let numbered = (1..).map(|n: u32| if n == 1 { plain.to_owned() } else { format!("{plain}-{n}") });
        let name = numbered.into_iter().find(|name| !self.names.contains(name)).unwrap_or_default();
        self.names.insert(name.clone());
        name
    }

    /// Writes the index page, which is HTML also for pages in Markdown; none without a capture.
    ///
    /// # Errors
    /// If it cannot be written.
    pub(in crate::cmd) fn finish(self, name: &str) -> Result<ExitStatus, Refusal> {
        if self.rows.is_empty() {
            return Ok(ExitStatus::Clean);
        }
        let path = self.folder.join(format!("{INDEX}.html"));
        let pages = self.rows.iter().filter(|row| row.page.is_some()).count();
        let index = IndexPage {
            name: name.to_owned(),
            rows: self.rows,
            command: command(),
            version: env!("CARGO_PKG_VERSION").to_owned(),
        };
        let mut output = open_replacing(Some(&path), OwnFile::Page, &self.read)
            .map_err(|error| (ExitStatus::Usage, error))?;
        let text = write_index(&index);
        let exit = write_result(output.write_all(text.as_bytes()).and_then(|()| output.finish()));
        let folder = path_text::path_text(&self.folder);
        match (count_noun(pages, "report"), exit) {
            (reports, ExitStatus::Clean) => print_note(&format!("{folder}: {reports} and {INDEX}.html")),
            (reports, _) if pages > 0 => print_note(&format!("{folder}: {reports}, no {INDEX}.html")),
            _ => {}
        }
        Ok(exit)
    }
}

/// Findings per rule, in order of names.
pub(in crate::cmd) fn counts<'a>(groups: impl Iterator<Item = &'a FindingGroup>) -> Vec<RuleCount> {
    let mut rules: BTreeMap<&str, (usize, Severity)> = BTreeMap::new();
    for group in groups {
        let known = rules.entry(&group.rule).or_insert((0, group.severity));
        *known = (known.0.saturating_add(1), known.1.max(group.severity));
    }
    let count = |(rule, (count, severity)): (&str, _)| RuleCount { rule: rule.to_owned(), count, severity };
    rules.into_iter().map(count).collect()
}

/// Several captures: one page each, and the index.
pub(super) fn write(
    all: &[SourceSeries],
    arguments: &ReportArgs,
    options: &SessionOptions,
    rules: &Arc<RuleSetup>,
) -> Result<ExitStatus, Refusal> {
    let usage = |error| (ExitStatus::Usage, error);
    let inputs = &arguments.input.captures;
    if all.is_empty() {
        return Ok(report_empty(inputs, &[]));
    }
    let Some(folder) = &arguments.output else {
        return Err(usage(anyhow::anyhow!("several captures: give a folder for the pages with -o")));
    };
    let read: Vec<_> = all.iter().flat_map(|source| source.series.parts.clone()).collect();
    ensure_not_read(folder, &read).map_err(usage)?;
    let read = read.into_iter().chain(files_read(&arguments.input)).collect();
    let mut pages = PageFolder::create(folder, arguments.format, read).map_err(usage)?;
    let mut exit = ExitStatus::Clean;
    let mut found = Vec::new();
    for source in all {
        let name = source.series.name();
        match compose(&source.series, &ReportScope::of(arguments), options, rules) {
            Ok(mut composed) => {
                let counted = counts(composed.findings.reported_groups());
                let mut remark = verdict(&composed);
                if let Some(failure) = &composed.failure {
                    print_error(failure);
                    remark.push_str(", incomplete");
                    exit = exit.max(ExitStatus::Capture);
                }
                let own =
                    FolderCapture { capture: &name, composed: Some(&mut composed), remark, rules: counted };
                exit = exit.max(pages.add(own, arguments.attach)?);
                found.push(source);
            }
            Err(error) if source.folder.is_some() && is_no_capture(&error) => {
                if let Some(text) = passed_over(source.series.first_path(), &error) {
                    print_note(&text);
                }
            }
            Err(error) => {
                print_error(&error);
                exit = exit.max(exit_of(&error));
                let remark = format!("{error:#}");
                let own = FolderCapture { capture: &name, composed: None, remark, rules: Vec::new() };
                exit = exit.max(pages.add(own, None)?);
                found.push(source);
            }
        }
    }
    exit = exit.max(report_empty(inputs, &found));
    let names: Vec<_> = inputs.iter().map(|path| path.display().to_string()).collect();
    Ok(exit.max(pages.finish(&names.join(", "))?))
}

/// Reports the folders without any of the captures `found`; returns the exit status.
fn report_empty(named: &[PathBuf], found: &[&SourceSeries]) -> ExitStatus {
    let empty = without_captures(named, found);
    for folder in &empty {
        print_warning(&format!("{}: no captures", path_text::path_text(folder)));
    }
    if empty.is_empty() { ExitStatus::Clean } else { ExitStatus::Capture }
}

/// `2 errors, 4 warnings`, `no finding`.
fn verdict(composed: &ComposedReport) -> String {
    let number = |severity| composed.findings.reported_count(severity);
    let parts = [
        (number(Severity::Error), "error"),
        (number(Severity::Warning), "warning"),
        (number(Severity::Note), "note"),
    ];
    let parts: Vec<_> = parts
        .into_iter()
        .filter(|(count, _)| *count > 0)
        .map(|(count, what)| count_noun(count, what))
        .collect();
    if parts.is_empty() { "no finding".to_owned() } else { parts.join(", ") }
}
