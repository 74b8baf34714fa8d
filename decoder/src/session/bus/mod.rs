//! State of one bus: nodes, stores, states, names, clock. Machines change it, observers read it.
//!
//! State of one node is in its [`Node`], so that it moves with the node to another node-ID or address.

mod behaviour;
mod cadence;
mod channels;
mod clock;
mod cob_id;
mod conflicts;
mod device_state;
mod doings;
mod facts;
mod faults;
mod gaps;
mod gates;
mod groups;
mod identifiers;
mod last_payload;
mod layout;
mod life;
mod link;
mod moment;
mod monitoring;
mod named;
mod node;
mod node_id_changes;
mod omissions;
mod open_transfers;
mod pdo_identifiers;
mod pdo_users;
mod pending_node_id;
mod plan;
mod procedures;
mod pulse;
mod restart;
mod routes;
mod sdo_dialogues;
mod set_point;
mod shared_gap;
mod signs;
mod skipped_times;
mod state;
mod state_machine;
mod store;
mod unnamed_uds;

pub(in crate::session) use cadence::Cadence;
pub(crate) use clock::AmbiguousGap;
pub(in crate::session) use cob_id::{cob_identifier, nonzero_identifier, predefined_identifier};
pub(in crate::session) use faults::DtcChange;
pub use gates::GateState;
pub(in crate::session) use groups::{ConcernedDevice, SenderGroup};
pub(in crate::session) use last_payload::LastPayload;
pub(in crate::session) use layout::{of_profile as layout_of_profile, pdo_layout};
pub use life::{LifeSign, LifeWatch};
pub(in crate::session) use link::{UdsLink, UdsPairs};
pub(in crate::session) use moment::FrameMoment;
pub(in crate::session) use monitoring::UNANSWERED;
pub(in crate::session) use node::DetectedByteOrder;
pub use node::{NmtStatus, Node};
pub use pending_node_id::PendingNodeId;
pub(in crate::session) use plan::{IdentifierPlan, RecentFrames, WatchPlan};
pub(in crate::session) use procedures::{ProcedureResult, RunningProcedure};
pub(in crate::session) use restart::RestartType;
pub(in crate::session) use routes::{IdentifierService, IdentifierState, RouteOrigin};
pub use sdo_dialogues::SdoPairHint;
pub use set_point::EmittedSetPoint;
pub(in crate::session) use set_point::GatedSetPoint;
pub(in crate::session) use set_point::SetPointState;
pub(crate) use signs::ProfileSigns;
pub(crate) use skipped_times::SkippedTimes;
pub use state::Bus;
pub(in crate::session) use state_machine::{
    CommandStep, MachineState, is_triggered_by, leads_further, leads_to, leave_text,
};
pub use store::{ObjectStore, OriginKind, PendingValue, StoredObject, StoredOrigin};
pub use unnamed_uds::UdsPairHint;
