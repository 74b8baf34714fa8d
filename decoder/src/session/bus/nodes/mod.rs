//! State of one node; it moves with the node to another node-ID or address.

mod behaviour;
mod conflicts;
mod device_state;
mod facts;
mod faults;
mod gates;
mod layout;
mod monitoring;
mod named;
mod node;
mod node_id_changes;
mod restart;
mod set_point;
mod state_machine;

pub(in crate::session) use behaviour::{ProcedureResult, RunningProcedure};
pub(in crate::session) use faults::DtcChange;
pub use gates::GateState;
pub(in crate::session) use layout::{of_profile as layout_of_profile, pdo_layout};
pub(in crate::session) use monitoring::UNANSWERED;
pub(in crate::session) use named::NamedNodes;
pub(in crate::session) use node::DetectedByteOrder;
pub use node::{NmtStatus, Node};
pub(in crate::session) use node_id_changes::NodeIdChanges;
pub use node_id_changes::PendingNodeId;
pub(in crate::session) use restart::{RestartEvidence, RestartType};
pub use set_point::EmittedSetPoint;
pub(in crate::session) use set_point::{GatedSetPoint, SetPointState};
pub(in crate::session) use state_machine::{
    CommandStep, MachineState, is_triggered_by, leads_further, leads_to, leave_text,
};
