//! The table of frames: one row per frame.

use arrow_array::RecordBatch;
use arrow_schema::{ArrowError, SchemaRef};
use cobscope_decoder::frame::{CanId, Frame, FrameFlags};

use super::{GrowingTable, RowOrigin, Unfinished, complete_batch};
use crate::columns::{ArrowKind, BooleanColumn, NameColumn, NumberColumn, TextColumn, table_schema};

const FRAMES: &[(&str, ArrowKind)] = &[
    ("time", ArrowKind::Time),
    ("time_ns", ArrowKind::Number),
    ("capture", ArrowKind::Name),
    ("bus", ArrowKind::Name),
    ("frame", ArrowKind::Number),
    ("id", ArrowKind::Number),
    ("extended", ArrowKind::Truth),
    ("remote", ArrowKind::Truth),
    ("error", ArrowKind::Truth),
    ("fd", ArrowKind::Truth),
    ("brs", ArrowKind::Truth),
    ("esi", ArrowKind::Truth),
    ("direction", ArrowKind::Name),
    ("dlc", ArrowKind::Number),
    ("length", ArrowKind::Number),
    ("data", ArrowKind::Bytes),
];

/// The table of frames.
pub struct FramesTable {
    schema: SchemaRef,
    origin: RowOrigin,
    frame: NumberColumn<i64>,
    id: NumberColumn<i64>,
    /// Extended, remote, error, FD, BRS, ESI.
    flags: [BooleanColumn; 6],
    direction: NameColumn,
    dlc: NumberColumn<i64>,
    length: NumberColumn<i64>,
    data: TextColumn,
}

impl FramesTable {
    /// No rows yet.
    pub fn new(capture: &str) -> Self {
        Self {
            schema: table_schema(FRAMES),
            origin: RowOrigin::new(capture),
            frame: NumberColumn::default(),
            id: NumberColumn::default(),
            flags: std::array::from_fn(|_| BooleanColumn::default()),
            direction: NameColumn::default(),
            dlc: NumberColumn::default(),
            length: NumberColumn::default(),
            data: TextColumn::default(),
        }
    }
}

impl GrowingTable for FramesTable {
    fn schema(&self) -> SchemaRef {
        SchemaRef::clone(&self.schema)
    }

    fn is_of_frames(&self) -> bool {
        true
    }

    fn add_frame(&mut self, frame: &Frame, bus: &str) {
        let bus = self.origin.bus.text_key(bus);
        self.origin.push(frame.time, bus);
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

    fn row_count(&self) -> usize {
        self.origin.rows
    }

    fn take_batch(&mut self) -> Result<Unfinished, ArrowError> {
        let mut columns = self.origin.take()?.to_vec();
        columns.extend([self.frame.take_rows(), self.id.take_rows()]);
        columns.extend(self.flags.iter_mut().map(BooleanColumn::take_rows));
        columns.extend([
            self.direction.take_rows()?,
            self.dlc.take_rows(),
            self.length.take_rows(),
            self.data.take_bytes()?,
        ]);
        RecordBatch::try_new(self.schema(), columns).map(complete_batch)
    }
}
