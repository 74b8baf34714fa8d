//! All signals of a capture, by name.

use std::collections::{BTreeSet, HashMap};
use std::sync::Arc;

use serde::Serialize;

use super::part::ReadingPart;
use crate::event::Event;
use crate::frame::{BusIndex, CanId};
use crate::profile::{PayloadLayout, SignalField};
use crate::replay::signal::carried_layout;
use crate::session::{Bus, MessagePreview};

/// Maximum number of different signals that are listed.
pub const MOST_SIGNALS: usize = 10_000;

/// A signal of a capture.
#[derive(Debug, Clone, PartialEq, Eq, PartialOrd, Ord, Serialize)]
pub struct ListedSignal {
    /// Name of the bus.
    pub bus: String,
    /// Node-ID or J1939 address with its protocol; empty without a node.
    pub node: String,
    /// Object or message.
    pub object: String,
    /// Name of the signal; empty without one.
    pub name: String,
    /// Unit; empty without one.
    pub unit: String,
}

impl ListedSignal {
    /// The signal of a field of an event.
    pub fn of(event: &Event, bus: &Bus, field: &SignalField) -> Self {
        let unit = field.meaning.as_deref().map_or("", |meaning| meaning.unit.as_str());
        Self {
            bus: bus.name().to_owned(),
            node: event.node.map_or(String::new(), |node| node.to_string()),
            object: field.id.to_string(),
            name: field.name().unwrap_or_default().to_owned(),
            unit: unit.to_owned(),
        }
    }
}

/// Collects the signals of a capture, at most [`MOST_SIGNALS`].
#[derive(Debug, Default)]
pub struct SignalList {
    signals: BTreeSet<ListedSignal>,
    /// Last layout of each identifier.
    layouts: HashMap<(BusIndex, CanId), Arc<PayloadLayout>>,
}

impl SignalList {
    /// All signals, in order.
    pub fn into_sorted(self) -> Vec<ListedSignal> {
        self.signals.into_iter().collect()
    }

    fn add(&mut self, names: impl Iterator<Item = ListedSignal>) {
        self.signals.extend(names.take(MOST_SIGNALS.saturating_sub(self.signals.len())));
    }
}

impl ReadingPart for SignalList {
    fn event(&mut self, event: &Event, bus: &Bus) {
        let Some((id, layout, _)) = carried_layout(event) else {
            return self.add(event.decode_signals().map(|signal| ListedSignal::of(event, bus, signal.field)));
        };
        let known = self.layouts.insert((bus.index(), id), Arc::clone(layout));
        if !known.is_some_and(|known| Arc::ptr_eq(&known, layout)) {
            self.add(layout.fields.iter().map(|field| ListedSignal::of(event, bus, field)));
        }
    }

    fn finding(&mut self, _event: &Event, _bus: &Bus) {}

    /// A new layout has an event, so that no signal is missed.
    fn need(&self, _preview: &MessagePreview, _bus: &Bus) -> bool {
        false
    }
}
