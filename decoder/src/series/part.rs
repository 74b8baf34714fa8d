//! Files that may be parts of a series, and their relations.

use std::io::Read;
use std::path::Path;

use crate::capture::Batch;

/// Maximum size of a part with nothing but comments, in bytes.
const LARGEST_BLANK: u64 = 64 * 1024;

/// A file that may be a part of a series.
pub trait PossiblePart {
    /// Path, of which the folder and the name are compared.
    fn path(&self) -> &Path;

    /// The user named the file. Files found in a folder are joined only if their names are consecutive.
    fn is_listed(&self) -> bool;

    /// Passes the frames in batches, with the names of the buses, until `take` returns `false` or the file ends or becomes
    /// unreadable. Returns the name of the format; `None` if the file cannot be opened, or can be read only once.
    /// `is_whole`: all of the file is wanted, so that reading ahead is worth its cost.
    fn read_batches(
        &self,
        is_whole: bool,
        take: &mut dyn FnMut(&Batch, &[String]) -> bool,
    ) -> Option<&'static str>;

    /// Whether the file contains only empty lines and comments; see [`is_blank`].
    fn is_blank(&self) -> bool;
}

/// Whether a file contains only empty lines and comments, at most 64 KiB; `false` if it cannot be read.
pub fn is_blank(file: impl Read) -> bool {
    let mut text = Vec::new();
    let size = file.take(LARGEST_BLANK + 1).read_to_end(&mut text).unwrap_or(usize::MAX);
    let mut lines = text.split(|byte| *byte == b'\n').map(<[u8]>::trim_ascii);
    size as u64 <= LARGEST_BLANK && lines.all(|line| line.is_empty() || line.starts_with(b"#"))
}

/// Position of a file relative to the previous part of the same recording.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum SeriesRelation {
    /// No previous part.
    #[default]
    Independent,
    /// The next part of the series that contains this file.
    Continues(usize),
    /// The same recorder, after a pause that is longer than a series allows.
    Later(usize),
}
