//! Files of earlier runs that a new output may replace.

use std::fs::File;
use std::io::{Read, Seek, SeekFrom};
use std::path::{Path, PathBuf};

use anyhow::{Context as _, ensure};
use cobscope_decoder::comparison::text;
use cobscope_decoder::report::{ATTACHMENT_COMMENT, html, markdown};
use cobscope_decoder::sink::findings::FINDING_FORMATS;

use super::cut;
use super::output::{CommandOutput, NamePolicy, ensure_folder, ensure_not_read, open_output};
use crate::output_file::ExistingFile;
use crate::path_text::path_text;

/// Bytes of the start and of the end of a file that contain its mark.
const SEARCHED: u64 = 64 * 1024;

/// Key near the end of a comparison in JSON.
const COMPARISON_KEY: &str = "\"longest_gap_percent\":";

/// A kind of output that replaces an earlier one of its kind, and no other file.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum OwnFile {
    /// Findings of `check`.
    Findings,
    /// A page of `report`, or of a fleet.
    Page,
    /// Differences of `diff`.
    Comparison,
    /// The capture that belongs to a page.
    Attachment,
    /// The bus file that belongs to a part of a capture.
    BusFile,
}

impl OwnFile {
    /// Texts of which each such file contains one.
    fn content_marks(self) -> Vec<&'static str> {
        match self {
            Self::Findings => FINDING_FORMATS.iter().map(|format| format.mark).collect(),
            Self::Page => vec![html::MARK, markdown::MARK],
            Self::Comparison => vec![html::COMPARISON_MARK, text::MARK, COMPARISON_KEY],
            Self::Attachment => vec![ATTACHMENT_COMMENT],
            Self::BusFile => vec![cut::TITLE],
        }
    }

    fn name(self) -> &'static str {
        match self {
            Self::Findings => "a report of cobscope check",
            Self::Page => "a page of cobscope report",
            Self::Comparison => "a comparison of cobscope diff",
            Self::Attachment => "a capture of cobscope report --attach",
            Self::BusFile => "the bus file of a cut",
        }
    }
}

/// Opens an output that replaces an earlier one: a file not among the files `read`, else stdout.
///
/// # Errors
/// If the file has other content, is an input, or cannot be read or created.
pub fn open_replacing<'a>(
    path: Option<&Path>,
    kind: OwnFile,
    read: impl IntoIterator<Item = &'a PathBuf> + Clone,
) -> anyhow::Result<CommandOutput> {
    ensure_replaceable(path, kind, read.clone())?;
    open_output(path, NamePolicy { existing: ExistingFile::Replace, is_at_once: false }, read)
}

/// Checks an output file before the work for it begins.
///
/// # Errors
/// If the file has other content, is an input, cannot be read, or its folder does not exist.
pub fn ensure_replaceable<'a>(
    path: Option<&Path>,
    kind: OwnFile,
    read: impl IntoIterator<Item = &'a PathBuf>,
) -> anyhow::Result<()> {
    let Some(path) = path else { return Ok(()) };
    ensure_not_read(path, read)?;
    ensure_folder(path)?;
    ensure_own(path, kind)
}

/// Checks that an output file is new, empty, no file, or of this kind.
///
/// # Errors
/// If it has other content, or cannot be read.
fn ensure_own(path: &Path, kind: OwnFile) -> anyhow::Result<()> {
    let size = match path.metadata() {
        Ok(found) if found.is_file() && found.len() > 0 => found.len(),
        _ => return Ok(()),
    };
    let name = path_text(path);
    let text = file_ends(path, size).with_context(|| format!("{name}: cannot be read"))?;
    let is_own = kind.content_marks().iter().any(|mark| text.contains(mark));
    ensure!(is_own, "{name}: not overwritten; expected {}, or no file", kind.name());
    Ok(())
}

/// Start and end of a file.
fn file_ends(path: &Path, size: u64) -> std::io::Result<String> {
    let mut file = File::open(path)?;
    let mut bytes = Vec::new();
    Read::by_ref(&mut file).take(SEARCHED).read_to_end(&mut bytes)?;
    file.seek(SeekFrom::Start(size.saturating_sub(SEARCHED)))?;
    file.take(SEARCHED).read_to_end(&mut bytes)?;
    Ok(String::from_utf8_lossy(&bytes).into_owned())
}
