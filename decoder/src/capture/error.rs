//! Errors that stop the reading of a capture.

use std::io::ErrorKind;

/// Reason why a capture cannot be read at all, or no further.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum CaptureError {
    /// The source cannot be read, or its compressed data ends early.
    #[error("{how}: {0}", how = describe_error(.0))]
    Io(std::io::Error),
    /// The first bytes match no known format.
    #[error("not a capture in a known format ({known}); it begins with {found}")]
    Unrecognised {
        /// Titles of the known formats.
        known: String,
        /// The first bytes, escaped.
        found: String,
    },
    /// Another kind of file, or a capture in an unsupported form.
    #[error("{name}, not a capture in a known format; {remedy}")]
    Foreign {
        /// The kind of file, with its article.
        name: &'static str,
        /// What to do with it.
        remedy: &'static str,
    },
    /// The format is known, but its header is unusable.
    #[error("{format}: byte {offset}: found {found}; expected {expected}")]
    Header {
        /// Title of the format.
        format: &'static str,
        /// Byte offset in the decompressed capture.
        offset: u64,
        /// Content found at the offset.
        found: String,
        /// Content expected at the offset.
        expected: &'static str,
    },
    /// The capture is empty.
    #[error("the capture is empty")]
    Empty,
}

/// No `#[source]`: the message already contains the cause, and printing the chain would repeat it.
impl From<std::io::Error> for CaptureError {
    fn from(error: std::io::Error) -> Self {
        Self::Io(error)
    }
}

/// Description of an I/O error.
fn describe_error(error: &std::io::Error) -> &'static str {
    match error.kind() {
        ErrorKind::UnexpectedEof => "the file is cut off",
        _ => "reading failed",
    }
}
