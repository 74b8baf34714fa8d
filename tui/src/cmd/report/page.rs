//! Writes a page in its format.

use std::io::{self, Write as _};
use std::path::{Path, PathBuf};

use cobscope_decoder::report::{CaptureReport, html, markdown};

use super::arguments::PageStyle;
use crate::exit_code::ExitStatus;
use crate::output_file::{self, ExistingFile};
use crate::run::messages::Refusal;
use crate::run::output::write_result;
use crate::run::replaced::{OwnFile, open_replacing};

/// Writes a page to a file, which is none of the files `read`, else to stdout.
///
/// # Errors
/// If the file is an input, or cannot be created.
pub(super) fn write(
    report: &CaptureReport,
    style: PageStyle,
    path: Option<&Path>,
    read: &[PathBuf],
) -> Result<ExitStatus, Refusal> {
    let text = text(report, style);
    let mut output = open_replacing(path, OwnFile::Page, read).map_err(|error| (ExitStatus::Usage, error))?;
    Ok(write_result(output.write_all(text.as_bytes()).and_then(|()| output.finish())))
}

/// Writes a page to a new file.
///
/// # Errors
/// If the file exists, or cannot be written.
pub(super) fn create(report: &CaptureReport, style: PageStyle, path: &Path) -> io::Result<()> {
    output_file::write_file(path, ExistingFile::Keep, text(report, style).as_bytes())
}

fn text(report: &CaptureReport, style: PageStyle) -> String {
    match style {
        PageStyle::Html => html::write_page(report),
        PageStyle::Md => markdown::write_report(report),
    }
}
