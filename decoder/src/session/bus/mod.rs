//! State of one bus: nodes, stores, states, names, clock. Machines change it, observers read it.
//!
//! State of one node is in its [`Node`], so that it moves with the node to another node-ID or address.

mod groups;
mod hints;
mod identifier_meanings;
mod identifiers;
mod life;
mod nodes;
mod objects;
mod open_transfers;
mod protocols;
mod state;
mod streams;
mod time;

pub(in crate::session) use groups::SenderGroup;
pub(crate) use hints::ProfileSigns;
pub use hints::{BusHints, SdoPairHint, UdsPairHint};
pub use identifiers::IdentifierRoutes;
pub(in crate::session) use identifiers::{
    IdentifierPlan, IdentifierService, LastPayload, RecentFrames, RouteOrigin, UdsLink, UdsPairs, WatchPlan,
};
pub use life::{LifeSign, LifeWatch};
pub use nodes::{BusNodes, EmittedSetPoint, GateState, NmtStatus, Node, PendingNodeId};
pub(in crate::session) use nodes::{
    CommandStep, ConcernedDevice, DetectedByteOrder, DtcChange, GatedSetPoint, MachineState, ProcedureResult,
    RestartType, RunningProcedure, SetPointGates, SetPointState, ShortPayload, UNANSWERED, is_triggered_by,
    layout_of_profile, leads_further, leads_to, leave_text, pdo_layout,
};
pub use objects::{ObjectStore, OriginKind, PendingValue, StoredObject, StoredOrigin};
pub(in crate::session) use objects::{cob_identifier, nonzero_identifier, predefined_identifier};
pub use protocols::BusProtocols;
pub use state::Bus;
pub(crate) use streams::{BusStream, StreamService};
pub(crate) use time::{AmbiguousGap, SkippedTimes, StreamRegularity};
pub(in crate::session) use time::{Cadence, FrameMoment};
