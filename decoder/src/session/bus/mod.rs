//! What is known of one bus: nodes, stores, states, names, clock. Observers read it, machines change it.
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
mod gates;
mod groups;
mod identifiers;
mod layout;
mod life;
mod link;
mod moment;
mod monitoring;
mod node;
mod node_id_changes;
mod open_transfers;
mod plan;
mod procedures;
mod restart;
mod routes;
mod set_point;
mod state;
mod state_machine;
mod store;
mod unnamed_uds;

pub(in crate::session) use cadence::Cadence;
pub(in crate::session) use cob_id::{identifier, predefined};
pub(in crate::session) use faults::DtcChange;
pub use gates::GateState;
pub(in crate::session) use groups::{ConcernedDevice, Group};
pub(in crate::session) use layout::{layout, of_profile as layout_of_profile};
pub use life::{Sign, Watch};
pub(in crate::session) use link::{Link, Pairs};
pub(in crate::session) use moment::Moment;
pub(in crate::session) use node::LearntOrder;
pub use node::{NmtStatus, Node};
pub(in crate::session) use plan::{Plan, Planned, Recent};
pub(in crate::session) use procedures::Running;
pub(in crate::session) use restart::Restart;
pub(in crate::session) use routes::{RouteOrigin, Service};
pub(in crate::session) use set_point::SetPointState;
pub use set_point::StandingPoint;
pub(in crate::session) use set_point::Subject;
pub use state::Bus;
pub(in crate::session) use state_machine::{MachineState, Step, fits, goes_on, leads, leave};
pub(in crate::session) use store::Waiting;
pub use store::{Entry, Origin, OriginKind, Store};
