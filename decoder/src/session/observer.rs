//! Receiver of events.

use super::bus::Bus;
use crate::event::Event;

/// Receives events in their order.
pub trait Observer {
    /// `event` happened on `bus`; `bus` is in the state after the event.
    fn event(&mut self, event: &Event, bus: &Bus);
}

impl<F: FnMut(&Event, &Bus)> Observer for F {
    fn event(&mut self, event: &Event, bus: &Bus) {
        self(event, bus);
    }
}
