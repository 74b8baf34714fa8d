//! Captures of commands that read folders: the files on the command line, and all files in and below its folders.

use std::path::{Path, PathBuf};

use cobscope_decoder::capture::CaptureError;
use cobscope_decoder::sink::escape;

use super::input::{join_files, read_options};
use crate::path_text::path_text;
use crate::record::format;
use crate::run::arguments::InputArgs;
use crate::source::{self, CaptureFile, CaptureSeries};

/// A file to read.
pub struct InputFile {
    pub path: PathBuf,
    /// Folder on the command line that contains the file; such a file need not be a capture.
    pub folder: Option<PathBuf>,
}

/// A capture to read: a file or the parts of a series.
pub struct SourceSeries {
    pub series: CaptureSeries,
    /// Folder on the command line that contains the file; such a file need not be a capture.
    pub folder: Option<PathBuf>,
}

/// Files to be joined; those of folders only if their names are consecutive.
fn files(sources: &[InputFile]) -> Vec<CaptureFile> {
    let file =
        |source: &InputFile| CaptureFile { path: source.path.clone(), is_listed: source.folder.is_none() };
    sources.iter().map(file).collect()
}

/// Maximum number of files per folder.
const MOST_FILES: usize = 100_000;

/// Files in the order of the command line; stdin without arguments.
pub fn captures(named: &[PathBuf]) -> Vec<InputFile> {
    if named.is_empty() {
        return vec![InputFile { path: "-".into(), folder: None }];
    }
    let mut all = Vec::new();
    for path in named {
        if path.is_dir() {
            let mut found = Vec::new();
            files_below(path, &mut found);
            found.sort();
            let folder = Some(path.clone());
            all.extend(found.into_iter().map(|path| InputFile { path, folder: folder.clone() }));
        } else {
            all.push(InputFile { path: path.clone(), folder: None });
        }
    }
    all
}

/// Folders without any of the captures in `judged`.
pub fn without_captures<'a>(named: &'a [PathBuf], judged: &[&SourceSeries]) -> Vec<&'a PathBuf> {
    let folders = named.iter().filter(|path| path.is_dir());
    folders.filter(|path| judged.iter().all(|source| source.folder.as_ref() != Some(path))).collect()
}

/// Joins the parts of captures.
pub fn series(captures: &[InputFile], input: &InputArgs) -> Vec<SourceSeries> {
    let all = join_files(&files(captures), input);
    let folder = |series: &CaptureSeries| {
        captures
            .iter()
            .find(|source| source.path == series.first_path())
            .and_then(|source| source.folder.clone())
    };
    all.into_iter().map(|series| SourceSeries { folder: folder(&series), series }).collect()
}

/// Message for a skipped file in a folder; `None` for a file that does not look like a capture.
pub fn passed_over(path: &Path, error: &anyhow::Error) -> Option<String> {
    let shown = path_text(path);
    match error.downcast_ref::<CaptureError>()? {
        CaptureError::Empty => Some(format!("{shown}: empty; skipped")),
        _ if format::is_of_captures(path) => Some(format!("{}; skipped", escape(&format!("{error:#}")))),
        _ => None,
    }
}

/// Whether a file is read; files in a folder only if they are captures.
pub fn is_capture(source: &InputFile, input: &InputArgs) -> bool {
    let opened = source::open_capture(&source.path, &read_options(input));
    source.folder.is_none() || !opened.err().is_some_and(|error| is_no_capture(&error))
}

/// Whether a file is not in any capture format.
pub fn is_no_capture(error: &anyhow::Error) -> bool {
    let cause = error.downcast_ref::<CaptureError>();
    matches!(
        cause,
        Some(CaptureError::Unrecognised { .. } | CaptureError::Foreign { .. } | CaptureError::Empty)
    )
}

/// Files in and below a folder, except hidden ones. Links to folders are not followed, because they may form
/// a cycle.
fn files_below(folder: &Path, found: &mut Vec<PathBuf>) {
    let mut folders = vec![folder.to_owned()];
    while let Some(folder) = folders.pop() {
        for entry in std::fs::read_dir(&folder).into_iter().flatten().flatten() {
            let is_hidden = entry.file_name().to_string_lossy().starts_with('.');
            let Ok(kind) = entry.file_type() else { continue };
            let path = entry.path();
            match () {
                () if is_hidden || found.len() >= MOST_FILES => {}
                () if kind.is_dir() => folders.push(path),
                () if path.is_file() => found.push(path),
                () => {}
            }
        }
    }
}
