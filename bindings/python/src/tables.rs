//! The tables of a capture: events, values and frames, in batches. `docs/columns.md` describes the columns.

use arrow_array::RecordBatch;
use arrow_schema::{ArrowError, SchemaRef};
use cobscope_decoder::event::Event;
use cobscope_decoder::frame::{CanId, Frame, FrameFlags, Timestamp};
use cobscope_decoder::session::Bus;
use cobscope_decoder::sink::rows::{EventRows, ValueCells, ValueRows, ValueSource, ValueTable};

use crate::columns::{Key, Kind, Names, Numbers, Texts, Truths, schema};

/// Rows after which a batch ends.
pub const BATCH_ROWS: usize = 64 * 1024;

/// Bytes of texts after which a batch ends.
const BATCH_BYTES: usize = 16 << 20;

/// A table that grows by events or frames.
pub trait Table: Send {
    /// Columns.
    fn schema(&self) -> SchemaRef;

    /// Adds the rows of an event.
    fn event(&mut self, _event: &Event, _bus: &Bus) {}

    /// Adds the row of a frame.
    fn frame(&mut self, _frame: &Frame, _bus: &str) {}

    /// Whether the table consists of frames.
    fn is_of_frames(&self) -> bool {
        false
    }

    /// Rows since the last batch.
    fn rows(&self) -> usize;

    /// Whether a batch is full.
    fn is_full(&self) -> bool {
        self.rows() >= BATCH_ROWS
    }

    /// The rows since the last batch.
    ///
    /// # Errors
    /// If the columns are inconsistent.
    fn take(&mut self) -> Result<RecordBatch, ArrowError>;
}

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

const EVENTS: &[(&str, Kind)] = &[
    ("time", Kind::Time),
    ("time_ns", Kind::Number),
    ("capture", Kind::Name),
    ("bus", Kind::Name),
    ("first_frame", Kind::Number),
    ("last_frame", Kind::Number),
    ("kind", Kind::Name),
    ("protocol", Kind::Name),
    ("node", Kind::Number),
    ("node_name", Kind::Name),
    ("device", Kind::Name),
    ("presumed", Kind::Truth),
    ("routine", Kind::Truth),
    ("text", Kind::Text),
    ("json", Kind::Text),
];

const FRAMES: &[(&str, Kind)] = &[
    ("time", Kind::Time),
    ("time_ns", Kind::Number),
    ("capture", Kind::Name),
    ("bus", Kind::Name),
    ("frame", Kind::Number),
    ("id", Kind::Number),
    ("extended", Kind::Truth),
    ("remote", Kind::Truth),
    ("error", Kind::Truth),
    ("fd", Kind::Truth),
    ("brs", Kind::Truth),
    ("esi", Kind::Truth),
    ("direction", Kind::Name),
    ("dlc", Kind::Number),
    ("length", Kind::Number),
    ("data", Kind::Bytes),
];

/// Time and capture of a row, which all tables begin with.
#[derive(Default)]
struct Origin {
    micros: Numbers<i64>,
    nanos: Numbers<i64>,
    capture: Names,
    bus: Names,
    /// Number of the only capture.
    name: Key,
    rows: usize,
}

impl Origin {
    fn new(capture: &str) -> Self {
        let mut origin = Self::default();
        origin.name = origin.capture.key(capture);
        origin
    }

    /// Adds equal rows.
    #[inline]
    fn push(&mut self, time: Option<Timestamp>, bus: Key, count: usize) {
        self.rows += count;
        self.micros.push_times(time.map(|Timestamp(time)| time.div_euclid(1_000)), count);
        self.nanos.push_times(time.map(|Timestamp(time)| time), count);
        self.capture.push_keys(Some(self.name), count);
        self.bus.push_keys(Some(bus), count);
    }
}

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
        RecordBatch::try_new(self.schema(), columns)
    }
}

/// The table of events.
pub struct Events {
    schema: SchemaRef,
    rows: EventRows,
    origin: Origin,
    first_frame: Numbers<i64>,
    last_frame: Numbers<i64>,
    kind: Names,
    protocol: Names,
    node: Numbers<i64>,
    node_name: Names,
    device: Names,
    presumed: Truths,
    routine: Truths,
    text: Texts,
    json: Texts,
}

impl Events {
    /// No rows yet.
    pub fn new(capture: &str) -> Self {
        Self {
            schema: schema(EVENTS),
            rows: EventRows::default(),
            origin: Origin::new(capture),
            first_frame: Numbers::default(),
            last_frame: Numbers::default(),
            kind: Names::default(),
            protocol: Names::default(),
            node: Numbers::default(),
            node_name: Names::default(),
            device: Names::default(),
            presumed: Truths::default(),
            routine: Truths::default(),
            text: Texts::default(),
            json: Texts::default(),
        }
    }
}

impl Table for Events {
    fn schema(&self) -> SchemaRef {
        SchemaRef::clone(&self.schema)
    }

    fn event(&mut self, event: &Event, bus: &Bus) {
        let row = self.rows.row(event, bus);
        let bus = self.origin.bus.key(row.bus);
        self.origin.push(row.time, bus, 1);
        self.first_frame.push(Some(row.first_frame.cast_signed()));
        self.last_frame.push(Some(row.last_frame.cast_signed()));
        self.kind.push(Some(row.kind));
        self.protocol.push(Some(row.protocol));
        self.node.push(row.node.map(i64::from));
        self.node_name.push(row.node_name);
        self.device.push(row.device);
        self.presumed.push(Some(row.presumed));
        self.routine.push(Some(row.routine));
        self.text.push(Some(&row.text));
        // JSON has its own escapes.
        self.json.push_bytes(row.json.as_bytes());
    }

    fn rows(&self) -> usize {
        self.origin.rows
    }

    fn is_full(&self) -> bool {
        self.rows() >= BATCH_ROWS || self.json.size() >= BATCH_BYTES
    }

    fn take(&mut self) -> Result<RecordBatch, ArrowError> {
        self.origin.rows = 0;
        let columns = vec![
            self.origin.micros.take_times(),
            self.origin.nanos.take(),
            self.origin.capture.take()?,
            self.origin.bus.take()?,
            self.first_frame.take(),
            self.last_frame.take(),
            self.kind.take()?,
            self.protocol.take()?,
            self.node.take(),
            self.node_name.take()?,
            self.device.take()?,
            self.presumed.take(),
            self.routine.take(),
            self.text.take()?,
            self.json.take()?,
        ];
        RecordBatch::try_new(self.schema(), columns)
    }
}

/// The table of frames.
pub struct Frames {
    schema: SchemaRef,
    origin: Origin,
    frame: Numbers<i64>,
    id: Numbers<i64>,
    /// Extended, remote, error, FD, BRS, ESI.
    flags: [Truths; 6],
    direction: Names,
    dlc: Numbers<i64>,
    length: Numbers<i64>,
    data: Texts,
}

impl Frames {
    /// No rows yet.
    pub fn new(capture: &str) -> Self {
        Self {
            schema: schema(FRAMES),
            origin: Origin::new(capture),
            frame: Numbers::default(),
            id: Numbers::default(),
            flags: std::array::from_fn(|_| Truths::default()),
            direction: Names::default(),
            dlc: Numbers::default(),
            length: Numbers::default(),
            data: Texts::default(),
        }
    }
}

impl Table for Frames {
    fn schema(&self) -> SchemaRef {
        SchemaRef::clone(&self.schema)
    }

    fn is_of_frames(&self) -> bool {
        true
    }

    fn frame(&mut self, frame: &Frame, bus: &str) {
        let bus = self.origin.bus.key(bus);
        self.origin.push(frame.time, bus, 1);
        self.frame.push(Some(frame.number.cast_signed()));
        self.id.push(Some(frame.id.number().into()));
        let has = |flag| frame.flags.contains(flag);
        let all = [
            matches!(frame.id, CanId::Extended(_)),
            has(FrameFlags::REMOTE),
            has(FrameFlags::ERROR),
            has(FrameFlags::FD),
            has(FrameFlags::BIT_RATE_SWITCH),
            has(FrameFlags::ERROR_STATE),
        ];
        for (column, flag) in self.flags.iter_mut().zip(all) {
            column.push(Some(flag));
        }
        self.direction.push(match frame.flags {
            flags if flags.contains(FrameFlags::TRANSMITTED) => Some("tx"),
            flags if flags.contains(FrameFlags::RECEIVED) => Some("rx"),
            _ => None,
        });
        self.dlc.push(Some(frame.dlc().into()));
        self.length.push(Some(frame.length.into()));
        self.data.push_bytes(frame.data());
    }

    fn rows(&self) -> usize {
        self.origin.rows
    }

    fn take(&mut self) -> Result<RecordBatch, ArrowError> {
        self.origin.rows = 0;
        let mut columns = vec![
            self.origin.micros.take_times(),
            self.origin.nanos.take(),
            self.origin.capture.take()?,
            self.origin.bus.take()?,
            self.frame.take(),
            self.id.take(),
        ];
        columns.extend(self.flags.iter_mut().map(Truths::take));
        columns.extend([
            self.direction.take()?,
            self.dlc.take(),
            self.length.take(),
            self.data.take_bytes()?,
        ]);
        RecordBatch::try_new(self.schema(), columns)
    }
}
