//! Events in a format of the library, written in steps.

use std::io::{self, Write};
use std::sync::{Arc, Mutex, PoisonError};

use cobscope_decoder::Reading;
use cobscope_decoder::capture::{Batch, BusNames, CaptureError, MergedReader};
use cobscope_decoder::event::Event;
use cobscope_decoder::frame::Frame;
use cobscope_decoder::query::Filter;
use cobscope_decoder::reading::{FrameDemand, ReadingPart};
use cobscope_decoder::rules::RuleSetup;
use cobscope_decoder::session::{Bus, SessionOptions};
use cobscope_decoder::sink::text::TextOptions;
use cobscope_decoder::sink::{EVENT_FORMATS, EventSink, Output, OutputFiles, SinkOptions, SpoolFile};

use crate::files::ContentSource;

/// Bytes after which a step ends, so that the page can fetch them.
const MOST_WAITING: usize = 8 << 20;

/// Output in memory, shared with a sink.
#[derive(Clone, Default)]
pub struct OutputBuffer(Arc<Mutex<Vec<u8>>>);

impl OutputBuffer {
    fn len(&self) -> usize {
        self.0.lock().unwrap_or_else(PoisonError::into_inner).len()
    }

    /// Removes and returns what was written.
    pub fn take(&self) -> Vec<u8> {
        std::mem::take(&mut self.0.lock().unwrap_or_else(PoisonError::into_inner))
    }
}

impl Write for OutputBuffer {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner).write(bytes)
    }

    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}

/// Files of a sink: a single one, in memory.
struct SingleFile(OutputBuffer);

impl OutputFiles for SingleFile {
    fn whole_file(&mut self) -> io::Result<Output> {
        Ok(Box::new(self.0.clone()))
    }

    fn part_file(&mut self, _content: &str) -> io::Result<Output> {
        Err(io::ErrorKind::Unsupported.into())
    }

    fn spool_file(&mut self) -> io::Result<Box<dyn SpoolFile>> {
        Err(io::ErrorKind::Unsupported.into())
    }
}

/// Events that are written while the capture is read.
pub struct ExportJob {
    reader: MergedReader<ContentSource>,
    batch: Batch,
    reading: Reading<FilteredSink>,
    buffer: OutputBuffer,
    is_ended: bool,
}

struct FilteredSink {
    sink: Box<dyn EventSink + Send>,
    filter: Option<Filter>,
    /// First and last frame whose events are written.
    frames: Option<(u64, u64)>,
}

impl ReadingPart for FilteredSink {
    fn event(&mut self, event: &Event, bus: &Bus) {
        let is_inside = |(first, last)| (first..=last).contains(&event.frames.last);
        if self.frames.is_none_or(is_inside)
            && self.filter.as_ref().is_none_or(|filter| filter.matches_event(event, bus, None))
        {
            self.sink.write_event(event, bus);
        }
    }

    fn demand(&self) -> FrameDemand {
        FrameDemand::Each
    }

    fn frame(&mut self, frame: &Frame, _names: &BusNames) {
        self.sink.observe_time(frame.time);
    }
}

impl ExportJob {
    /// Starts to write in a format of `EVENT_FORMATS`, with the findings among the events; of some frames, if
    /// they are stated.
    ///
    /// # Errors
    /// If the format is unknown, or not a single file.
    pub fn new(
        reader: MergedReader<ContentSource>,
        (session, setup): (SessionOptions, &Arc<RuleSetup>),
        format: &str,
        (filter, frames): (Option<Filter>, Option<(u64, u64)>),
    ) -> Result<Self, String> {
        let found = EVENT_FORMATS.iter().find(|known| known.name == format);
        let format = found.ok_or_else(|| format!("{format}: unknown format"))?;
        let buffer = OutputBuffer::default();
        let options = SinkOptions {
            text: TextOptions { all: filter.is_some() || frames.is_some(), ..TextOptions::default() },
            ..SinkOptions::default()
        };
        let sink = (format.sink)(&mut SingleFile(buffer.clone()), &options);
        let sink = sink.map_err(|error| format!("{}: {error}", format.name))?;
        Ok(Self {
            reader,
            batch: Batch::new(),
            reading: Reading::of_options(
                session,
                Some(Arc::clone(setup)),
                FilteredSink { sink, filter, frames },
            ),
            buffer,
            is_ended: false,
        })
    }

    /// Frames read so far.
    pub fn frames(&self) -> u64 {
        self.reading.decoder().frame_count()
    }

    /// Reads up to about `frames` more frames, until enough bytes wait; `false` at the end.
    ///
    /// # Errors
    /// If the output cannot be written.
    pub fn step(&mut self, frames: u64) -> Result<bool, String> {
        let limit = self.reading.decoder().frame_count().saturating_add(frames);
        while self.reading.decoder().frame_count() < limit && self.buffer.len() < MOST_WAITING {
            // An error that ends the capture is in the overview.
            if !matches!(self.batch(), Ok(true)) {
                self.finish()?;
                return Ok(false);
            }
        }
        Ok(true)
    }

    fn batch(&mut self) -> Result<bool, CaptureError> {
        let has_more = self.reader.read(&mut self.batch)?;
        self.reading.take(&self.batch, self.reader.buses());
        Ok(has_more)
    }

    fn finish(&mut self) -> Result<(), String> {
        if std::mem::replace(&mut self.is_ended, true) {
            return Ok(());
        }
        self.reading.close(self.reader.buses());
        self.reading.part_mut().sink.finish_output().map_err(|error| error.to_string())
    }

    /// Bytes written since the last call.
    pub fn bytes(&self) -> Vec<u8> {
        self.buffer.take()
    }
}
