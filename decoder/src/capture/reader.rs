//! Feeds a parser from a source through one reused buffer.

use std::io::{ErrorKind, Read};

use super::{Batch, BusNames, CaptureError, FORMATS, Format, LARGEST_RECORD, Parser, ReadOptions, detect};

/// Bytes asked for at a time: fits the second-level cache, so that what `read` copied is still there
/// when it is parsed.
const CHUNK: usize = 256 * 1024;

/// A capture being read.
pub struct Reader<R> {
    source: R,
    parser: Box<dyn Parser>,
    format: &'static Format,
    buffer: Vec<u8>,
    start: usize,
    end: usize,
    offset: u64,
    at_end: bool,
}

/// A place in a capture from which reading can go on later, or elsewhere.
pub struct Position {
    /// Bytes of the decompressed capture before it.
    pub offset: u64,
    format: &'static Format,
    parser: Box<dyn Parser>,
}

impl Position {
    /// Whether the capture is text: it can be entered behind the end of any line.
    pub fn is_text(&self) -> bool {
        self.format.is_text
    }
}

impl Clone for Position {
    fn clone(&self) -> Self {
        Self { offset: self.offset, format: self.format, parser: self.parser.clone_box() }
    }
}

impl<R: Read> Reader<R> {
    /// Opens a decompressed capture: reads its beginning and finds its format.
    ///
    /// # Errors
    /// When the source fails, is empty or in no known format.
    pub fn open(source: R, options: &ReadOptions) -> Result<Self, CaptureError> {
        let mut buffer = vec![0; CHUNK + LARGEST_RECORD];
        let mut source = source;
        let mut end = 0;
        let mut at_end = false;
        // A pipe may deliver a few bytes at a time; a format needs some lines to be recognised.
        loop {
            if let Some(format) = detect(buffer.get(..end).unwrap_or_default()) {
                let parser = (format.parser)(options);
                return Ok(Self { source, parser, format, buffer, start: 0, end, offset: 0, at_end });
            }
            if at_end || end >= LARGEST_RECORD {
                return Err(unrecognised(buffer.get(..end).unwrap_or_default()));
            }
            match fill(&mut source, buffer.get_mut(end..).unwrap_or_default())? {
                0 => at_end = true,
                count => end += count,
            }
        }
    }

    /// Goes on at `position`; `source` must stand at its offset.
    pub fn resume(source: R, position: &Position) -> Self {
        Self {
            source,
            parser: position.parser.clone_box(),
            format: position.format,
            buffer: vec![0; CHUNK + LARGEST_RECORD],
            start: 0,
            end: 0,
            offset: position.offset,
            at_end: false,
        }
    }

    /// Replaces the content of `batch` by the next frames and notices; `false` at the end.
    ///
    /// # Errors
    /// When the source fails, or the format allows no going on. What was read before stays valid.
    pub fn read(&mut self, batch: &mut Batch) -> Result<bool, CaptureError> {
        batch.clear();
        loop {
            let input = self.buffer.get(self.start..self.end).unwrap_or_default();
            let available = input.len();
            let taken = self.parser.parse(input, self.at_end, batch)?.min(available);
            self.start += taken;
            self.offset += taken as u64;
            if !batch.is_empty() {
                return Ok(true);
            }
            if self.at_end && taken == 0 {
                return Ok(false);
            }
            if taken == 0 {
                self.refill()?;
            }
        }
    }

    fn refill(&mut self) -> Result<(), CaptureError> {
        if self.start > 0 {
            self.buffer.copy_within(self.start..self.end, 0);
            self.end -= self.start;
            self.start = 0;
        }
        let room = self.buffer.get_mut(self.end..).unwrap_or_default();
        match fill(&mut self.source, room)? {
            0 => self.at_end = true,
            count => self.end += count,
        }
        Ok(())
    }

    /// Buses seen so far.
    pub fn buses(&self) -> &BusNames {
        self.parser.buses()
    }

    /// Line that was taken last, from 1, in a text format: that of a frame where batches hold only one.
    pub fn line(&self) -> Option<u64> {
        self.parser.line()
    }

    /// Format found at the start.
    pub fn format(&self) -> &'static Format {
        self.format
    }

    /// Bytes of the decompressed capture read so far.
    pub fn offset(&self) -> u64 {
        self.offset
    }

    /// The present place, behind the last batch.
    pub fn position(&self) -> Position {
        Position { offset: self.offset, format: self.format, parser: self.parser.clone_box() }
    }
}

/// One `read`, repeated when a signal interrupts it. A full buffer reads as the end: parsers take
/// something of [`LARGEST_RECORD`] bytes, so it does not happen before the end.
fn fill(source: &mut impl Read, room: &mut [u8]) -> Result<usize, CaptureError> {
    loop {
        match source.read(room) {
            Ok(count) => return Ok(count),
            Err(error) if error.kind() == ErrorKind::Interrupted => {}
            Err(error) => return Err(error.into()),
        }
    }
}

fn unrecognised(head: &[u8]) -> CaptureError {
    if head.is_empty() {
        return CaptureError::Empty;
    }
    let known = FORMATS.iter().map(|format| format.title).collect::<Vec<_>>().join(", ");
    let found = head.get(..24).unwrap_or(head).escape_ascii().to_string();
    CaptureError::Unrecognised { known, found: format!("\"{found}\"") }
}
