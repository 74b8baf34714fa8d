//! Why a capture cannot be read.

use std::io::ErrorKind;

/// Why a capture cannot be read at all, or no further.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum CaptureError {
    /// The source failed, or breaks off inside of what it is compressed with.
    #[error("{how}: {0}", how = how(.0))]
    Io(std::io::Error),
    /// No format's reader knows these bytes.
    #[error("not a capture in a known format ({known}); it begins with {found}")]
    Unrecognised {
        /// Titles of the formats that were tried.
        known: String,
        /// The first bytes, printable.
        found: String,
    },
    /// The format is known but its header cannot be used.
    #[error("{format}: byte {offset}: found {found}, expected {expected}")]
    Header {
        /// Title of the format.
        format: &'static str,
        /// Byte offset in the decompressed capture.
        offset: u64,
        /// What stands there.
        found: String,
        /// What should stand there.
        expected: &'static str,
    },
    /// No bytes at all.
    #[error("the capture is empty")]
    Empty,
}

/// What failed stands in the text, so it is no source: those who print sources too would say it twice.
impl From<std::io::Error> for CaptureError {
    fn from(error: std::io::Error) -> Self {
        Self::Io(error)
    }
}

/// What became of the source.
fn how(error: &std::io::Error) -> &'static str {
    match error.kind() {
        ErrorKind::UnexpectedEof => "the file is cut off",
        _ => "reading failed",
    }
}
