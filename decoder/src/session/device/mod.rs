//! What a node is, and what follows from it.

mod assign;
mod behaviour;
mod bits;
mod gates;
mod identity;
mod machine;
mod plan;
mod procedure;
mod restart;
mod set_point;
mod values;

pub(super) use behaviour::Behaviour;
pub use gates::{GateState, GateStatus};
pub(super) use plan::{Plan, Planned, Recent};
pub(super) use procedure::Announcement;
pub(super) use restart::Restart;
