//! A file that grows, is cut short, or gives its place to another.

use std::fs::{File, Metadata};
use std::io::{self, ErrorKind, Read};
use std::path::Path;
use std::time::Duration;

use cobscope_decoder::capture::{CaptureError, ReadOptions};

use super::super::Ended;
use super::outlet::Outlet;

/// How often a file is looked at that has no more.
const LOOK: Duration = Duration::from_millis(50);

/// Reads the file at `path`, and each that takes its place, until nobody listens any more.
pub fn follow(path: &Path, options: &ReadOptions, outlet: &mut Outlet) -> Ended {
    let shown = path.display();
    let mut has_said = false;
    while !outlet.is_over() {
        let mut growing = match Growing::open(path, outlet) {
            Ok(growing) => growing,
            Err(error) if error.kind() == ErrorKind::NotFound => {
                if !has_said && !outlet.say(format!("{shown} is not there yet: waiting for it")) {
                    break;
                }
                has_said = true;
                std::thread::sleep(LOOK);
                continue;
            }
            Err(error) => return failed(path, error.into()),
        };
        let result = outlet.pump(&mut growing, options);
        match (result, growing.begins_anew) {
            // Nobody listens any more.
            (Ok(()), _) => break,
            (Err(CaptureError::Io(_)), Some(how)) => {
                let cut =
                    if growing.is_within_line { "; its last line has no end and is left out" } else { "" };
                if !outlet.say(format!("{shown} {how}: read from its beginning{cut}")) {
                    break;
                }
            }
            (Err(_), _) if outlet.is_over() => break,
            (Err(error), _) => return failed(path, error),
        }
    }
    Ended::Complete
}

fn failed(path: &Path, error: CaptureError) -> Ended {
    Ended::Failed(anyhow::Error::new(error).context(path.display().to_string()))
}

/// A file whose end is not the end.
struct Growing<'a> {
    path: &'a Path,
    file: File,
    identity: Identity,
    position: u64,
    is_over: std::sync::Arc<std::sync::atomic::AtomicBool>,
    /// The last byte read ended no line.
    is_within_line: bool,
    /// What happened to it, once something has.
    begins_anew: Option<&'static str>,
}

impl<'a> Growing<'a> {
    fn open(path: &'a Path, outlet: &Outlet) -> io::Result<Self> {
        let file = File::open(path)?;
        let metadata = file.metadata()?;
        if metadata.is_dir() {
            return Err(io::Error::new(ErrorKind::IsADirectory, "found a folder, expected a file"));
        }
        Ok(Self {
            path,
            identity: identity(&metadata),
            file,
            position: 0,
            is_over: outlet.flag(),
            is_within_line: false,
            begins_anew: None,
        })
    }

    /// Whether the path stands for another file now, or for a shorter one than was read.
    fn look(&self) -> Option<&'static str> {
        // Where it is not there any more, another will come.
        let metadata = std::fs::metadata(self.path).ok()?;
        if identity(&metadata) != self.identity {
            return Some("was replaced by another file");
        }
        (metadata.is_file() && metadata.len() < self.position).then_some("was cut short")
    }

    fn take(&mut self, room: &mut [u8]) -> io::Result<usize> {
        let count = self.file.read(room)?;
        if let Some(last) = room.get(..count).and_then(<[u8]>::last) {
            self.is_within_line = !matches!(last, b'\n' | b'\r');
        }
        self.position = self.position.saturating_add(count as u64);
        Ok(count)
    }
}

impl Read for Growing<'_> {
    fn read(&mut self, room: &mut [u8]) -> io::Result<usize> {
        loop {
            // Looked at before reading: what was written before it was replaced is read to its end.
            let change = self.look();
            let count = self.take(room)?;
            if count > 0 || room.is_empty() {
                return Ok(count);
            }
            if change.is_some() {
                self.begins_anew = change;
                return Err(io::Error::other("the file begins anew"));
            }
            if self.is_over.load(std::sync::atomic::Ordering::Relaxed) {
                return Err(io::Error::other("nobody listens any more"));
            }
            std::thread::sleep(LOOK);
        }
    }
}

/// What tells a file from another at the same path.
#[derive(Debug, Clone, PartialEq, Eq)]
struct Identity {
    device: u64,
    number: u64,
    /// Where files have no number.
    created: Option<std::time::SystemTime>,
}

#[cfg(unix)]
fn identity(metadata: &Metadata) -> Identity {
    use std::os::unix::fs::MetadataExt as _;
    Identity { device: metadata.dev(), number: metadata.ino(), created: None }
}

#[cfg(not(unix))]
fn identity(metadata: &Metadata) -> Identity {
    Identity { device: 0, number: 0, created: metadata.created().ok() }
}
