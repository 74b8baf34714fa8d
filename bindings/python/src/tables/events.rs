//! The table of events: one row per event.

use arrow_array::RecordBatch;
use arrow_schema::{ArrowError, SchemaRef};
use cobscope_decoder::event::Event;
use cobscope_decoder::session::Bus;
use cobscope_decoder::sink::rows::EventRows;

use super::{BATCH_BYTES, BATCH_ROWS, Origin, Table, Unfinished, whole};
use crate::columns::{Kind, Names, Numbers, Texts, Truths, schema};

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
        self.origin.push(row.time, bus);
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

    fn take(&mut self) -> Result<Unfinished, ArrowError> {
        let mut columns = self.origin.take()?.to_vec();
        columns.extend([
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
        ]);
        RecordBatch::try_new(self.schema(), columns).map(whole)
    }
}
