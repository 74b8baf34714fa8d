//! The files of a user as one: whatever two tell, the first counts.

use std::collections::HashMap;
use std::sync::Arc;

use foldhash::fast::RandomState;

use super::{DatabaseFile, DatabaseMessage, Parameter};
use crate::frame::CanId;
use crate::wire::j1939::Pgn;

/// Messages by identifier and by parameter group, and suspect parameters by number.
#[derive(Debug, Clone, Default)]
pub struct Database {
    frames: HashMap<CanId, Arc<DatabaseMessage>, RandomState>,
    groups: HashMap<Pgn, Arc<DatabaseMessage>, RandomState>,
    parameters: HashMap<u32, Parameter, RandomState>,
}

impl Database {
    /// Adds what a file tells and no earlier one did.
    pub fn add(&mut self, file: DatabaseFile) {
        for known in file.messages {
            if let Some(id) = known.id {
                self.frames.entry(id).or_insert_with(|| Arc::clone(&known.message));
            }
            if let Some(pgn) = known.pgn {
                self.groups.entry(pgn).or_insert(known.message);
            }
        }
        for (spn, parameter) in file.parameters {
            self.parameters.entry(spn).or_insert(parameter);
        }
    }

    /// Whether no message is known.
    pub fn is_empty(&self) -> bool {
        self.frames.is_empty() && self.groups.is_empty()
    }

    /// The message with exactly this identifier.
    pub fn frame(&self, id: CanId) -> Option<&Arc<DatabaseMessage>> {
        self.frames.get(&id)
    }

    /// The message of a parameter group, from whichever source to whichever destination.
    pub fn message(&self, pgn: Pgn) -> Option<&Arc<DatabaseMessage>> {
        self.groups.get(&pgn)
    }

    /// Name and unit of a suspect parameter.
    pub fn parameter(&self, spn: u32) -> Option<&Parameter> {
        self.parameters.get(&spn)
    }
}
