//! Follows a file that grows, is truncated or is replaced.

use std::fs::File;
use std::io::{self, ErrorKind, Read};
use std::path::Path;
use std::time::Duration;

use cobscope_decoder::capture::{CaptureError, ReadOptions};

use super::super::SourceEnd;
use super::outlet::ThreadOutlet;
use crate::file_identity::StorageIdentity;
use crate::path_text::path_text;

/// Interval between two checks of a file without new data.
const LOOK: Duration = Duration::from_millis(50);

/// Reads the file at `path` and its replacements until the receiver ends.
pub fn follow_file(path: &Path, options: &ReadOptions, outlet: &mut ThreadOutlet) -> SourceEnd {
    let shown = path_text(path);
    let mut has_stated = false;
    while !outlet.is_over() {
        let mut growing = match GrowingFile::open(path, outlet) {
            Ok(growing) => growing,
            Err(error) if error.kind() == ErrorKind::NotFound => {
                if !has_stated
                    && !outlet.deliver_report(format!("{shown} does not exist yet; waiting for it"))
                {
                    break;
                }
                has_stated = true;
                std::thread::sleep(LOOK);
                continue;
            }
            Err(error) => return read_failure(path, error.into()),
        };
        let result = outlet.pump_capture(&mut growing, options);
        match (result, growing.restart_reason) {
            // The receiver has ended.
            (Ok(()), _) => break,
            (Err(CaptureError::Io(_)), Some(how)) => {
                let cut = if growing.is_within_line { "; incomplete last line skipped" } else { "" };
                if !outlet.deliver_report(format!("{shown} {how}; reading from its start{cut}")) {
                    break;
                }
            }
            (Err(_), _) if outlet.is_over() => break,
            (Err(error), _) => return read_failure(path, error),
        }
    }
    SourceEnd::Complete
}

fn read_failure(path: &Path, error: CaptureError) -> SourceEnd {
    SourceEnd::Failed(anyhow::Error::new(error).context(path_text(path)))
}

/// A file that may grow.
struct GrowingFile<'a> {
    path: &'a Path,
    file: File,
    identity: StorageIdentity,
    position: u64,
    is_over: std::sync::Arc<std::sync::atomic::AtomicBool>,
    /// The last byte read is not a line end.
    is_within_line: bool,
    /// Change that requires a new start, once it has happened.
    restart_reason: Option<&'static str>,
}

impl<'a> GrowingFile<'a> {
    fn open(path: &'a Path, outlet: &ThreadOutlet) -> io::Result<Self> {
        if path.is_dir() {
            return Err(io::Error::new(ErrorKind::IsADirectory, "found a folder, expected a file"));
        }
        let file = File::open(path)?;
        Ok(Self {
            path,
            identity: StorageIdentity::of_file(&file)?,
            file,
            position: 0,
            is_over: outlet.end_flag(),
            is_within_line: false,
            restart_reason: None,
        })
    }

    /// Whether the path is another file now, or a shorter one than was read.
    fn find_change(&self) -> Option<&'static str> {
        // A removed file may be replaced soon.
        let metadata = std::fs::metadata(self.path).ok()?;
        if StorageIdentity::of_path(self.path).ok()? != self.identity {
            return Some("was replaced by another file");
        }
        (metadata.is_file() && metadata.len() < self.position).then_some("was truncated")
    }

    fn read_bytes(&mut self, room: &mut [u8]) -> io::Result<usize> {
        let count = self.file.read(room)?;
        if let Some(last) = room.get(..count).and_then(<[u8]>::last) {
            self.is_within_line = !matches!(last, b'\n' | b'\r');
        }
        self.position = self.position.saturating_add(count as u64);
        Ok(count)
    }
}

impl Read for GrowingFile<'_> {
    fn read(&mut self, room: &mut [u8]) -> io::Result<usize> {
        loop {
            // Checked before reading: bytes written before the replacement are read to the end.
            let change = self.find_change();
            let count = self.read_bytes(room)?;
            if count > 0 || room.is_empty() {
                return Ok(count);
            }
            if change.is_some() {
                self.restart_reason = change;
                return Err(io::Error::other("the file was replaced or truncated"));
            }
            if self.is_over.load(std::sync::atomic::Ordering::Relaxed) {
                return Err(io::Error::other("the reader has stopped"));
            }
            std::thread::sleep(LOOK);
        }
    }
}
