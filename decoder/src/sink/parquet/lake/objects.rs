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
use crate::profile::{Persistence, Value};
use crate::session::{Bus, Buses, Entry, Node, Origin, OriginKind};
use crate::sink::parquet::table::{Cell, Heading, Kind, always, maybe};
use crate::sink::parquet::time::{micros_of_date, nanos, node_number};
use crate::wire::NodeId;
use crate::wire::canopen::ObjectAddress;

/// Columns of the table of objects.
pub(super) const HEADINGS: &[Heading] = &[
    maybe("time", Kind::Time),
    maybe("time_ns", Kind::Number),
    maybe("until", Kind::Time),
    maybe("until_ns", Kind::Number),
    maybe("confirmed", Kind::Time),
    always("capture", Kind::Name),
    always("bus", Kind::Name),
    maybe("frame", Kind::Number),
    maybe("until_frame", Kind::Number),
    maybe("node", Kind::Number),
    maybe("node_name", Kind::Name),
    maybe("device", Kind::Name),
    always("object", Kind::Name),
    maybe("name", Kind::Name),
    maybe("value", Kind::Real),
    maybe("text", Kind::Name),
    maybe("unit", Kind::Name),
    always("data", Kind::Name),
    always("size", Kind::Number),
    always("origin", Kind::Name),
    always("stale", Kind::Truth),
    maybe("persists", Kind::Name),
];

/// An object value from its first message on.
struct Interval {
    /// Last confirmed value.
    entry: Entry,
    /// First message with the value.
    since: Origin,
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
    nodes: BTreeMap<(BusIndex, NodeId), BTreeMap<ObjectAddress, Interval>>,
    pending: Vec<PendingCheck>,
    capture: String,
}

impl ObjectIntervals {
    pub(super) fn new(capture: &str) -> Self {
        Self { capture: capture.to_owned(), ..Self::default() }
    }

    /// Compares the objects of earlier events, then takes note of those of this one: the event of a transfer precedes its
    /// value in the store.
    pub(super) fn event(&mut self, event: &Event, bus: &Bus, push: PushRow<'_>) -> io::Result<()> {
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
                self.check(bus, node, object, now, push)?;
                continue;
            }
            let known = self.nodes.get(&(bus.index(), check.node));
            let known = known.into_iter().flat_map(BTreeMap::keys).copied();
            let stored = node.store().sorted().into_iter().map(|(object, _)| object);
            let mut all: Vec<_> = known.chain(stored).collect();
            all.sort_unstable();
            all.dedup();
            all.into_iter().try_for_each(|object| self.check(bus, node, object, now, push))?;
        }
        Ok(())
    }

    /// Compares one object with its interval.
    fn check(
        &mut self,
        bus: &Bus,
        node: &Node,
        object: ObjectAddress,
        (time, frame): (Option<Timestamp>, u64),
        push: PushRow<'_>,
    ) -> io::Result<()> {
        // A value of a PDO is one sample of a process value.
        let entry = node.store().seen(object).filter(|entry| entry.origin.kind != OriginKind::Pdo);
        let intervals = self.nodes.entry((bus.index(), node.id())).or_default();
        if let (Some(entry), Some(interval)) = (entry, intervals.get_mut(&object))
            && entry.value == interval.entry.value
        {
            interval.entry = entry.clone();
            return Ok(());
        }
        let ended = intervals.remove(&object);
        if let Some(entry) = entry {
            intervals.insert(object, Interval::of(node, object, entry));
        }
        let Some(ended) = ended else { return Ok(()) };
        let end = entry.map_or((time, frame), |entry| (entry.origin.time, entry.origin.frame));
        self.row(bus, node, (object, &ended), Some(end), push)
    }

    /// Writes all intervals that last to the end of the capture.
    ///
    /// # Errors
    /// If a row cannot be written.
    pub(super) fn finish(&mut self, buses: Buses<'_>, push: PushRow<'_>) -> io::Result<()> {
        for bus in buses {
            // The last event of a bus has no later one.
            self.check_pending(bus, (None, 0), push)?;
            for node in bus.nodes() {
                let Some(intervals) = self.nodes.remove(&(bus.index(), node.id())) else { continue };
                for (object, interval) in &intervals {
                    self.row(bus, node, (*object, interval), None, push)?;
                }
            }
        }
        Ok(())
    }

    fn row(
        &self,
        bus: &Bus,
        node: &Node,
        (object, interval): (ObjectAddress, &Interval),
        end: Option<(Option<Timestamp>, u64)>,
        push: PushRow<'_>,
    ) -> io::Result<()> {
        let (until, until_frame) = end.unwrap_or((None, 0));
        let frame = |number: u64| if number == 0 { Cell::Null } else { Cell::Number(number.cast_signed()) };
        let mut data = Vec::new();
        crate::ascii::push_hex(&mut data, &interval.entry.value);
        let time = interval.since.time;
        push(
            time,
            &[
                micros_of_date(time),
                nanos(time),
                micros_of_date(until),
                nanos(until),
                micros_of_date(interval.entry.origin.time),
                Cell::Text(&self.capture),
                Cell::Text(bus.name()),
                frame(interval.since.frame),
                frame(until_frame),
                node_number(Some(node.id())),
                Cell::text(node.name()),
                Cell::text(node.device_id()),
                Cell::Text(&object.to_string()),
                Cell::text(interval.name.as_deref()),
                interval.value.map_or(Cell::Null, Cell::Real),
                Cell::text(interval.text.as_deref()),
                Cell::text(interval.unit.as_deref()),
                Cell::Text(&String::from_utf8_lossy(&data)),
                Cell::Number(i64::try_from(interval.entry.size).unwrap_or(i64::MAX)),
                Cell::Text(interval.since.kind.name()),
                Cell::Truth(interval.entry.stale),
                Cell::text(interval.persists.map(Persistence::name)),
            ],
        )
    }
}

impl Interval {
    #[expect(clippy::cast_precision_loss, reason = "`data` is exact")]
    fn of(node: &Node, object: ObjectAddress, entry: &Entry) -> Self {
        let meaning = node.meaning(object);
        let (mut value, mut text) = (None, None);
        if let Some(meaning) = &meaning {
            let decoded = meaning.decode(&entry.value);
            match &decoded {
                Value::Unsigned(number) => value = Some(*number as f64),
                Value::Integer(number) => value = Some(*number as f64),
                Value::Real(number) => value = Some(*number).filter(|number| number.is_finite()),
                Value::Text(_) | Value::Bytes(_) => {}
            }
            text = match &decoded {
                Value::Bytes(_) => None,
                Value::Text(text) => Some(text.clone()),
                number => Some(meaning.show(number)),
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
            persists: node.persists(object),
        }
    }
}
