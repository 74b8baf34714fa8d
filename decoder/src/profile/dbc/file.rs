//! Messages and parameters of one file.

use std::sync::Arc;

use super::problem::Problem;
use crate::frame::CanId;
use crate::profile::layout::Layout;
use crate::wire::j1939::Pgn;

/// One message of a database.
#[derive(Debug, Clone, PartialEq)]
pub struct DatabaseMessage {
    /// Name.
    pub name: String,
    /// Payload in bytes. One of more than a frame carries comes in several, so no frame alone is laid out by it.
    /// `None` if its length varies or is not told.
    pub length: Option<u16>,
    /// Signals.
    pub layout: Arc<Layout>,
}

/// A suspect parameter, for whoever only has its number.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Parameter {
    /// Name.
    pub name: String,
    /// Unit; empty if there is none.
    pub unit: String,
}

/// What was read of one file.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct DatabaseFile {
    /// Messages in the order of the file, each identifier and each parameter group once.
    pub(super) messages: Vec<Known>,
    /// Suspect parameters by number, the first of each.
    pub(super) parameters: Vec<(u32, Parameter)>,
    /// What was left out, or read only by a guess, by place.
    pub problems: Vec<Problem>,
}

/// A message and what it is known by.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Known {
    pub(super) id: Option<CanId>,
    pub(super) pgn: Option<Pgn>,
    pub(super) message: Arc<DatabaseMessage>,
}

impl DatabaseFile {
    /// How many messages there are.
    pub fn len(&self) -> usize {
        self.messages.len()
    }

    /// Whether there is no message.
    pub fn is_empty(&self) -> bool {
        self.messages.is_empty()
    }

    /// The messages with their identifier, where they have one, in the order of the file.
    pub fn messages(&self) -> impl Iterator<Item = (Option<CanId>, &DatabaseMessage)> {
        self.messages.iter().map(|known| (known.id, &*known.message))
    }
}
