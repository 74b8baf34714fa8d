//! Options of the caller for a bus, set before its first frame.

use std::sync::Arc;

use crate::bus_file::BusFile;
use crate::event::AssignedBy;
use crate::profile::dbc::Database;
use crate::profile::{Catalogue, DeviceProfile};
use crate::wire::NodeId;

pub use crate::bus_file::ProtocolChoice;

/// Options of the caller for the buses of a capture.
#[derive(Debug, Clone)]
pub struct SessionOptions {
    /// Protocol choice for all buses; unless `Auto`, it overrides the bus file.
    pub protocol: ProtocolChoice,
    /// Timeout of an SDO transfer after its last frame, in ns.
    pub sdo_silence: i64,
    /// Node names from the user.
    pub node_names: Vec<(NodeId, String)>,
    /// Bus file; it overrides everything learnt from the traffic.
    pub bus_file: BusFile,
    /// All device profiles.
    pub catalogue: Arc<Catalogue>,
    /// Devices assigned to nodes. If a node is listed twice, the last entry wins.
    pub assignments: Vec<Assignment>,
    /// Nodes that the user named without a device: bus (`None` for all buses) and node.
    pub named: Vec<(Option<String>, NodeId)>,
    /// Messages from the user's databases, for all buses.
    pub database: Arc<Database>,
    /// Databases for single buses, by bus name; each also contains the messages of `database`.
    pub bus_databases: Vec<(String, Arc<Database>)>,
}

/// Device assigned to a node.
#[derive(Debug, Clone)]
pub struct Assignment {
    /// Bus name; `None` for all buses.
    pub bus: Option<String>,
    /// Node to which the device is assigned.
    pub node: NodeId,
    /// Profile of the device.
    pub device: Arc<DeviceProfile>,
    /// Source of the assignment.
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
            named: Vec::new(),
            database: Arc::default(),
            bus_databases: Vec::new(),
        }
    }
}

impl SessionOptions {
    /// Protocol choice for a bus.
    pub(in crate::session) fn protocol_of(&self, bus: &str) -> ProtocolChoice {
        match self.protocol {
            ProtocolChoice::Auto => self.bus_file.protocol(bus).unwrap_or_default(),
            chosen => chosen,
        }
    }

    /// Nodes that the user named for a bus, in ascending order, each once; `true` if the bus was named as well.
    pub fn named_nodes(&self, bus: &str) -> Vec<(NodeId, bool)> {
        let on = |named: Option<&str>, node: NodeId| match named {
            None => Some((node, false)),
            Some(name) => (name == bus).then_some((node, true)),
        };
        let options = self.named.iter().filter_map(|(named, node)| on(named.as_deref(), *node));
        let devices = self.assignments.iter().filter_map(|it| on(it.bus.as_deref(), it.node));
        let mut nodes: Vec<_> = options.chain(devices).chain(self.bus_file.named_nodes(bus)).collect();
        nodes.sort_unstable_by_key(|(node, is_own)| (node.table_place(), !is_own));
        nodes.dedup_by_key(|(node, _)| *node);
        nodes
    }

    /// All database messages of a bus.
    pub(in crate::session) fn database(&self, bus: &str) -> Arc<Database> {
        let own = self.bus_databases.iter().find(|(name, _)| name == bus);
        Arc::clone(own.map_or(&self.database, |(_, database)| database))
    }
}
