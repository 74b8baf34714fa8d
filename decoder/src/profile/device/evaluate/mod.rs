//! Evaluates conditions and triggers of profiles: each operator exists here once.
//!
//! ```text
//! Condition + DeviceFacts ─evaluate─▶ GateStatus        Trigger + TriggerEvent ─is_met_by─▶ bool
//! ```
//!
//! The caller's facts define the required certainty: the session also accepts assumed values, rules accept
//! only proven ones. No operator allocates memory, because rules evaluate conditions for each PDO.

mod condition;
mod trigger;

pub use condition::GateStatus;
pub(crate) use condition::{DeviceFacts, SYNC_AGE, evaluate_all};
pub(crate) use trigger::{LssEvent, TriggerEvent, UpdateSource, ValueUpdate};
