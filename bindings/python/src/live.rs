//! A decoder for live frames.

use std::collections::VecDeque;
use std::ffi::OsString;
use std::sync::{Mutex, MutexGuard, PoisonError};

use arrow_array::RecordBatch;
use arrow_schema::ArrowError;
use cobscope::embedded::{CaptureSource, finding_lines};
use cobscope_decoder::Reading;
use cobscope_decoder::event::Event;
use cobscope_decoder::frame::{CanId, Frame, FrameFlags, Timestamp};
use cobscope_decoder::reading::ReadingPart;
use cobscope_decoder::session::Bus;
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;

use crate::capture::findings_of;
use crate::errors::{argument_error, to_exception};
use crate::table::Table;
use crate::tables::{EventsTable, GrowingTable, SignalsTable};

/// Name of the capture in its tables.
const LIVE: &str = "live";

/// Rows of a table that wait for their reader; the oldest batch is dropped after that.
const MOST_ROWS: usize = 1 << 20;

/// Seconds from which a time is a date.
const FIRST_DATE: f64 = 1e8;

/// Decodes frames of live buses, in the order of time.
#[pyclass(module = "cobscope", subclass, frozen)]
pub struct Decoder(Mutex<DecoderState>);

struct DecoderState {
    /// `None` after the end.
    reading: Option<Reading<LiveTables>>,
    /// Tables after the end.
    ended: Option<LiveTables>,
    frames: u64,
    warnings: Vec<String>,
}

struct LiveTables {
    events: WaitingTable,
    signals: WaitingTable,
}

/// A table whose rows wait for a reader.
struct WaitingTable {
    name: &'static str,
    table: Box<dyn GrowingTable>,
    batches: VecDeque<RecordBatch>,
    rows: usize,
    dropped: usize,
    failure: Option<ArrowError>,
}

impl WaitingTable {
    fn new(name: &'static str, table: Box<dyn GrowingTable>) -> Self {
        Self { name, table, batches: VecDeque::new(), rows: 0, dropped: 0, failure: None }
    }

    fn end_batch(&mut self) {
        if self.table.row_count() == 0 {
            return;
        }
        match self.table.take_batch().and_then(|batch| batch()) {
            Ok(batch) => {
                self.rows += batch.num_rows();
                self.batches.push_back(batch);
            }
            Err(error) => self.failure = Some(error),
        }
        while self.rows > MOST_ROWS
            && let Some(oldest) = self.batches.pop_front()
        {
            self.rows -= oldest.num_rows();
            self.dropped += oldest.num_rows();
        }
    }

    fn take(&mut self) -> PyResult<Table> {
        self.end_batch();
        if let Some(error) = self.failure.take() {
            return Err(PyValueError::new_err(error.to_string()));
        }
        self.rows = 0;
        Ok(Table::of_batches(self.name, self.table.schema(), self.batches.drain(..).collect()))
    }
}

impl ReadingPart for LiveTables {
    fn event(&mut self, event: &Event, bus: &Bus) {
        for table in [&mut self.events, &mut self.signals] {
            table.table.add_event(event, bus);
            if table.table.is_full() {
                table.end_batch();
            }
        }
    }
}

impl DecoderState {
    /// The tables, also after the end.
    fn tables(&mut self) -> PyResult<&mut LiveTables> {
        let Self { reading, ended, .. } = self;
        let tables = ended.as_mut().or_else(|| reading.as_mut().map(Reading::part_mut));
        tables.ok_or_else(|| argument_error("the decoder is finished"))
    }
}

impl Decoder {
    /// A thread that holds the lock never waits for the interpreter.
    fn state(&self) -> MutexGuard<'_, DecoderState> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// Nanoseconds of a time in seconds.
fn timestamp(seconds: f64) -> PyResult<Timestamp> {
    // A double has no finer resolution for dates than some tenths of a microsecond.
    let (units, nanoseconds) = if seconds.abs() >= FIRST_DATE { (1e6, 1_000) } else { (1e9, 1) };
    #[expect(clippy::cast_possible_truncation, reason = "saturates, and is then above the limit")]
    let count = (seconds * units).round() as i64;
    let time = count.checked_mul(nanoseconds).filter(|_| seconds.is_finite());
    time.map(Timestamp)
        .ok_or_else(|| argument_error(&format!("timestamp: found {seconds}; expected seconds")))
}

fn can_id(id: u32, is_extended: bool) -> PyResult<CanId> {
    let checked = match u16::try_from(id) {
        _ if is_extended && id <= 0x1FFF_FFFF => Some(CanId::Extended(id)),
        Ok(id) if !is_extended && id <= 0x7FF => Some(CanId::Standard(id)),
        _ => None,
    };
    checked.ok_or_else(|| {
        let bits = if is_extended { "29" } else { "11" };
        argument_error(&format!("id: found {id:#X}; expected {bits} bits"))
    })
}

#[pymethods]
impl Decoder {
    #[new]
    fn new(py: Python<'_>, words: Vec<OsString>) -> PyResult<Self> {
        let tables = LiveTables {
            events: WaitingTable::new("events", Box::new(EventsTable::new(LIVE))),
            signals: WaitingTable::new("signals", Box::new(SignalsTable::new(LIVE))),
        };
        let built =
            py.detach(|| CaptureSource::live(&words, tables)).map_err(|error| to_exception(py, &error))?;
        let state =
            DecoderState { reading: Some(built.value), ended: None, frames: 0, warnings: built.messages };
        Ok(Self(Mutex::new(state)))
    }

    /// Decodes a frame. `timestamp` is in seconds; frames of all buses must be in the order of time.
    #[pyo3(signature = (timestamp, id, data=None, *, bus="can0", extended=false, remote=false, error=false, fd=false, brs=false, esi=false, transmitted=false, length=None))]
    #[expect(clippy::too_many_arguments, clippy::fn_params_excessive_bools, reason = "attributes of a frame")]
    fn push(
        &self,
        timestamp: Option<f64>,
        id: u32,
        data: Option<&[u8]>,
        bus: &str,
        extended: bool,
        remote: bool,
        error: bool,
        fd: bool,
        brs: bool,
        esi: bool,
        transmitted: bool,
        length: Option<u8>,
    ) -> PyResult<()> {
        let data = data.unwrap_or_default();
        let most = if fd { 64 } else { 8 };
        if data.len() > most {
            return Err(argument_error(&format!("data: {} bytes; expected max {most}", data.len())));
        }
        let flags = [
            (remote, FrameFlags::REMOTE),
            (error, FrameFlags::ERROR),
            (fd, FrameFlags::FD),
            (brs, FrameFlags::BIT_RATE_SWITCH),
            (esi, FrameFlags::ERROR_STATE),
            (transmitted, FrameFlags::TRANSMITTED),
        ];
        let flags = flags.into_iter().filter(|(is_set, _)| *is_set);
        let mut frame = Frame::data_frame(can_id(id, extended || error)?, data);
        frame.flags = flags.fold(FrameFlags::default(), |all, (_, flag)| all.with(flag));
        frame.time = timestamp.map(self::timestamp).transpose()?;
        if remote {
            frame.length = length.unwrap_or(0).min(8);
        }
        let mut state = self.state();
        let DecoderState { reading, frames, .. } = &mut *state;
        let Some(reading) = reading else { return Err(argument_error("the decoder is finished")) };
        let Some(index) = reading.bus(bus) else {
            return Err(argument_error(&format!("bus: {bus}: too many buses")));
        };
        *frames += 1;
        reading.push(&Frame { bus: index, ..frame });
        Ok(())
    }

    /// Advances the time without a frame, so that deadlines expire: call it some times per second with the clock of the
    /// frames, in seconds.
    fn advance(&self, timestamp: f64) -> PyResult<()> {
        let now = self::timestamp(timestamp)?;
        if let Some(reading) = &mut self.state().reading {
            reading.advance(now);
        }
        Ok(())
    }

    /// Events since the last call, findings among them.
    fn events(&self) -> PyResult<Table> {
        self.state().tables()?.events.take()
    }

    /// Values since the last call.
    fn signals(&self) -> PyResult<Table> {
        self.state().tables()?.signals.take()
    }

    /// Ends decoding: closes open transfers, and returns the findings of all frames. Further frames are an error.
    fn finish(&self, py: Python<'_>) -> PyResult<Table> {
        let mut state = self.state();
        let Some(reading) = state.reading.take() else {
            return Err(argument_error("the decoder is finished"));
        };
        let summary = reading.finish();
        let frames = summary.frames();
        state.ended = Some(summary.part);
        let lines =
            finding_lines(LIVE, frames, summary.findings).map_err(|error| to_exception(py, &error))?;
        findings_of(&lines)
    }

    /// Number of frames so far.
    #[getter]
    fn frames(&self) -> u64 {
        self.state().frames
    }

    /// Rows that were dropped because they were not fetched: of events, and of signals.
    #[getter]
    fn dropped(&self) -> (usize, usize) {
        self.state().tables().map_or((0, 0), |tables| (tables.events.dropped, tables.signals.dropped))
    }

    /// Warnings about profiles and device files.
    #[getter]
    fn warnings(&self) -> Vec<String> {
        self.state().warnings.clone()
    }
}
