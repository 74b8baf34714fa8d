//! The table of events: one row per event.

use arrow_array::RecordBatch;
use arrow_schema::{ArrowError, SchemaRef};
use cobscope_decoder::event::Event;
use cobscope_decoder::session::Bus;
use cobscope_decoder::sink::rows::EventTableRows;

use super::{BATCH_BYTES, BATCH_ROWS, GrowingTable, RowOrigin, Unfinished, complete_batch};
use crate::columns::{ArrowKind, BooleanColumn, NameColumn, NumberColumn, TextColumn, table_schema};

const EVENTS: &[(&str, ArrowKind)] = &[
    ("time", ArrowKind::Time),
    ("time_ns", ArrowKind::Number),
    ("capture", ArrowKind::Name),
    ("bus", ArrowKind::Name),
    ("first_frame", ArrowKind::Number),
    ("last_frame", ArrowKind::Number),
    ("kind", ArrowKind::Name),
    ("protocol", ArrowKind::Name),
    ("node", ArrowKind::Number),
    ("node_name", ArrowKind::Name),
    ("device", ArrowKind::Name),
    ("presumed", ArrowKind::Truth),
    ("routine", ArrowKind::Truth),
    ("text", ArrowKind::Text),
    ("json", ArrowKind::Text),
];

/// The table of events.
pub struct EventsTable {
    schema: SchemaRef,
    rows: EventTableRows,
    origin: RowOrigin,
    first_frame: NumberColumn<i64>,
    last_frame: NumberColumn<i64>,
    kind: NameColumn,
    protocol: NameColumn,
    node: NumberColumn<i64>,
    node_name: NameColumn,
    device: NameColumn,
    presumed: BooleanColumn,
    routine: BooleanColumn,
    text: TextColumn,
    json: TextColumn,
}

impl EventsTable {
    /// No rows yet.
    pub fn new(capture: &str) -> Self {
        Self {
            schema: table_schema(EVENTS),
            rows: EventTableRows::default(),
            origin: RowOrigin::new(capture),
            first_frame: NumberColumn::default(),
            last_frame: NumberColumn::default(),
            kind: NameColumn::default(),
            protocol: NameColumn::default(),
            node: NumberColumn::default(),
            node_name: NameColumn::default(),
            device: NameColumn::default(),
            presumed: BooleanColumn::default(),
            routine: BooleanColumn::default(),
            text: TextColumn::default(),
            json: TextColumn::default(),
        }
    }
}

impl GrowingTable for EventsTable {
    fn schema(&self) -> SchemaRef {
        SchemaRef::clone(&self.schema)
    }

    fn add_event(&mut self, event: &Event, bus: &Bus) {
        let row = self.rows.event_row(event, bus);
        let bus = self.origin.bus.text_key(row.bus);
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

    fn row_count(&self) -> usize {
        self.origin.rows
    }

    fn is_full(&self) -> bool {
        self.row_count() >= BATCH_ROWS || self.json.size() >= BATCH_BYTES
    }

    fn take_batch(&mut self) -> Result<Unfinished, ArrowError> {
        let mut columns = self.origin.take()?.to_vec();
        columns.extend([
            self.first_frame.take_rows(),
            self.last_frame.take_rows(),
            self.kind.take_rows()?,
            self.protocol.take_rows()?,
            self.node.take_rows(),
            self.node_name.take_rows()?,
            self.device.take_rows()?,
            self.presumed.take_rows(),
            self.routine.take_rows(),
            self.text.take_rows()?,
            self.json.take_rows()?,
        ]);
        RecordBatch::try_new(self.schema(), columns).map(complete_batch)
    }
}
