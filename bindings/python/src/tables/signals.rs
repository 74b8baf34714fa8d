//! The table of values: one row per value.

use arrow_array::{ArrayRef, RecordBatch};
use arrow_schema::{ArrowError, SchemaRef};
use cobscope_decoder::event::Event;
use cobscope_decoder::frame::Timestamp;
use cobscope_decoder::session::Bus;
use cobscope_decoder::sink::rows::{ValueCells, ValueRows, ValueSource, ValueTable};

use super::{Table, micros};
use crate::columns::{Key, Kind, Names, Numbers, Parts, Texts, schema};

const SIGNALS: &[(&str, Kind)] = &[
    ("time", Kind::Time),
    ("time_ns", Kind::Number),
    ("capture", Kind::Name),
    ("bus", Kind::Name),
    ("frame", Kind::Number),
    ("node", Kind::Number),
    ("device", Kind::Name),
    ("group", Kind::Name),
    ("signal", Kind::Name),
    ("id", Kind::Name),
    ("value", Kind::Real),
    ("text", Kind::Text),
    ("unit", Kind::Name),
    ("label", Kind::Name),
    ("raw", Kind::Number),
    ("raw_hex", Kind::Text),
];

/// Labels that are kept for the next batch.
const MOST_LABELS: usize = 1 << 16;

/// Names of a signal in their dictionaries.
#[derive(Default)]
struct SignalKeys {
    is_known: bool,
    bus: Key,
    group: Key,
    signal: Key,
    id: Key,
    unit: Option<Key>,
    /// The last label.
    label: Option<(Box<str>, Key)>,
}

/// The table of values.
pub struct Signals {
    schema: SchemaRef,
    values: ValueRows,
    columns: SignalColumns,
}

#[derive(Default)]
struct SignalColumns {
    capture: Names,
    /// Number of the only capture.
    name: Key,
    bus: Names,
    device: Names,
    group: Names,
    signal: Names,
    id: Names,
    unit: Names,
    known: Vec<SignalKeys>,
    last_device: Option<(Box<str>, Key)>,
    /// Events of the rows since the last batch.
    events: Vec<EventCells>,
    /// Number of the signal of each row.
    signals: Vec<u32>,
    value: Numbers<f64>,
    text: Texts,
    label: Names,
    raw: Numbers<i64>,
    raw_hex: Texts,
}

/// Cells that are equal in all rows of an event.
struct EventCells {
    time: Option<Timestamp>,
    frame: u64,
    bus: Key,
    group: Key,
    device: Option<Key>,
    node: Option<u8>,
    /// Number of rows.
    count: usize,
}

impl Signals {
    /// No rows yet.
    pub fn new(capture: &str) -> Self {
        let mut columns = SignalColumns::default();
        columns.name = columns.capture.key(capture);
        Self { schema: schema(SIGNALS), values: ValueRows::default(), columns }
    }
}

impl ValueTable for SignalColumns {
    #[inline]
    fn value(&mut self, source: &ValueSource<'_>, cells: &ValueCells<'_>) {
        let number = cells.signal_number as usize;
        if !self.known.get(number).is_some_and(|known| known.is_known) {
            self.learn(source, cells);
        }
        let Some(known) = self.known.get_mut(number) else { return };
        self.signals.push(cells.signal_number);
        self.value.push(cells.value);
        self.text.push(cells.text.as_deref());
        let label = cells.label.map(|label| match &known.label {
            Some((last, key)) if **last == *label => *key,
            _ => {
                let key = self.label.key(label);
                known.label = Some((label.into(), key));
                key
            }
        });
        self.label.push_key(label);
        let raw = i64::try_from(cells.raw).ok();
        self.raw.push(raw);
        if raw.is_some() {
            self.raw_hex.push(None);
        } else {
            self.raw_hex.push_bytes(format!("{:016X}", cells.raw).as_bytes());
        }
    }

    #[inline]
    fn source(&mut self, source: &ValueSource<'_>, signal_number: u32, count: usize) {
        let Some(known) = self.known.get(signal_number as usize) else { return };
        let (bus, group) = (known.bus, known.group);
        let device = source.device.map(|device| self.device_key(device));
        let (time, frame, node) = (source.time, source.frame, source.node);
        self.events.push(EventCells { time, frame, bus, group, device, node, count });
    }
}

impl SignalColumns {
    fn take(&mut self) -> Result<Vec<ArrayRef>, ArrowError> {
        let (events, signals) = (std::mem::take(&mut self.events), std::mem::take(&mut self.signals));
        let count = signals.len();
        let numbers = |cell: fn(&EventCells) -> Option<i64>| {
            Parts::of_runs(events.iter().map(|event| (cell(event), event.count)), count)
        };
        let names = |column: &mut Names, key: fn(&EventCells) -> Option<Key>| {
            let keys = column.keys_of_runs(events.iter().map(|event| (key(event), event.count)), count);
            column.array_of(keys)
        };
        let known = &self.known;
        let names_of_signals = |column: &mut Names, key: fn(&SignalKeys) -> Option<Key>| {
            let keys = signals.iter().map(|signal| known.get(*signal as usize).and_then(key));
            column.array_of(Parts::of_rows(keys))
        };
        let capture = self.capture.keys_of_runs(std::iter::once((Some(self.name), count)), count);
        let columns = vec![
            numbers(|event| event.time.map(micros)).times(),
            numbers(|event| event.time.map(|Timestamp(time)| time)).numbers(),
            self.capture.array_of(capture)?,
            names(&mut self.bus, |event| Some(event.bus))?,
            numbers(|event| Some(event.frame.cast_signed())).numbers(),
            numbers(|event| event.node.map(i64::from)).numbers(),
            names(&mut self.device, |event| event.device)?,
            names(&mut self.group, |event| Some(event.group))?,
            names_of_signals(&mut self.signal, |known| Some(known.signal))?,
            names_of_signals(&mut self.id, |known| Some(known.id))?,
            self.value.take(),
            self.text.take()?,
            names_of_signals(&mut self.unit, |known| known.unit)?,
            self.label.take()?,
            self.raw.take(),
            self.raw_hex.take()?,
        ];
        (self.events, self.signals) = (events, signals);
        self.events.clear();
        self.signals.clear();
        Ok(columns)
    }

    /// Forgets labels between batches if a capture has very many: labels of bits are composed.
    fn limit_labels(&mut self) {
        if self.label.size() > MOST_LABELS {
            self.label.forget();
            self.known.iter_mut().for_each(|known| known.label = None);
        }
    }

    /// Signals are numbered in the order of their groups, of which fields may be absent at first.
    #[cold]
    fn learn(&mut self, source: &ValueSource<'_>, cells: &ValueCells<'_>) {
        let number = cells.signal_number as usize;
        while self.known.len() <= number {
            self.known.push(SignalKeys::default());
        }
        let unit = (!cells.unit.is_empty()).then(|| self.unit.key(cells.unit));
        let keys = SignalKeys {
            bus: self.bus.key(source.bus),
            group: self.group.key(source.group),
            signal: self.signal.key(cells.signal),
            id: self.id.key(cells.id),
            unit,
            label: None,
            is_known: true,
        };
        if let Some(known) = self.known.get_mut(number) {
            *known = keys;
        }
    }

    #[inline]
    fn device_key(&mut self, device: &str) -> Key {
        match &self.last_device {
            Some((last, key)) if **last == *device => *key,
            _ => {
                let key = self.device.key(device);
                self.last_device = Some((device.into(), key));
                key
            }
        }
    }
}

impl Table for Signals {
    fn schema(&self) -> SchemaRef {
        SchemaRef::clone(&self.schema)
    }

    #[inline]
    fn event(&mut self, event: &Event, bus: &Bus) {
        let Self { values, columns, .. } = self;
        values.visit(event, bus, columns);
    }

    fn rows(&self) -> usize {
        self.columns.signals.len()
    }

    fn take(&mut self) -> Result<RecordBatch, ArrowError> {
        let columns = self.columns.take()?;
        self.columns.limit_labels();
        RecordBatch::try_new(self.schema(), columns)
    }
}
