//! Frames that no protocol explains.

use std::sync::Arc;

use crate::frame::Frame;
use crate::profile::dbc::DatabaseMessage;

/// A frame that does not belong to a message of any known protocol.
#[derive(Debug, Clone)]
#[non_exhaustive]
pub struct UndecodedFrame {
    /// The frame itself.
    pub frame: Frame,
    /// Name of its service, if only that is known.
    pub name: Option<&'static str>,
    /// Description of the identifier in a database of the user.
    pub message: Option<Arc<DatabaseMessage>>,
}
