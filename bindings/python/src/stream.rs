//! Batches of a table, decoded on another thread while they are read.

use std::sync::mpsc::{Receiver, RecvTimeoutError, SyncSender, sync_channel};
use std::sync::{Arc, Mutex, PoisonError};
use std::thread;
use std::time::Duration;

use arrow_array::{RecordBatch, RecordBatchReader};
use arrow_schema::{ArrowError, SchemaRef};
use cobscope::embedded::CaptureSource;
use cobscope_decoder::capture::BusNames;
use cobscope_decoder::event::Event;
use cobscope_decoder::frame::Frame;
use cobscope_decoder::query::Filter;
use cobscope_decoder::reading::{FrameDemand, ReadingPart};
use cobscope_decoder::session::Bus;

use crate::tables::{GrowingTable, Unfinished, complete_batch};

/// Batches that may wait for their reader.
const WAITING: usize = 2;

/// Messages of all passes over a capture, each once.
#[derive(Default)]
pub struct PassMessages(Mutex<Vec<String>>);

impl PassMessages {
    /// Adds messages.
    pub fn add_messages(&self, messages: Vec<String>) {
        let mut all = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        for message in messages {
            if !all.contains(&message) {
                all.push(message);
            }
        }
    }

    /// All messages so far.
    pub fn all_messages(&self) -> Vec<String> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner).clone()
    }
}

/// One reading of a capture.
#[derive(Clone)]
pub struct CapturePass {
    /// The capture.
    pub source: Arc<CaptureSource>,
    /// Receives messages at the end.
    pub messages: Arc<PassMessages>,
    /// Whether a truncated capture is a message in place of an error.
    pub allows_incomplete: bool,
    /// Whether findings are among the events.
    pub has_rules: bool,
    /// Condition for events.
    pub filter: Option<Arc<Filter>>,
}

/// Result of waiting for a batch.
pub enum NextBatch {
    /// A batch.
    Batch(RecordBatch),
    /// Error that ended the pass.
    Failure(String),
    /// End of the table.
    End,
    /// Nothing within the time.
    Waiting,
}

/// Batches in order. An error is the last item.
pub struct Batches {
    schema: SchemaRef,
    receiver: Receiver<Result<Unfinished, String>>,
}

impl Batches {
    /// Starts a pass on a thread of its own; it ends when the batches are dropped.
    pub fn start(pass: CapturePass, table: Box<dyn GrowingTable>) -> Self {
        let (sender, receiver) = sync_channel(WAITING);
        let schema = table.schema();
        // A pass that cannot be started drops its sender: an empty table is prevented by the error.
        let failed = sender.clone();
        let started =
            thread::Builder::new().name("cobscope".to_owned()).spawn(move || run(&pass, table, sender));
        if let Err(error) = started {
            let _ = failed.try_send(Err(format!("cannot start a thread: {error}")));
        }
        Self { schema, receiver }
    }

    /// Batches in memory.
    pub fn of(schema: SchemaRef, batches: Vec<RecordBatch>) -> Self {
        let (sender, receiver) = sync_channel(batches.len().max(1));
        for batch in batches {
            let _ = sender.try_send(Ok(complete_batch(batch)));
        }
        Self { schema, receiver }
    }

    /// Waits for the next batch.
    pub fn next_within(&self, time: Duration) -> NextBatch {
        match self.receiver.recv_timeout(time) {
            Ok(batch) => finish_batch(batch).map_or_else(NextBatch::Failure, NextBatch::Batch),
            Err(RecvTimeoutError::Disconnected) => NextBatch::End,
            Err(RecvTimeoutError::Timeout) => NextBatch::Waiting,
        }
    }
}

fn finish_batch(batch: Result<Unfinished, String>) -> Result<RecordBatch, String> {
    batch?().map_err(|error| error.to_string())
}

impl Iterator for Batches {
    type Item = Result<RecordBatch, ArrowError>;

    fn next(&mut self) -> Option<Self::Item> {
        let batch = self.receiver.recv().ok()?;
        Some(finish_batch(batch).map_err(|reason| ArrowError::ExternalError(reason.into())))
    }
}

impl RecordBatchReader for Batches {
    fn schema(&self) -> SchemaRef {
        SchemaRef::clone(&self.schema)
    }
}

fn run(pass: &CapturePass, table: Box<dyn GrowingTable>, sender: SyncSender<Result<Unfinished, String>>) {
    let filter = pass.filter.clone();
    let mut reader = TableReader { table, filter, sender, is_closed: false };
    let end = pass.source.read(pass.has_rules, &mut reader);
    reader.send();
    let failure = match end {
        Ok(end) => {
            pass.messages.add_messages(end.messages);
            end.failure
        }
        Err(error) => Some(error.text),
    };
    match failure {
        Some(failure) if pass.allows_incomplete => pass.messages.add_messages(vec![failure]),
        Some(failure) => reader.send_result(Err(failure)),
        None => {}
    }
}

/// Fills a table and sends its batches.
struct TableReader {
    table: Box<dyn GrowingTable>,
    filter: Option<Arc<Filter>>,
    sender: SyncSender<Result<Unfinished, String>>,
    /// The reader of the batches is gone.
    is_closed: bool,
}

impl TableReader {
    fn send(&mut self) {
        if self.table.row_count() > 0 {
            let batch = self.table.take_batch().map_err(|error| error.to_string());
            self.send_result(batch);
        }
    }

    fn send_result(&mut self, batch: Result<Unfinished, String>) {
        self.is_closed = self.is_closed || self.sender.send(batch).is_err();
    }
}

impl ReadingPart for TableReader {
    fn event(&mut self, event: &Event, bus: &Bus) {
        if self.filter.as_ref().is_none_or(|filter| filter.matches_event(event, bus, None)) {
            self.table.add_event(event, bus);
            if self.table.is_full() {
                self.send();
            }
        }
    }

    fn is_done(&self) -> bool {
        self.is_closed
    }

    fn demand(&self) -> FrameDemand {
        if self.table.is_of_frames() { FrameDemand::Each } else { FrameDemand::None }
    }

    fn frame(&mut self, frame: &Frame, names: &BusNames) {
        self.table.add_frame(frame, names.name_of(frame.bus));
        if self.table.is_full() {
            self.send();
        }
    }
}
