//! The interface of all protocol machines.

use super::bus::Bus;
use super::context::MachineContext;
use crate::frame::Frame;

/// One protocol machine of a bus. It holds the state that concerns the whole bus; state of a node is in the
/// [`Node`](super::bus::Node), so that it moves with the node. A clone is part of a checkpoint.
pub(in crate::session) trait ProtocolMachine {
    /// Meaning of a frame, taken from its identifier or from the previous machine.
    type Route<'a>;
    /// Result for the next machine.
    type Product;

    /// Handles a frame of the machine's service.
    fn on_frame(
        &mut self,
        route: Self::Route<'_>,
        frame: &Frame,
        cx: &mut MachineContext<'_>,
    ) -> Self::Product;

    /// All traffic stopped for `delay` ns: postpones pending deadlines.
    fn on_silence(&mut self, _delay: i64, _bus: &mut Bus) {}

    /// Closes open transfers at the end of the capture.
    fn on_end(&mut self, _cx: &mut MachineContext<'_>) {}

    /// Bytes held by the machine, without the bus.
    fn memory_size(&self) -> usize {
        0
    }
}

/// A machine with entries in the timer queue.
pub(in crate::session) trait TimedMachine: ProtocolMachine {
    /// Subject of a deadline.
    type Deadline;

    /// Handles an entry that is due at monotonic time `now`; the deadline itself may have moved.
    fn on_deadline(
        &mut self,
        deadline: Self::Deadline,
        now: i64,
        cx: &mut MachineContext<'_>,
    ) -> Self::Product;
}
