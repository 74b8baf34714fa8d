//! Configuration over time: intervals in which an object of a node had one value.
//!
//! ```text
//! SDO transfer, boot-up ─▶ pending ─ next event of the bus ─▶ compare with the store ─▶ closed intervals
//! ```

use std::collections::BTreeMap;
use std::io;

use super::partitions::PushRow;
use crate::event::{Event, EventKind};
use crate::frame::{BusIndex, Timestamp};
use crate::profile::{DecodedValue, Persistence};
use crate::session::{Bus, Buses, Node, OriginKind, StoredObject, StoredOrigin};
use crate::sink::parquet::table::{ColumnHeading, ColumnType, RowCell, optional_column, required_column};
use crate::sink::parquet::time::{micros_of_date, nanos_cell, node_number};
use crate::wire::NodeId;
use crate::wire::canopen::ObjectAddress;

/// Columns of the table of objects.
pub(super) const HEADINGS: &[ColumnHeading] = &[
    optional_column("time", ColumnType::Time),
    optional_column("time_ns", ColumnType::Number),
    optional_column("until", ColumnType::Time),
    optional_column("until_ns", ColumnType::Number),
    optional_column("confirmed", ColumnType::Time),
    required_column("capture", ColumnType::Name),
    required_column("bus", ColumnType::Name),
    optional_column("frame", ColumnType::Number),
    optional_column("until_frame", ColumnType::Number),
    optional_column("node", ColumnType::Number),
    optional_column("node_name", ColumnType::Name),
    optional_column("device", ColumnType::Name),
    required_column("object", ColumnType::Name),
    optional_column("name", ColumnType::Name),
    optional_column("value", ColumnType::Real),
    optional_column("text", ColumnType::Name),
    optional_column("unit", ColumnType::Name),
    required_column("data", ColumnType::Name),
    required_column("size", ColumnType::Number),
    required_column("origin", ColumnType::Name),
    required_column("stale", ColumnType::Truth),
    optional_column("persists", ColumnType::Name),
];

/// An object value from its first message on.
struct ValueInterval {
    /// Last confirmed value.
    entry: StoredObject,
    /// First message with the value.
    since: StoredOrigin,
    name: Option<String>,
    value: Option<f64>,
    text: Option<String>,
    unit: Option<String>,
    persists: Option<Persistence>,
}

/// Objects of a node that may have changed; `None` for all objects.
struct PendingCheck {
    bus: BusIndex,
    node: NodeId,
    object: Option<ObjectAddress>,
}

/// Intervals of all nodes.
#[derive(Default)]
pub(super) struct ObjectIntervals {
    nodes: BTreeMap<(BusIndex, NodeId), BTreeMap<ObjectAddress, ValueInterval>>,
    pending: Vec<PendingCheck>,
    capture: String,
}

impl ObjectIntervals {
    pub(super) fn new(capture: &str) -> Self {
        Self { capture: capture.to_owned(), ..Self::default() }
    }

    /// Compares the objects of earlier events, then takes note of those of this one: the event of a transfer precedes its
    /// value in the store.
    pub(super) fn take_event(&mut self, event: &Event, bus: &Bus, push: PushRow<'_>) -> io::Result<()> {
        if !self.pending.is_empty() {
            self.check_pending(bus, (event.time, event.frames.last), push)?;
        }
        let Some(node) = event.node else { return Ok(()) };
        let object = match &event.kind {
            EventKind::SdoTransfer(transfer) => match transfer.object {
                Some(object) => Some(object),
                None => return Ok(()),
            },
            EventKind::ObjectChange(change) => Some(change.object),
            EventKind::BootUp { .. } | EventKind::NodeIdentified(_) | EventKind::NodeIdChange { .. } => None,
            // Values of the bus file are present from the first event of a node on.
            _ if !self.nodes.contains_key(&(event.bus, node)) => None,
            _ => return Ok(()),
        };
        self.nodes.entry((event.bus, node)).or_default();
        self.pending.push(PendingCheck { bus: event.bus, node, object });
        Ok(())
    }

    fn check_pending(
        &mut self,
        bus: &Bus,
        now: (Option<Timestamp>, u64),
        push: PushRow<'_>,
    ) -> io::Result<()> {
        let (own, others) =
            std::mem::take(&mut self.pending).into_iter().partition(|check| check.bus == bus.index());
        self.pending = others;
        let own: Vec<PendingCheck> = own;
        for check in own {
            let Some(node) = bus.node(check.node) else { continue };
            if let Some(object) = check.object {
                self.check_object(bus, node, object, now, push)?;
                continue;
            }
            let known = self.nodes.get(&(bus.index(), check.node));
            let known = known.into_iter().flat_map(BTreeMap::keys).copied();
            let stored = node.store().sorted().into_iter().map(|(object, _)| object);
            let mut all: Vec<_> = known.chain(stored).collect();
            all.sort_unstable();
            all.dedup();
            all.into_iter().try_for_each(|object| self.check_object(bus, node, object, now, push))?;
        }
        Ok(())
    }

    /// Compares one object with its interval.
    fn check_object(
        &mut self,
        bus: &Bus,
        node: &Node,
        object: ObjectAddress,
        (time, frame): (Option<Timestamp>, u64),
        push: PushRow<'_>,
    ) -> io::Result<()> {
        // A value of a PDO is one sample of a process value.
        let entry = node.store().seen_value(object).filter(|entry| entry.origin.kind != OriginKind::Pdo);
        let intervals = self.nodes.entry((bus.index(), node.id())).or_default();
        if let (Some(entry), Some(interval)) = (entry, intervals.get_mut(&object))
            && entry.value == interval.entry.value
        {
            interval.entry = entry.clone();
            return Ok(());
        }
        let ended = intervals.remove(&object);
        if let Some(entry) = entry {
            intervals.insert(object, ValueInterval::interval_of(node, object, entry));
        }
        let Some(ended) = ended else { return Ok(()) };
        let end = entry.map_or((time, frame), |entry| (entry.origin.time, entry.origin.frame));
        self.push_row(bus, node, (object, &ended), Some(end), push)
    }

    /// Writes all intervals that last to the end of the capture.
    ///
    /// # Errors
    /// If a row cannot be written.
    pub(super) fn finish_intervals(&mut self, buses: Buses<'_>, push: PushRow<'_>) -> io::Result<()> {
        for bus in buses {
            // The last event of a bus has no later one.
            self.check_pending(bus, (None, 0), push)?;
            for node in bus.nodes() {
                let Some(intervals) = self.nodes.remove(&(bus.index(), node.id())) else { continue };
                for (object, interval) in &intervals {
                    self.push_row(bus, node, (*object, interval), None, push)?;
                }
            }
        }
        Ok(())
    }

    fn push_row(
        &self,
        bus: &Bus,
        node: &Node,
        (object, interval): (ObjectAddress, &ValueInterval),
        end: Option<(Option<Timestamp>, u64)>,
        push: PushRow<'_>,
    ) -> io::Result<()> {
        let (until, until_frame) = end.unwrap_or((None, 0));
        let frame =
            |number: u64| if number == 0 { RowCell::Null } else { RowCell::Number(number.cast_signed()) };
        let mut data = Vec::new();
        crate::ascii::push_hex(&mut data, &interval.entry.value);
        let time = interval.since.time;
        push(
            time,
            &[
                micros_of_date(time),
                nanos_cell(time),
                micros_of_date(until),
                nanos_cell(until),
                micros_of_date(interval.entry.origin.time),
                RowCell::Text(&self.capture),
                RowCell::Text(bus.name()),
                frame(interval.since.frame),
                frame(until_frame),
                node_number(Some(node.id())),
                RowCell::text_or_null(node.name()),
                RowCell::text_or_null(node.device_id()),
                RowCell::Text(&object.to_string()),
                RowCell::text_or_null(interval.name.as_deref()),
                interval.value.map_or(RowCell::Null, RowCell::Real),
                RowCell::text_or_null(interval.text.as_deref()),
                RowCell::text_or_null(interval.unit.as_deref()),
                RowCell::Text(&String::from_utf8_lossy(&data)),
                RowCell::Number(i64::try_from(interval.entry.size).unwrap_or(i64::MAX)),
                RowCell::Text(interval.since.kind.name()),
                RowCell::Truth(interval.entry.stale),
                RowCell::text_or_null(interval.persists.map(Persistence::name)),
            ],
        )
    }
}

impl ValueInterval {
    #[expect(clippy::cast_precision_loss, reason = "`data` is exact")]
    fn interval_of(node: &Node, object: ObjectAddress, entry: &StoredObject) -> Self {
        let meaning = node.meaning(object);
        let (mut value, mut text) = (None, None);
        if let Some(meaning) = &meaning {
            let decoded = meaning.decode(&entry.value);
            match &decoded {
                DecodedValue::Unsigned(number) => value = Some(*number as f64),
                DecodedValue::Integer(number) => value = Some(*number as f64),
                DecodedValue::Real(number) => value = Some(*number).filter(|number| number.is_finite()),
                DecodedValue::Text(_) | DecodedValue::Bytes(_) => {}
            }
            text = match &decoded {
                DecodedValue::Bytes(_) => None,
                DecodedValue::Text(text) => Some(text.clone()),
                number => Some(meaning.format_value(number)),
            };
        }
        let unit = meaning.as_ref().map(|meaning| meaning.unit.clone()).filter(|unit| !unit.is_empty());
        Self {
            entry: entry.clone(),
            since: entry.origin,
            name: meaning.map(|meaning| meaning.name.clone()),
            value,
            text,
            unit,
            persists: node.persistence_text(object),
        }
    }
}
