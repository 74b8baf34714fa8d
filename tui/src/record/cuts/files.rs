//! Files of captures of triggers.

use std::io::{self, ErrorKind};
use std::path::{Path, PathBuf};
use std::time::Duration;

use cobscope_decoder::capture::{WRITABLE, WritableFormat};
use jiff::tz::TimeZone;

use super::super::disk::{RecordDisk, RecordFile};
use super::super::names::RecordNames;
use super::super::parts::{RecordLimits, RecordParts};
use super::super::trigger::CaptureTrigger;
use super::name::file_stem;
use super::ring_files::{MOST_FILES, RingFiles};
use super::state;

/// Name of the format in [`WRITABLE`]; it can contain all frames, notices and comments.
const FORMAT: &str = "pcapng";

/// Maximum number of existing file names that are skipped.
const TAKEN: u32 = 1_000;

/// Minimum size of a file of a ring on disk.
const LEAST_RING_FILE: u64 = 64 << 10;

/// Limits of a capture, which has one part unless writing fails.
const UNLIMITED: RecordLimits = RecordLimits { bytes: u64::MAX, time: Duration::MAX, files: usize::MAX };

/// Access to a file system.
pub(in super::super) type DiskMaker = Box<dyn Fn() -> Box<dyn RecordDisk> + Send>;

/// Creates the files.
pub(super) struct CutFiles {
    disk: DiskMaker,
    folder: PathBuf,
    format: &'static WritableFormat,
    zone: TimeZone,
}

impl CutFiles {
    /// Files in `folder`.
    ///
    /// # Errors
    /// The program was built without the format.
    pub(super) fn new(disk: DiskMaker, folder: PathBuf) -> anyhow::Result<Self> {
        let format = WRITABLE.iter().find(|format| format.name == FORMAT);
        let format = format.ok_or_else(|| anyhow::anyhow!("{FORMAT} is not a writable format"))?;
        Ok(Self { disk, folder, format, zone: TimeZone::system() })
    }

    /// Title of the format.
    pub(super) fn title(&self) -> &'static str {
        self.format.title
    }

    /// Path of the capture of a trigger, unless it exists.
    pub(super) fn path(&self, trigger: &CaptureTrigger) -> PathBuf {
        self.folder.join(format!("{}.{FORMAT}", file_stem(trigger, &self.zone)))
    }

    /// Creates a capture with this path, or with a number after its name if it exists.
    ///
    /// # Errors
    /// The file cannot be created or written.
    pub(super) fn create_capture(&self, path: &Path) -> io::Result<(PathBuf, RecordParts)> {
        let mut disk = (self.disk)();
        let mut number = 1;
        loop {
            let path = numbered_path(path, number);
            match disk.create_file(&path) {
                Err(error) if error.kind() == ErrorKind::AlreadyExists && number < TAKEN => number += 1,
                Err(error) => return Err(error),
                Ok(file) => return Ok((path.clone(), self.capture_parts(disk, path, file)?)),
            }
        }
    }

    fn capture_parts(
        &self,
        disk: Box<dyn RecordDisk>,
        path: PathBuf,
        file: Box<dyn RecordFile>,
    ) -> io::Result<RecordParts> {
        let names = RecordNames::names_for(&path, false).map_err(io::Error::other)?;
        RecordParts::in_file(disk, (path, file), names, self.format, UNLIMITED)
    }

    /// Writes the bus file of a capture.
    ///
    /// # Errors
    /// The file cannot be written.
    pub(super) fn write_state(&self, path: &Path, text: &str) -> io::Result<()> {
        state::write_bus_file((self.disk)(), path, text)
    }

    /// Starts a ring on disk of at most `bytes` bytes: `ring-2026-11-22_073051-0001.pcapng`, …
    ///
    /// # Errors
    /// A file cannot be created.
    pub(super) fn ring_files(&self, bytes: u64, now: jiff::civil::DateTime) -> anyhow::Result<RingFiles> {
        let path = self.folder.join(now.strftime("ring-%Y-%m-%d_%H%M%S.pcapng").to_string());
        let names = RecordNames::names_for(&path, true)?;
        names.ensure_free()?;
        let share = bytes / u64::from(MOST_FILES);
        let limits = RecordLimits { bytes: share.max(LEAST_RING_FILE), ..UNLIMITED };
        let parts = RecordParts::open_parts((self.disk)(), names, self.format, limits)?;
        Ok(RingFiles::new(parts, (self.disk)()))
    }
}

/// `x.pcapng`, `x-2.pcapng`, …
fn numbered_path(path: &Path, number: u32) -> PathBuf {
    let stem = path.file_stem().filter(|_| number > 1);
    let Some(stem) = stem.map(std::ffi::OsStr::to_string_lossy) else { return path.to_owned() };
    path.with_file_name(format!("{stem}-{number}.{FORMAT}"))
}

/// Name of a capture while it replaces another one.
pub(super) fn replacement_path(path: &Path) -> PathBuf {
    path.with_extension(format!("new.{FORMAT}"))
}
