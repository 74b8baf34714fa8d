//! Evaluates conditions and triggers of profiles: each operator exists here once.
//!
//! ```text
//! Condition + DeviceFacts ─evaluate─▶ GateStatus        Trigger + TriggerEvent ─is_met_by─▶ bool
//! ```
//!
//! The certainty a caller demands is in its facts: the session also accepts values that are only assumed, rules
//! accept proven values only. Nothing here allocates, since rules evaluate conditions for each PDO.

mod condition;
mod trigger;

pub use condition::GateStatus;
pub(crate) use condition::{DeviceFacts, SYNC_AGE, evaluate_all};
pub(crate) use trigger::{LssEvent, TriggerEvent, UpdateSource, ValueUpdate};
