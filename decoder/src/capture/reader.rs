//! Passes a source to a parser through one reused buffer.

use std::io::{ErrorKind, Read};

use super::formats::inferred::describe_refusal;
use super::formats::stated_format;
use super::{
    Batch, BusNames, CaptureError, CaptureFormat, FORMATS, ForeignFile, FormatParser, LARGEST_RECORD,
    ReadOptions, detect_format, foreign_file,
};

/// Bytes requested per read: fits the second-level cache, so that data copied by `read` is still cached
/// when it is parsed.
const CHUNK: usize = 256 * 1024;

/// Reader of a capture: source, buffer and parser.
pub struct CaptureReader<R> {
    source: R,
    parser: Box<dyn FormatParser>,
    format: &'static CaptureFormat,
    buffer: Vec<u8>,
    start: usize,
    end: usize,
    offset: u64,
    at_end: bool,
    failure: ReadFailure,
}

/// Error that ended a capture early.
enum ReadFailure {
    None,
    /// Pending: returned by the next `read`, after the frames that precede the error.
    Waiting(CaptureError),
    Reported,
}

/// A position in a capture from which reading can resume, also in another reader.
pub struct ReaderPosition {
    /// Byte offset in the decompressed capture.
    pub offset: u64,
    format: &'static CaptureFormat,
    parser: Box<dyn FormatParser>,
}

impl ReaderPosition {
    /// Whether the capture is text: reading can start after any line end.
    pub fn is_text(&self) -> bool {
        self.format.is_text
    }
}

impl Clone for ReaderPosition {
    fn clone(&self) -> Self {
        Self { offset: self.offset, format: self.format, parser: self.parser.clone_box() }
    }
}

impl<R: Read> CaptureReader<R> {
    /// Opens a decompressed capture: reads its start and detects its format.
    ///
    /// # Errors
    /// If the source cannot be read, is empty or has no known format.
    pub fn open(source: R, options: &ReadOptions) -> Result<Self, CaptureError> {
        let mut buffer = vec![0; CHUNK + LARGEST_RECORD];
        let mut source = source;
        let mut end = 0;
        let mut at_end = false;
        // A pipe may deliver a few bytes at a time; detection of a format needs several lines.
        loop {
            let head = buffer.get(..end).unwrap_or_default();
            let format = match options.columns {
                // Pipes may deliver less than the first bytes of a binary format.
                Some(_) if at_end || end >= LARGEST_RECORD => stated_format(head),
                Some(_) => None,
                None => detect_format(head, at_end),
            };
            if let Some(format) = format {
                let parser = (format.parser)(options);
                let failure = ReadFailure::None;
                return Ok(Self {
                    source,
                    parser,
                    format,
                    buffer,
                    start: 0,
                    end,
                    offset: 0,
                    at_end,
                    failure,
                });
            }
            if at_end || end >= LARGEST_RECORD {
                return Err(unrecognised_format(buffer.get(..end).unwrap_or_default()));
            }
            match read_once(&mut source, buffer.get_mut(end..).unwrap_or_default())? {
                0 => at_end = true,
                count => end += count,
            }
        }
    }

    /// Resumes at `position`; `source` must be at its offset.
    pub fn resume(source: R, position: &ReaderPosition) -> Self {
        Self {
            source,
            parser: position.parser.clone_box(),
            format: position.format,
            buffer: vec![0; CHUNK + LARGEST_RECORD],
            start: 0,
            end: 0,
            offset: position.offset,
            at_end: false,
            failure: ReadFailure::None,
        }
    }

    /// Replaces the content of `batch` with the next frames and notices; `false` at the end.
    ///
    /// # Errors
    /// If the source or its content cannot be read further: returned once, after the frames before the error.
    /// The capture is then at its end.
    pub fn read(&mut self, batch: &mut Batch) -> Result<bool, CaptureError> {
        batch.clear();
        let error = match std::mem::replace(&mut self.failure, ReadFailure::Reported) {
            ReadFailure::Reported => return Ok(false),
            ReadFailure::Waiting(error) => error,
            ReadFailure::None => match self.read_on(batch) {
                Ok(more) => {
                    self.failure = ReadFailure::None;
                    return Ok(more);
                }
                Err(error) => error,
            },
        };
        if batch.is_empty() {
            return Err(error);
        }
        self.failure = ReadFailure::Waiting(error);
        Ok(true)
    }

    fn read_on(&mut self, batch: &mut Batch) -> Result<bool, CaptureError> {
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
                self.refill_buffer()?;
            }
        }
    }

    fn refill_buffer(&mut self) -> Result<(), CaptureError> {
        if self.start > 0 {
            self.buffer.copy_within(self.start..self.end, 0);
            self.end -= self.start;
            self.start = 0;
        }
        if self.end == self.buffer.len() {
            self.grow_buffer();
        }
        let room = self.buffer.get_mut(self.end..).unwrap_or_default();
        match read_once(&mut self.source, room)? {
            0 => self.at_end = true,
            count => self.end += count,
        }
        Ok(())
    }

    /// Enlarges a full buffer, up to the size that the parser may require. It grows only with bytes received,
    /// independent of the size that the capture declares.
    fn grow_buffer(&mut self) {
        let limit = self.parser.largest_input().saturating_add(CHUNK);
        let size = self.buffer.len().saturating_mul(2).min(limit);
        if size > self.buffer.len() {
            self.buffer.resize(size, 0);
        }
    }

    /// Buses seen so far.
    pub fn buses(&self) -> &BusNames {
        self.parser.buses()
    }

    /// Number of the last line used, from 1, in a text format: the line of the frame if batches hold one
    /// frame.
    pub fn line_number(&self) -> Option<u64> {
        self.parser.line_number()
    }

    /// Format detected at the start.
    pub fn format(&self) -> &'static CaptureFormat {
        self.format
    }

    /// Bytes of the decompressed capture read so far.
    pub fn offset(&self) -> u64 {
        self.offset
    }

    /// The current position, after the last batch.
    pub fn position(&self) -> ReaderPosition {
        ReaderPosition { offset: self.offset, format: self.format, parser: self.parser.clone_box() }
    }
}

/// Calls `read` once, again if a signal interrupts it. A full buffer returns 0, like the end of the source.
/// This does not occur earlier, because parsers use some of [`FormatParser::largest_input`] bytes.
fn read_once(source: &mut impl Read, room: &mut [u8]) -> Result<usize, CaptureError> {
    loop {
        match source.read(room) {
            Ok(count) => return Ok(count),
            Err(error) if error.kind() == ErrorKind::Interrupted => {}
            Err(error) => return Err(error.into()),
        }
    }
}

fn unrecognised_format(head: &[u8]) -> CaptureError {
    if head.is_empty() {
        return CaptureError::Empty;
    }
    if let Some(ForeignFile { name, remedy }) = foreign_file(head, None) {
        return CaptureError::Foreign { name, remedy };
    }
    let known = FORMATS.iter().map(|format| format.title).collect::<Vec<_>>().join(", ");
    let found = head.get(..24).unwrap_or(head).escape_ascii().to_string();
    // Windows PowerShell writes UTF-16 for `>`.
    let hint = match head {
        [0xFF, 0xFE, ..] | [0xFE, 0xFF, ..] => ", the mark of UTF-16; save it as UTF-8",
        _ => "",
    };
    let nearest = describe_refusal(head).map_or(String::new(), |text| format!("; {text}"));
    CaptureError::Unrecognised { known, found: format!("\"{found}\"{hint}{nearest}") }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::frame::{CanId, Frame};

    /// Parser of containers of `size` bytes: one frame per 1,000 bytes, two frames per call.
    #[derive(Clone)]
    struct Containers {
        size: usize,
        given: usize,
        buses: BusNames,
    }

    impl FormatParser for Containers {
        fn parse(&mut self, input: &[u8], at_end: bool, batch: &mut Batch) -> Result<usize, CaptureError> {
            assert!(input.len() <= self.largest_input().max(LARGEST_RECORD) + CHUNK);
            if input.len() < self.size {
                return Ok(if at_end { input.len() } else { 0 });
            }
            if self.given * 1_000 >= self.size {
                self.given = 0;
                return Ok(self.size);
            }
            for _ in 0..2 {
                let byte = input[self.given * 1_000];
                self.given += 1;
                batch.push(Frame::data_frame(CanId::from_standard(byte.into()), &[]));
            }
            Ok(0)
        }

        fn largest_input(&self) -> usize {
            self.size
        }

        fn buses(&self) -> &BusNames {
            &self.buses
        }

        fn clone_box(&self) -> Box<dyn FormatParser> {
            Box::new(self.clone())
        }
    }

    fn start(size: usize) -> ReaderPosition {
        let parser = Box::new(Containers { size, given: 0, buses: BusNames::default() });
        ReaderPosition { offset: 0, format: &FORMATS[0], parser }
    }

    fn ids(reader: &mut CaptureReader<&[u8]>) -> Vec<u32> {
        let mut batch = Batch::new();
        let mut ids = Vec::new();
        while reader.read(&mut batch).unwrap() {
            ids.extend(batch.frames().iter().map(|frame| frame.id.number()));
        }
        ids
    }

    #[test]
    fn the_mark_of_utf_16_has_a_remedy() {
        for (head, is_marked) in
            [(&b"\xff\xfe(\0"[..], true), (b"\xfe\xff\0(", true), (b"\xff\xff(\0", false)]
        {
            let message = unrecognised_format(head).to_string();
            assert_eq!(message.ends_with(", the mark of UTF-16; save it as UTF-8"), is_marked, "{message}");
        }
    }

    #[test]
    fn the_buffer_grows_to_a_container_and_no_further() {
        let bytes: Vec<u8> = (0..6_000_u32).flat_map(|n| [(n % 251) as u8; 1_000]).collect();
        let mut reader = CaptureReader::resume(&bytes[..], &start(2_000_000));
        let expected: Vec<u32> = (0..6_000).map(|n| n % 251).collect();
        assert_eq!(ids(&mut reader), expected);
        assert_eq!(reader.offset(), 6_000_000);
        assert!(reader.buffer.len() <= 2_000_000 + CHUNK, "{}", reader.buffer.len());
        let mut reader = CaptureReader::resume(&bytes[..], &start(100_000));
        assert_eq!(ids(&mut reader), expected);
        assert_eq!(reader.buffer.len(), CHUNK + LARGEST_RECORD, "a small container needs no more");
    }

    /// Returns its bytes, then fails on every call.
    struct Broken<'a>(&'a [u8]);

    impl Read for Broken<'_> {
        fn read(&mut self, room: &mut [u8]) -> std::io::Result<usize> {
            match self.0.read(room)? {
                0 => Err(std::io::Error::other("broken")),
                count => Ok(count),
            }
        }
    }

    #[test]
    fn the_error_that_ends_a_capture_is_reported_once_after_its_frames() {
        let bytes = vec![7; 4_000];
        let mut reader = CaptureReader::resume(Broken(&bytes), &start(2_000));
        let mut batch = Batch::new();
        let mut found = Vec::new();
        loop {
            match reader.read(&mut batch) {
                Ok(true) => found.extend(batch.frames().iter().map(|frame| frame.id.to_string())),
                Ok(false) => break,
                Err(error) => found.push(error.to_string()),
            }
        }
        assert_eq!(found, ["007", "007", "007", "007", "reading failed: broken"]);
        // An unknown version ends the capture; the frame before it is emitted first.
        let trace = b";$FILEVERSION=2.1\n;$COLUMNS=N,O,T,B,I,d,R,L,D\n 1 1.0 DT 1 0123 Rx - 1 00\n;$FILEVERSION=9.0\n";
        let mut reader = CaptureReader::open(&trace[..], &ReadOptions::default()).unwrap();
        assert!(reader.read(&mut batch).unwrap());
        assert_eq!(batch.frames().len(), 1);
        assert!(reader.read(&mut batch).is_err());
        assert!(!reader.read(&mut batch).unwrap());
    }

    #[test]
    fn the_beginning_of_a_line_tells_no_format() {
        /// Returns one byte per call.
        struct Slow<'a>(&'a [u8]);
        impl Read for Slow<'_> {
            fn read(&mut self, room: &mut [u8]) -> std::io::Result<usize> {
                let most = room.len().min(1);
                self.0.read(&mut room[..most])
            }
        }
        // Without its line end, the first text would be the header of a CSV capture.
        for (text, is_known) in
            [("ID,Data Bytes and more\n", false), ("ID,Data Bytes\n", true), ("ID,Data Bytes", true)]
        {
            let options = ReadOptions::default();
            assert_eq!(CaptureReader::open(text.as_bytes(), &options).is_ok(), is_known, "{text}");
            assert_eq!(
                CaptureReader::open(Slow(text.as_bytes()), &options).is_ok(),
                is_known,
                "{text} in pieces"
            );
        }
    }

    #[test]
    fn a_place_inside_a_container_is_that_of_its_beginning() {
        let bytes: Vec<u8> = (0..6_u8).flat_map(|n| [n; 1_000]).collect();
        let mut reader = CaptureReader::resume(&bytes[..], &start(6_000));
        let mut batch = Batch::new();
        assert!(reader.read(&mut batch).unwrap());
        let position = reader.position();
        assert_eq!(position.offset, 0);
        assert_eq!(ids(&mut CaptureReader::resume(&bytes[..], &position)), [2, 3, 4, 5]);
        assert_eq!(ids(&mut reader), [2, 3, 4, 5]);
    }
}
