//! A trigger: the reason to write a capture of the frames around it.

use cobscope_decoder::frame::Timestamp;
use cobscope_decoder::wire::NodeId;

/// An event or finding that triggers a capture.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct CaptureTrigger {
    /// Name of the bus.
    pub bus: String,
    /// Node; None for the bus as a whole.
    pub node: Option<NodeId>,
    /// Node with its name, or source and destination, as in lines of events.
    pub subject: String,
    /// Rule of the finding, or kind of the event.
    pub cause: String,
    /// Text of the event or finding. It can contain any text of the bus.
    pub text: String,
    /// Time of the event or finding; None without timestamps.
    pub time: Option<Timestamp>,
    /// Number of the first frame of the event or finding, or of its cause.
    pub first_frame: u64,
    /// Number of the last frame of the event or finding.
    pub last_frame: u64,
}

impl CaptureTrigger {
    /// Comment at the frame of the trigger.
    pub(super) fn frame_comment(&self) -> String {
        let node = self.node.map_or_else(String::new, |node| format!("{}: ", node.sentence_label()));
        format!("trigger {}: {node}{}", self.cause, self.text)
    }
}
