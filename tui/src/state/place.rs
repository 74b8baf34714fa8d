//! Places in time and nodes, as panes and prompts name them.

use cobscope_decoder::frame::{BusIndex, Timestamp};
use cobscope_decoder::replay::Spot;
use cobscope_decoder::wire::NodeId;

/// A node on a bus.
pub type NodeKey = (BusIndex, NodeId);

/// A place in time to go to.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Place {
    /// The beginning.
    Start,
    /// The end.
    End,
    /// An event.
    Spot(Spot),
    /// Behind a frame.
    Frame(u64),
    /// A time of the captures' own clock.
    Time(Timestamp),
}
