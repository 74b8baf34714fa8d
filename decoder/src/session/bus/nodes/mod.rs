//! Nodes of a bus. The state of one node moves with it to another node-ID or address.

mod behaviour;
mod bus_nodes;
mod conflicts;
mod device_state;
mod errors;
mod facts;
mod faults;
mod gates;
mod layout;
mod monitoring;
mod node;
mod node_id_changes;
mod pdo_users;
mod reception;
mod restart;
mod set_point;
mod state_machine;

pub(in crate::session) use behaviour::{ProcedureResult, RunningProcedure};
pub use bus_nodes::BusNodes;
pub(in crate::session) use bus_nodes::ConcernedDevice;
pub(in crate::session) use faults::DtcChange;
pub use gates::GateState;
pub(in crate::session) use gates::SetPointGates;
pub(in crate::session) use layout::{of_profile as layout_of_profile, pdo_layout};
pub(in crate::session) use monitoring::UNANSWERED;
pub(in crate::session) use node::DetectedByteOrder;
pub use node::{NmtStatus, Node};
pub(in crate::session) use node_id_changes::NodeIdChanges;
pub use node_id_changes::PendingNodeId;
pub(in crate::session) use restart::{RestartEvidence, RestartType};
pub use set_point::EmittedSetPoint;
pub(in crate::session) use set_point::{GatedSetPoint, SetPointState, ShortPayload};
pub(in crate::session) use state_machine::{
    CommandStep, MachineState, is_triggered_by, leads_further, leads_to, leave_text,
};
