//! Frames that no protocol explains.

use std::sync::Arc;

use crate::frame::Frame;
use crate::profile::dbc::DatabaseMessage;

/// A frame that is no message of any protocol.
#[derive(Debug, Clone)]
#[non_exhaustive]
pub struct Undecoded {
    /// The frame.
    pub frame: Frame,
    /// Name of its service where that is all that is known.
    pub name: Option<&'static str>,
    /// What a database of the user tells of its identifier.
    pub message: Option<Arc<DatabaseMessage>>,
}
