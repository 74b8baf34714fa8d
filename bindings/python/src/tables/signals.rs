//! The table of values: one row per value.

use arrow_array::RecordBatch;
use arrow_schema::{ArrowError, SchemaRef};
use cobscope_decoder::event::Event;
use cobscope_decoder::session::Bus;
use cobscope_decoder::sink::rows::{ValueCells, ValueRows, ValueSource, ValueTable};

use super::{Origin, Table};
use crate::columns::{Key, Kind, Names, Numbers, Texts, schema};

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
    origin: Origin,
    known: Vec<SignalKeys>,
    last_device: Option<(Box<str>, Key)>,
    frame: Numbers<i64>,
    node: Numbers<i64>,
    device: Names,
    group: Names,
    signal: Names,
    id: Names,
    value: Numbers<f64>,
    text: Texts,
    unit: Names,
    label: Names,
    raw: Numbers<i64>,
    raw_hex: Texts,
}

impl Signals {
    /// No rows yet.
    pub fn new(capture: &str) -> Self {
        let columns = SignalColumns { origin: Origin::new(capture), ..SignalColumns::default() };
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
        self.signal.push_keys(Some(known.signal), 1);
        self.id.push_keys(Some(known.id), 1);
        self.value.push(cells.value);
        self.text.push(cells.text.as_deref());
        self.unit.push_keys(known.unit, 1);
        let label = cells.label.map(|label| match &known.label {
            Some((last, key)) if **last == *label => *key,
            _ => {
                let key = self.label.key(label);
                known.label = Some((label.into(), key));
                key
            }
        });
        self.label.push_keys(label, 1);
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
        self.origin.push(source.time, bus, count);
        self.frame.push_times(Some(source.frame.cast_signed()), count);
        self.node.push_times(source.node.map(i64::from), count);
        self.device.push_keys(device, count);
        self.group.push_keys(Some(group), count);
    }
}

impl SignalColumns {
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
            bus: self.origin.bus.key(source.bus),
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
        self.columns.origin.rows
    }

    fn take(&mut self) -> Result<RecordBatch, ArrowError> {
        let it = &mut self.columns;
        it.origin.rows = 0;
        let columns = vec![
            it.origin.micros.take_times(),
            it.origin.nanos.take(),
            it.origin.capture.take()?,
            it.origin.bus.take()?,
            it.frame.take(),
            it.node.take(),
            it.device.take()?,
            it.group.take()?,
            it.signal.take()?,
            it.id.take()?,
            it.value.take(),
            it.text.take()?,
            it.unit.take()?,
            it.label.take()?,
            it.raw.take(),
            it.raw_hex.take()?,
        ];
        it.limit_labels();
        RecordBatch::try_new(self.schema(), columns)
    }
}
