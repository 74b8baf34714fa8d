//! Facts about nodes, messages and the recording that no single event contains.

mod moments;
mod recording_loss;
mod role;
mod senders;

pub(crate) use moments::{LastTransfer, NodeMoment, NodeMoments};
pub(crate) use recording_loss::RecordingLoss;
pub(crate) use role::is_controller;
pub(crate) use senders::{PeriodicStream, Sender, SenderSilence, SenderStreams, observe_senders};
