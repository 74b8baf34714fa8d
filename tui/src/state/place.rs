//! Nodes and cursor positions.

use cobscope_decoder::frame::{BusIndex, Timestamp};
use cobscope_decoder::replay::EventPosition;
use cobscope_decoder::wire::NodeId;

/// A node on a bus.
pub type NodeKey = (BusIndex, NodeId);

/// A cursor position to go to.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum JumpPlace {
    /// Before the first frame.
    Start,
    /// After the last frame.
    End,
    /// An event.
    Event(EventPosition),
    /// After a frame.
    Frame(u64),
    /// A timestamp of the captures.
    Time(Timestamp),
}

/// A position that is only looked at.
#[derive(Debug)]
pub(super) struct PositionPreview {
    pub(super) serial: u64,
    /// Its frame and time; None until they are known.
    pub(super) text: Option<String>,
}
