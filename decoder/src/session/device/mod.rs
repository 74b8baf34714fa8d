//! What a node is, and what follows from it.

mod assign;
mod behaviour;
mod bits;
mod conflict;
mod delivered;
mod facts;
mod gates;
mod identity;
mod machine;
mod plan;
mod procedure;
mod restart;
mod set_point;
mod standing;
mod values;

pub(super) use assign::given_devices;
pub(super) use behaviour::Behaviour;
pub(super) use conflict::Conflicts;
pub use gates::GateState;
pub(super) use plan::{Plan, Planned, Recent};
pub(super) use procedure::Announcement;
pub(super) use restart::Restart;
pub use standing::{Sign, StandingPoint, Watch};
