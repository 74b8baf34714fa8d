//! What the caller states about a bus before its first frame.

use std::sync::Arc;

use crate::bus_file::BusFile;
use crate::profile::dbc::Database;
use crate::profile::{Catalogue, Device};
use crate::wire::NodeId;

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
    pub(in crate::session) fn database(&self, bus: &str) -> Arc<Database> {
        let own = self.bus_databases.iter().find(|(name, _)| name == bus);
        Arc::clone(own.map_or(&self.database, |(_, database)| database))
    }
}

/// What told which device a node is.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum AssignedBy {
    /// The command line.
    Option,
    /// The bus file.
    BusFile,
    /// An EDS, DCF or XDD file.
    DeviceFile,
    /// What the node said of itself.
    Identity,
    /// Its device type alone, which says what sort of device it is: anything better takes its place.
    DeviceType,
}

impl AssignedBy {
    /// The name used in all output.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Option => "option",
            Self::BusFile => "bus-file",
            Self::DeviceFile => "device-file",
            Self::Identity => "identity",
            Self::DeviceType => "device-type",
        }
    }
}
