//! What is asked of a place in a capture, and what is told of it.

use std::sync::Arc;

use cobscope_decoder::frame::{Frame, Timestamp};
use cobscope_decoder::replay::{Spot, World};

use super::{Matcher, Row};

/// A place to go to.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Target {
    /// An event.
    Spot(Spot),
    /// Behind all events up to a time.
    Time(Timestamp),
    /// Behind the last event there is.
    End,
}

/// What is wanted of a place.
#[derive(Debug, Clone)]
pub struct Order {
    /// Comes back with the answer.
    pub serial: u64,
    /// Where to.
    pub target: Target,
    /// Rows wanted up to the place.
    pub before: usize,
    /// Rows wanted behind it.
    pub after: usize,
    /// Which rows.
    pub matcher: Matcher,
    /// Go on to the next row with this text, or back to the last one before.
    pub search: Option<Search>,
}

/// A search from a place on.
#[derive(Debug, Clone)]
pub struct Search {
    /// What a row must be like, besides the order's matcher.
    pub matcher: Matcher,
    /// Towards the beginning.
    pub is_backward: bool,
}

/// What is at a place.
#[derive(Clone)]
pub struct Window {
    /// The order's.
    pub serial: u64,
    /// Rows around the place, in order.
    pub rows: Vec<Row>,
    /// The last row up to the place; the first one where all are behind it.
    pub selected: usize,
    /// The place, as an event's.
    pub spot: Spot,
    /// What is known there.
    pub world: Arc<World>,
    /// Frames of the exchange that is selected, as far as they are few and close together.
    pub frames: Vec<Frame>,
    /// The place lies behind what is indexed: this is as far as it goes by now.
    pub is_pending: bool,
    /// A search found nothing.
    pub is_missed: bool,
}
