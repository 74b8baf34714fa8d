//! The table of frames: one row per frame.

use arrow_array::RecordBatch;
use arrow_schema::{ArrowError, SchemaRef};
use cobscope_decoder::frame::{CanId, Frame, FrameFlags};

use super::{Origin, Table, Unfinished, whole};
use crate::columns::{Kind, Names, Numbers, Texts, Truths, schema};

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

    fn rows(&self) -> usize {
        self.origin.rows
    }

    fn take(&mut self) -> Result<Unfinished, ArrowError> {
        let mut columns = self.origin.take()?.to_vec();
        columns.extend([self.frame.take(), self.id.take()]);
        columns.extend(self.flags.iter_mut().map(Truths::take));
        columns.extend([
            self.direction.take()?,
            self.dlc.take(),
            self.length.take(),
            self.data.take_bytes()?,
        ]);
        RecordBatch::try_new(self.schema(), columns).map(whole)
    }
}
