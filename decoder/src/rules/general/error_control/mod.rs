//! Rules about NMT error control: heartbeat and guarding.

pub(super) mod guard_late;
pub(super) mod guard_no_answer;
pub(super) mod guard_toggle;
pub(super) mod guard_with_heartbeat;
pub(super) mod heartbeat_consumer;
pub(super) mod heartbeat_period;
pub(super) mod node_lost;
