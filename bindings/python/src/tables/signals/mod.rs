//! The table of values: one row per value.

mod batch;

use arrow_array::RecordBatch;
use arrow_schema::{ArrowError, SchemaRef};
use cobscope_decoder::event::Event;
use cobscope_decoder::session::Bus;
use cobscope_decoder::sink::rows::{ValueCells, ValueRows, ValueSource, ValueTable};

use super::{GrowingTable, Unfinished};
use crate::columns::{ArrowKind, Key, NameColumn, NumberColumn, TextColumn, table_schema};
use batch::{EventCells, PendingSignalRows, SignalBatch, SignalKeys, SpareRows};

const SIGNALS: &[(&str, ArrowKind)] = &[
    ("time", ArrowKind::Time),
    ("time_ns", ArrowKind::Number),
    ("capture", ArrowKind::Name),
    ("bus", ArrowKind::Name),
    ("frame", ArrowKind::Number),
    ("node", ArrowKind::Number),
    ("device", ArrowKind::Name),
    ("group", ArrowKind::Name),
    ("signal", ArrowKind::Name),
    ("id", ArrowKind::Name),
    ("value", ArrowKind::Real),
    ("text", ArrowKind::Text),
    ("unit", ArrowKind::Name),
    ("label", ArrowKind::Name),
    ("raw", ArrowKind::Number),
    ("raw_hex", ArrowKind::Text),
];

/// Labels that are kept for the next batch.
const MOST_LABELS: usize = 1 << 16;

/// A signal that had a value.
#[derive(Default)]
struct KnownSignal {
    is_known: bool,
    bus: Key,
    group: Key,
    keys: SignalKeys,
    /// The last label.
    label: Option<(Box<str>, Key)>,
}

/// The table of values.
pub struct SignalsTable {
    schema: SchemaRef,
    values: ValueRows,
    columns: SignalColumns,
}

#[derive(Default)]
struct SignalColumns {
    capture: NameColumn,
    /// Number of the only capture.
    name: Key,
    bus: NameColumn,
    device: NameColumn,
    group: NameColumn,
    signal: NameColumn,
    id: NameColumn,
    unit: NameColumn,
    known: Vec<KnownSignal>,
    last_device: Option<(Box<str>, Key)>,
    rows: PendingSignalRows,
    spare: SpareRows,
    value: NumberColumn<f64>,
    text: TextColumn,
    label: NameColumn,
    raw: NumberColumn<i64>,
    raw_hex: TextColumn,
}

impl SignalsTable {
    /// No rows yet.
    pub fn new(capture: &str) -> Self {
        let mut columns = SignalColumns::default();
        columns.name = columns.capture.text_key(capture);
        Self { schema: table_schema(SIGNALS), values: ValueRows::default(), columns }
    }
}

impl ValueTable for SignalColumns {
    #[inline]
    fn add_value(&mut self, source: &ValueSource<'_>, cells: &ValueCells<'_>) {
        let number = cells.signal_number as usize;
        if !self.known.get(number).is_some_and(|known| known.is_known) {
            self.learn(source, cells);
        }
        let Some(known) = self.known.get_mut(number) else { return };
        self.rows.signals.push(cells.signal_number);
        self.value.push(cells.value);
        self.text.push(cells.text.as_deref());
        let label = cells.label.map(|label| match &known.label {
            Some((last, key)) if **last == *label => *key,
            _ => {
                let key = self.label.text_key(label);
                known.label = Some((label.into(), key));
                key
            }
        });
        self.label.push_key(label);
        let raw = cells.raw.and_then(|raw| i64::try_from(raw).ok());
        self.raw.push(raw);
        match cells.raw.filter(|_| raw.is_none()) {
            Some(raw) => self.raw_hex.push_bytes(format!("{raw:016X}").as_bytes()),
            None => self.raw_hex.push(None),
        }
    }

    #[inline]
    fn add_source(&mut self, source: &ValueSource<'_>, signal_number: u32, count: usize) {
        let Some(known) = self.known.get(signal_number as usize) else { return };
        let (bus, group) = (known.bus, known.group);
        let device = source.device.map(|device| self.device_key(device));
        let (time, frame, node) = (source.time, source.frame, source.node);
        self.rows.events.push(EventCells { time, frame, bus, group, device, node, count });
    }
}

impl SignalColumns {
    /// The rows since the last batch. Cells that the rows of an event or of a signal share become columns later.
    fn take(&mut self) -> Result<SignalBatch, ArrowError> {
        let rows = std::mem::replace(&mut self.rows, self.spare.take_spare());
        let count = rows.signals.len();
        let capture = self.capture.equal_keys(Some(self.name), count);
        let bus = self.bus.keys_of_runs(rows.of_events(|event| Some(event.bus)), count);
        let device = self.device.keys_of_runs(rows.of_events(|event| event.device), count);
        Ok(SignalBatch {
            keys: self.known.iter().map(|known| known.keys).collect(),
            capture: self.capture.array_of(capture)?,
            bus: self.bus.array_of(bus)?,
            device: self.device.array_of(device)?,
            groups: self.group.all_texts(),
            signals: self.signal.all_texts(),
            ids: self.id.all_texts(),
            units: self.unit.all_texts(),
            value: self.value.take_rows(),
            text: self.text.take_rows()?,
            label: self.label.take_rows()?,
            raw: self.raw.take_rows(),
            raw_hex: self.raw_hex.take_rows()?,
            rows,
            spare: self.spare.clone(),
        })
    }

    /// Forgets labels between batches if a capture has very many: labels of bits are composed.
    fn limit_labels(&mut self) {
        if self.label.size() > MOST_LABELS {
            self.label.forget_texts();
            self.known.iter_mut().for_each(|known| known.label = None);
        }
    }

    /// Signals are numbered in the order of their groups, of which fields may be absent at first.
    #[cold]
    fn learn(&mut self, source: &ValueSource<'_>, cells: &ValueCells<'_>) {
        let number = cells.signal_number as usize;
        while self.known.len() <= number {
            self.known.push(KnownSignal::default());
        }
        let unit = (!cells.unit.is_empty()).then(|| self.unit.text_key(cells.unit));
        let keys =
            SignalKeys { signal: self.signal.text_key(cells.signal), id: self.id.text_key(cells.id), unit };
        let bus = self.bus.text_key(source.bus);
        let group = self.group.text_key(source.group);
        if let Some(known) = self.known.get_mut(number) {
            *known = KnownSignal { is_known: true, bus, group, keys, label: None };
        }
    }

    #[inline]
    fn device_key(&mut self, device: &str) -> Key {
        match &self.last_device {
            Some((last, key)) if **last == *device => *key,
            _ => {
                let key = self.device.text_key(device);
                self.last_device = Some((device.into(), key));
                key
            }
        }
    }
}

impl GrowingTable for SignalsTable {
    fn schema(&self) -> SchemaRef {
        SchemaRef::clone(&self.schema)
    }

    #[inline]
    fn add_event(&mut self, event: &Event, bus: &Bus) {
        let Self { values, columns, .. } = self;
        values.visit_values(event, bus, columns);
    }

    fn row_count(&self) -> usize {
        self.columns.rows.signals.len()
    }

    fn take_batch(&mut self) -> Result<Unfinished, ArrowError> {
        let batch = self.columns.take()?;
        self.columns.limit_labels();
        let schema = self.schema();
        Ok(Box::new(move || RecordBatch::try_new(schema, batch.into_columns()?)))
    }
}
