//! Buses and the zero of times, for all parts of an answer.

use crate::answers::EventObject;
use crate::answers::numbers::to_seconds;
use crate::event::Event;
use crate::finding::Occurrence;
use crate::frame::{BusIndex, Timestamp};
use crate::session::{Bus, Buses};

/// Buses of the capture after its last frame, and time of the first one.
pub(super) struct AnswerGround<'a> {
    pub(super) buses: Buses<'a>,
    pub(super) first: Option<Timestamp>,
}

impl AnswerGround<'_> {
    pub(super) fn bus(&self, index: BusIndex) -> Option<&Bus> {
        self.buses.iter().find(|bus| bus.index() == index)
    }

    pub(super) fn bus_name(&self, index: BusIndex) -> Option<String> {
        self.bus(index).map(|bus| bus.name().to_owned())
    }

    pub(super) fn seconds(&self, at: Occurrence) -> Option<f64> {
        Some(to_seconds(at.time?.since(self.first?)))
    }

    pub(super) fn events(&self, events: &[Event]) -> Vec<EventObject> {
        events.iter().filter_map(|event| EventObject::new(event, self.bus(event.bus)?)).collect()
    }
}
