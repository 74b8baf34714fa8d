//! The interface of all protocol machines.

use super::bus::Bus;
use super::context::Context;
use crate::frame::Frame;

/// One protocol machine of a bus. What it remembers of the bus as a whole is its own; what it remembers of a node is in
/// the [`Node`](super::bus::Node), so that it moves with the node. A clone is part of a checkpoint.
pub(in crate::session) trait Machine {
    /// What the decoder knows of a frame by its identifier, or by the machine before this one.
    type Route<'a>;
    /// What another machine continues with.
    type Product;

    /// Handles a frame of this machine's service.
    fn on_frame(&mut self, route: Self::Route<'_>, frame: &Frame, cx: &mut Context<'_>) -> Self::Product;

    /// All traffic stopped for `delay` nanoseconds: moves the deadlines that are not over yet.
    fn on_silence(&mut self, _delay: i64, _bus: &mut Bus) {}

    /// The capture ended: closes what is open.
    fn on_end(&mut self, _cx: &mut Context<'_>) {}

    /// Bytes held by the machine, apart from the bus.
    fn footprint(&self) -> usize {
        0
    }
}

/// A machine with entries in the timer queue.
pub(in crate::session) trait Timed: Machine {
    /// Whose deadline it is.
    type Deadline;

    /// An entry came due at monotonic time `now`; the deadline itself may have moved.
    fn on_deadline(&mut self, deadline: Self::Deadline, now: i64, cx: &mut Context<'_>) -> Self::Product;
}
