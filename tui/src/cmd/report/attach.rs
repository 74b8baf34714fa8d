//! The cut-out capture of a report: a file next to the page, or embedded in it.

use std::io::Write as _;
use std::path::{Path, PathBuf};

use anyhow::{Context as _, ensure};
use base64::Engine as _;
use base64::engine::general_purpose::STANDARD;
use cobscope_decoder::report::Attachment;

use super::arguments::{AttachPlace, PageStyle, ReportArgs};
use super::provenance::sha256;
use super::reading::{ComposedReport, ReportCutStart};
use crate::exit_code::ExitStatus;
use crate::run::cut;
use crate::run::messages::{Refusal, print_note};
use crate::run::replaced::{OwnFile, open_replacing};

/// Suffix of the cut-out capture.
const SUFFIX: &str = "pcapng";

/// Suffix of its bus file.
const BUS_FILE_SUFFIX: &str = "bus.toml";

/// Checks the place of the cut-out capture.
///
/// # Errors
/// If stdout has no place for a file, or the format cannot embed one.
pub(super) fn check(arguments: &ReportArgs) -> anyhow::Result<()> {
    match arguments.attach {
        Some(AttachPlace::File) => {
            ensure!(arguments.output.is_some(), "--attach: stdout has no folder; give a file with -o");
        }
        Some(AttachPlace::Embedded) => {
            ensure!(arguments.format == PageStyle::Html, "--attach=embedded: only HTML; use --attach");
        }
        None => {}
    }
    Ok(())
}

/// Adds the frames around the claims to a report whose page is written to `page`.
///
/// # Errors
/// If the file cannot be created or written, or is one of the files `read`.
pub(super) fn attach(
    composed: &mut ComposedReport,
    place: Option<AttachPlace>,
    page: Option<&Path>,
    read: &[PathBuf],
) -> Result<(), Refusal> {
    let Some(place) = place else { return Ok(()) };
    if composed.excerpt.is_empty() {
        print_note(&format!("{}: no claim; no capture attached", composed.report.capture.name));
        return Ok(());
    }
    let bytes = composed.excerpt.to_pcapng().context("cannot write the cut-out capture");
    let bytes = bytes.map_err(|error| (ExitStatus::Capture, error))?;
    let path = page.map_or_else(|| PathBuf::from("report"), Path::to_owned).with_extension(SUFFIX);
    let name = path.file_name().map_or_else(String::new, |name| name.to_string_lossy().into_owned());
    let embedded = match place {
        AttachPlace::File => {
            write(&path, OwnFile::Attachment, read, &bytes)?;
            None
        }
        AttachPlace::Embedded => Some(STANDARD.encode(&bytes)),
    };
    let bus_file = write_bus_file(composed.start.take(), &path, read)?;
    composed.report.attachment = Some(Attachment {
        name,
        frames: composed.excerpt.len(),
        size: bytes.len(),
        is_cut: composed.excerpt.is_cut(),
        is_timed: composed.report.capture.duration.is_some(),
        sha256: sha256(&bytes),
        embedded,
        bus_file,
    });
    Ok(())
}

/// Writes the bus file of the cut-out capture next to it; returns its name.
///
/// # Errors
/// If the file cannot be written, or is one of the files `read`.
fn write_bus_file(
    start: Option<ReportCutStart>,
    capture: &Path,
    read: &[PathBuf],
) -> Result<Option<String>, Refusal> {
    let Some(ReportCutStart { state, input, title }) = start else { return Ok(None) };
    let path = capture.with_extension(BUS_FILE_SUFFIX);
    let text =
        cut::snapshot_text(state, &input, &path, &title).map_err(|error| (ExitStatus::Profile, error))?;
    write(&path, OwnFile::BusFile, read, text.as_bytes())?;
    Ok(path.file_name().map(|name| name.to_string_lossy().into_owned()))
}

/// Writes a file next to the page.
///
/// # Errors
/// If it is refused, or incomplete.
fn write(path: &Path, kind: OwnFile, read: &[PathBuf], content: &[u8]) -> Result<(), Refusal> {
    let mut file = open_replacing(Some(path), kind, read).map_err(|error| (ExitStatus::Usage, error))?;
    let written = file.write_all(content).and_then(|()| file.finish());
    written.map_err(|error| (ExitStatus::Capture, error.into()))
}
