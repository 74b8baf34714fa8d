//! Facts about nodes and the recording that no single event contains.

mod recording_loss;
mod role;

pub(crate) use recording_loss::RecordingLoss;
pub(crate) use role::is_controller;
