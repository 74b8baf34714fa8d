//! All database files of a user combined; the first definition wins.

use std::collections::HashMap;
use std::sync::Arc;

use foldhash::fast::RandomState;

use super::{DatabaseFile, DatabaseMessage, SuspectParameter};
use crate::frame::CanId;
use crate::profile::{IdentifierOwner, connection_set};
use crate::wire::j1939::Pgn;

/// Messages by identifier and by parameter group, and suspect parameters by number.
#[derive(Debug, Clone, Default)]
pub struct Database {
    frames: HashMap<CanId, Arc<DatabaseMessage>, RandomState>,
    groups: HashMap<Pgn, Arc<DatabaseMessage>, RandomState>,
    parameters: HashMap<u32, SuspectParameter, RandomState>,
}

impl Database {
    /// Adds a file; definitions of earlier files take precedence.
    pub fn add_file(&mut self, file: DatabaseFile) {
        for known in file.messages {
            if let Some(id) = known.id {
                self.frames.entry(id).or_insert_with(|| Arc::clone(&known.message));
            }
            if let Some((pgn, message)) = known.group {
                self.groups.entry(pgn).or_insert(message);
            }
        }
        for (spn, parameter) in file.parameters {
            self.parameters.entry(spn).or_insert(parameter);
        }
    }

    /// Whether the database contains no messages.
    pub fn is_empty(&self) -> bool {
        self.frames.is_empty() && self.groups.is_empty()
    }

    /// Message with exactly this identifier.
    pub fn message_by_id(&self, id: CanId) -> Option<&Arc<DatabaseMessage>> {
        self.frames.get(&id)
    }

    /// Whether a file has J1939 content: suspect parameter numbers.
    pub fn is_j1939(&self) -> bool {
        !self.parameters.is_empty()
    }

    /// CANopen nodes that the messages describe, in ascending order: a message on an identifier of the predefined
    /// connection set whose name contains the service, such as `TPDO1_Pump` on 185. The identifier alone is not
    /// enough: databases of cars use all of them.
    pub fn canopen_nodes(&self) -> Vec<u8> {
        let described = self.frames.iter().filter_map(|(id, message)| match id {
            CanId::Standard(id) => {
                let owner = connection_set().owner_of(*id);
                owner.node().filter(|_| names_service(owner, message))
            }
            CanId::Extended(_) => None,
        });
        let mut nodes: Vec<u8> = described.collect();
        nodes.sort_unstable();
        nodes.dedup();
        nodes
    }

    /// Message of a parameter group, for any source and destination.
    pub fn message_by_pgn(&self, pgn: Pgn) -> Option<&Arc<DatabaseMessage>> {
        self.groups.get(&pgn)
    }

    /// Name and unit of a suspect parameter.
    pub fn parameter_by_spn(&self, spn: u32) -> Option<&SuspectParameter> {
        self.parameters.get(&spn)
    }
}

/// Whether the name of a message contains the name of its service.
fn names_service(owner: IdentifierOwner, message: &DatabaseMessage) -> bool {
    let name = message.name.to_ascii_uppercase();
    let words: &[&str] = match owner {
        IdentifierOwner::Pdo(..) => &["PDO"],
        IdentifierOwner::Sdo(..) => &["SDO"],
        IdentifierOwner::Emcy(_) => &["EMCY", "EMERGENCY"],
        IdentifierOwner::ErrorControl(_) => &["HEARTBEAT", "ERRORCONTROL", "ERROR_CONTROL", "BOOTUP", "NMT"],
        _ => &[],
    };
    words.iter().any(|word| name.contains(word))
}

#[cfg(test)]
mod tests {
    use super::super::parse_database;
    use super::*;

    #[test]
    fn nodes_of_a_canopen_database() {
        // 389 = 185h TPDO1 of 5; 1797 = 705h heartbeat of 5; 1414 = 586h SDO response of 6. 391 = 187h is in the
        // range of TPDO1 too, but its name is not; 2566844806 = 18FF_0186h has 29 bits.
        let text = "BO_ 389 TPDO1_Pump: 8 N\n SG_ A : 0|8@1+ (1,0) [0|0] \"\" N\n\
                    BO_ 1797 Heartbeat5: 1 N\n SG_ B : 0|8@1+ (1,0) [0|0] \"\" N\n\
                    BO_ 1414 sdo_rx: 8 N\n SG_ C : 0|8@1+ (1,0) [0|0] \"\" N\n\
                    BO_ 391 GEARBOX: 8 N\n SG_ D : 0|8@1+ (1,0) [0|0] \"\" N\n\
                    BO_ 2566844806 TPDO1_X: 8 N\n SG_ E : 0|8@1+ (1,0) [0|0] \"\" N\n";
        let mut database = Database::default();
        assert!(database.canopen_nodes().is_empty());
        database.add_file(parse_database(text.as_bytes()).unwrap());
        assert_eq!(database.canopen_nodes(), [5, 6]);
        assert!(!database.is_j1939());
    }
}
