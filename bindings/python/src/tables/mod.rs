//! The tables of a capture: events, values and frames, in batches. `docs/columns.md` and `docs/python.md` describe the columns.

mod events;
mod frames;
mod signals;

use arrow_array::{ArrayRef, RecordBatch};
use arrow_schema::{ArrowError, SchemaRef};
use cobscope_decoder::event::Event;
use cobscope_decoder::frame::{Frame, Timestamp};
use cobscope_decoder::session::Bus;

use crate::columns::{Key, NameColumn, NumberColumn};
pub use events::EventsTable;
pub use frames::FramesTable;
pub use signals::SignalsTable;

/// Rows after which a batch ends.
pub const BATCH_ROWS: usize = 64 * 1024;

/// Bytes of texts after which a batch ends.
const BATCH_BYTES: usize = 16 << 20;

/// A batch whose reader completes it, while the next one is decoded.
pub type Unfinished = Box<dyn FnOnce() -> Result<RecordBatch, ArrowError> + Send>;

/// A batch that is complete.
pub fn complete_batch(batch: RecordBatch) -> Unfinished {
    Box::new(|| Ok(batch))
}

/// A table that grows by events or frames.
pub trait GrowingTable: Send {
    /// Columns.
    fn schema(&self) -> SchemaRef;

    /// Adds the rows of an event.
    fn add_event(&mut self, _event: &Event, _bus: &Bus) {}

    /// Adds the row of a frame.
    fn add_frame(&mut self, _frame: &Frame, _bus: &str) {}

    /// Whether the table consists of frames.
    fn is_of_frames(&self) -> bool {
        false
    }

    /// Rows since the last batch.
    fn row_count(&self) -> usize;

    /// Whether a batch is full.
    fn is_full(&self) -> bool {
        self.row_count() >= BATCH_ROWS
    }

    /// The rows since the last batch.
    ///
    /// # Errors
    /// If the columns are inconsistent.
    fn take_batch(&mut self) -> Result<Unfinished, ArrowError>;
}

/// Time and capture of a row, which all tables begin with.
#[derive(Default)]
struct RowOrigin {
    micros: NumberColumn<i64>,
    nanos: NumberColumn<i64>,
    capture: NameColumn,
    bus: NameColumn,
    /// Number of the only capture.
    name: Key,
    rows: usize,
}

impl RowOrigin {
    fn new(capture: &str) -> Self {
        let mut origin = Self::default();
        origin.name = origin.capture.text_key(capture);
        origin
    }

    /// Adds a row.
    #[inline]
    fn push(&mut self, time: Option<Timestamp>, bus: Key) {
        self.rows += 1;
        self.micros.push(time.map(to_micros));
        self.nanos.push(time.map(|Timestamp(time)| time));
        self.bus.push_key(Some(bus));
    }

    /// The columns of the rows so far: time, time in ns, capture, bus.
    fn take(&mut self) -> Result<[ArrayRef; 4], ArrowError> {
        let name = self.capture.equal_keys(Some(self.name), std::mem::take(&mut self.rows));
        Ok([
            self.micros.take_times(),
            self.nanos.take_rows(),
            self.capture.array_of(name)?,
            self.bus.take_rows()?,
        ])
    }
}

/// Time in µs, rounded down.
fn to_micros(Timestamp(time): Timestamp) -> i64 {
    time.div_euclid(1_000)
}
