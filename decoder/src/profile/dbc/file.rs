//! Messages and parameters of one database file.

use std::sync::Arc;

use super::problem::DbcProblem;
use crate::frame::CanId;
use crate::profile::layout::PayloadLayout;
use crate::wire::j1939::Pgn;

/// Definition of one message in a database.
#[derive(Debug, Clone, PartialEq)]
pub struct DatabaseMessage {
    /// Name, from the long-name attribute if present.
    pub name: String,
    /// Payload in bytes; `None` if variable or not stated. A message longer than one frame is never decoded
    /// from a single frame.
    pub length: Option<u16>,
    /// Layout of the signals.
    pub layout: Arc<PayloadLayout>,
}

/// Name and unit of a suspect parameter, for events that carry only its number.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct SuspectParameter {
    /// Name of the parameter.
    pub name: String,
    /// Unit; empty if there is none.
    pub unit: String,
}

/// Contents of one database file.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct DatabaseFile {
    /// Messages in file order; identifiers and parameter groups are unique.
    pub(super) messages: Vec<KnownMessage>,
    /// Suspect parameters by number; the first definition of each.
    pub(super) parameters: Vec<(u32, SuspectParameter)>,
    /// Problems in file order: skipped parts and assumptions.
    pub problems: Vec<DbcProblem>,
}

/// A message with its identifier and parameter group.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct KnownMessage {
    pub(super) id: Option<CanId>,
    /// Parameter group, and the message as one of that group.
    pub(super) group: Option<(Pgn, Arc<DatabaseMessage>)>,
    pub(super) message: Arc<DatabaseMessage>,
}

impl DatabaseFile {
    /// Number of messages.
    pub fn len(&self) -> usize {
        self.messages.len()
    }

    /// Whether the file contains no messages.
    pub fn is_empty(&self) -> bool {
        self.messages.is_empty()
    }

    /// Messages in file order, with their identifier if they have one.
    pub fn messages(&self) -> impl Iterator<Item = (Option<CanId>, &DatabaseMessage)> {
        self.messages.iter().map(|known| (known.id, &*known.message))
    }
}
