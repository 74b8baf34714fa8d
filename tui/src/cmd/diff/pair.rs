//! The two captures of the command line: two files or folders, or more files that form two series.

use std::path::{Path, PathBuf};

use anyhow::{Context as _, ensure};
use cobscope_decoder::comparison::DifferenceSection;

use super::arguments::DiffArgs;
use crate::run::arguments::InputArgs;
use crate::run::input::join_files;
use crate::source::{CaptureFile, CaptureSeries};

/// GOOD and BAD.
///
/// # Errors
/// If the arguments are not two captures.
pub(in crate::cmd) fn pair(input: &InputArgs) -> anyhow::Result<[CaptureSeries; 2]> {
    let paths = &input.captures;
    if let [good, bad] = paths.as_slice() {
        return Ok([one(good, input)?, one(bad, input)?]);
    }
    ensure!(paths.len() > 2, "diff needs two captures: GOOD BAD; found {}", paths.len());
    ensure!(
        !input.join,
        "--join: ambiguous for more than two files; put the parts of each capture in a folder"
    );
    let series = join_files(&CaptureFile::files_named(paths), input);
    let count = series.len();
    series
        .try_into()
        .map_err(|_| anyhow::anyhow!("{} files form {count} captures; expected two: GOOD BAD", paths.len()))
}

/// Checks that a requested sequence has an event to start from.
///
/// # Errors
/// If there is none.
pub(in crate::cmd) fn ensure_start(arguments: &DiffArgs) -> anyhow::Result<()> {
    let is_requested = arguments.only.contains(&DifferenceSection::Sequence);
    ensure!(
        !is_requested || arguments.at_event.is_some(),
        "--only sequence: no event to start from; add --at-event"
    );
    Ok(())
}

/// A file, or the parts of one capture in a folder.
///
/// # Errors
/// If the folder cannot be read, or contains several captures.
pub(in crate::cmd) fn one(path: &Path, input: &InputArgs) -> anyhow::Result<CaptureSeries> {
    if !path.is_dir() {
        return Ok(CaptureSeries {
            parts: vec![path.to_owned()],
            first_frames: Vec::new(),
            shifts: Vec::new(),
        });
    }
    let name = path.display();
    let entries = std::fs::read_dir(path).with_context(|| format!("{name}: cannot be read"))?;
    let mut files: Vec<PathBuf> =
        entries.flatten().map(|entry| entry.path()).filter(|path| path.is_file()).collect();
    files.sort();
    let mut series = join_files(&CaptureFile::files_named(&files), input);
    ensure!(
        series.len() == 1,
        "{name}: contains {} captures; expected the parts of one (--join, --part-gap)",
        series.len()
    );
    series.pop().context("no capture")
}
