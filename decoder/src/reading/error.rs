//! Errors of a reading.

use crate::capture::CaptureError;
use crate::profile::dbc::DbcProblem;
use crate::profile::{ProfileError, TextError};

/// Error of building a reading or of reading a capture.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum ReadingError {
    /// The bus file is invalid.
    #[error("bus file: {0}")]
    BusFile(TextError),
    /// A profile is invalid or unknown.
    #[error(transparent)]
    Profile(#[from] ProfileError),
    /// The database has an unknown format.
    #[error("database: {0}")]
    Database(DbcProblem),
    /// The capture cannot be read at all.
    #[error(transparent)]
    Capture(#[from] CaptureError),
    /// The capture contains no frame.
    #[error("the capture contains no frame")]
    NoFrames,
    /// The capture ends inside a record, or its source cannot be read further. All frames before that are
    /// decoded and checked: [`Reading::finish`](super::Reading::finish) returns their results.
    #[error("the capture is incomplete: {0}")]
    Incomplete(String),
}
