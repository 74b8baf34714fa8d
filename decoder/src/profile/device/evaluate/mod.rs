//! Evaluates conditions and triggers of profiles: each operator exists here once.
//!
//! ```text
//! Condition + DeviceFacts ─evaluate─▶ GateStatus        Trigger + TriggerEvent ─is_met_by─▶ bool
//! ```
//!
//! The certainty a caller demands is in its facts: the session also accepts values that are only assumed, rules
//! accept proven values only. Nothing here allocates, since rules evaluate conditions for each PDO.

mod condition;
#[allow(dead_code, reason = "rules still have their own")]
mod trigger;

pub use condition::GateStatus;
pub(crate) use condition::{DeviceFacts, SYNC_AGE, evaluate_all};
pub(crate) use trigger::{TriggerEvent, UpdateSource, ValueUpdate};

/// A raw number reduced to the bits that count.
fn masked(raw: i64, mask: u64) -> i64 {
    (raw.cast_unsigned() & mask).cast_signed()
}
