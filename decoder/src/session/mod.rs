//! Messages to events: everything that is remembered about a bus.
//!
//! ```text
//! Frame ─Bus::push─▶ clock, deadlines ─▶ route of its identifier ─▶ service handler ─▶ Observer::event
//! ```
//!
//! A [`Bus`] is cloneable and holds no handles: a clone is a checkpoint. Everything it keeps is bounded;
//! what must be given up says so as an `evicted` event.

mod belief;
mod bus;
mod canopen;
mod clock;
mod deadlines;
mod device;
mod emit;
mod frames;
mod given;
mod j1939;
mod node;
mod nodes;

mod routes;
mod store;
mod timers;
mod uds;

pub use crate::profile::device::GateStatus;
pub use bus::Bus;
pub use device::{GateState, Sign, StandingPoint, Watch};
pub use node::{AssignedBy, NmtStatus, Node};
pub use store::{Entry, Origin, OriginKind, Store};

use std::sync::Arc;

use crate::bus_file::BusFile;
use crate::event::Event;
use crate::profile::dbc::Database;
use crate::profile::{Catalogue, Device};
use crate::wire::NodeId;

/// Data kept of one transfer, in bytes.
pub const TRANSFER_DATA_LIMIT: usize = 64 * 1024;
/// Data kept of all open transfers of a bus in bytes: of SDO, ISO-TP and UDS requests that wait together, and as
/// much again of J1939.
pub const OPEN_DATA_LIMIT: usize = 4 * 1024 * 1024;
/// SDO channels of a bus, so also open transfers.
pub const CHANNEL_LIMIT: usize = 256;
/// ISO-TP messages of a bus that are on their way; also open J1939 transfers.
pub const TRANSPORT_LIMIT: usize = 256;
/// UDS requests of a bus that wait for an answer.
pub const EXCHANGE_LIMIT: usize = 256;
/// Active errors of a node; also active, and previously active, trouble codes of a J1939 device.
pub const ACTIVE_ERROR_LIMIT: usize = 64;
/// J1939 devices of a bus without an address that are remembered.
pub const ADDRESSLESS_LIMIT: usize = 64;
/// J1939 devices of a bus that were commanded to an address they did not claim yet.
pub const COMMANDED_LIMIT: usize = 64;
/// 29-bit identifiers of a bus that are kept apart.
pub const EXTENDED_ID_LIMIT: usize = 4096;
/// Objects of a node in the store.
pub const OBJECT_LIMIT: usize = 4096;
/// Bytes of all values of a node in the store: 127 nodes stay within 8 MiB.
pub const OBJECT_BYTES_LIMIT: usize = 64 * 1024;
/// Contradictions to its device file that are told of a node.
pub const CONFLICT_LIMIT: usize = 256;
/// Bytes of one object's value in the store.
pub const OBJECT_VALUE_LIMIT: usize = 1024;

/// Takes events as they happen.
pub trait Observer {
    /// `event` happened on `bus`, which is shown as it is behind it.
    fn event(&mut self, event: &Event, bus: &Bus);
}

impl<F: FnMut(&Event, &Bus)> Observer for F {
    fn event(&mut self, event: &Event, bus: &Bus) {
        self(event, bus);
    }
}

/// Which protocol the traffic is taken for.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum ProtocolChoice {
    /// By evidence.
    #[default]
    Auto,
    /// CANopen on 11 bits, whatever the evidence; the rest by evidence.
    Canopen,
    /// J1939 on 29 bits, whatever the evidence; the rest by evidence.
    J1939,
    /// Nothing: frames only.
    None,
}

/// What the caller states about a bus.
#[derive(Debug, Clone)]
pub struct SessionOptions {
    /// Protocol.
    pub protocol: ProtocolChoice,
    /// Nanoseconds after which an SDO transfer without a further frame counts as unanswered.
    pub sdo_silence: i64,
    /// Names the user gave to nodes.
    pub node_names: Vec<(NodeId, String)>,
    /// What the user knows of the buses; it goes before everything learnt.
    pub bus_file: BusFile,
    /// All profiles.
    pub catalogue: Arc<Catalogue>,
    /// What nodes are; of two for one node the last counts.
    pub assignments: Vec<Assignment>,
    /// Messages the user's databases tell, on every bus.
    pub database: Arc<Database>,
    /// The same by name of a bus for those that have databases of their own; each has what holds on every bus too.
    pub bus_databases: Vec<(String, Arc<Database>)>,
}

/// What a node is, as the user says.
#[derive(Debug, Clone)]
pub struct Assignment {
    /// Name of the bus; all buses if none.
    pub bus: Option<String>,
    /// The node.
    pub node: NodeId,
    /// Device.
    pub device: Arc<Device>,
    /// Who says so.
    pub by: AssignedBy,
}

impl Default for SessionOptions {
    fn default() -> Self {
        Self {
            protocol: ProtocolChoice::Auto,
            sdo_silence: 1_000_000_000,
            node_names: Vec::new(),
            bus_file: BusFile::default(),
            catalogue: Arc::default(),
            assignments: Vec::new(),
            database: Arc::default(),
            bus_databases: Vec::new(),
        }
    }
}

impl SessionOptions {
    /// The databases of a bus as one.
    fn database(&self, bus: &str) -> Arc<Database> {
        let own = self.bus_databases.iter().find(|(name, _)| name == bus);
        Arc::clone(own.map_or(&self.database, |(_, database)| database))
    }
}
