//! Writer of candump's log form: `(1700000000.000000) can0 123#1122`.

use std::io::{self, Write};

use super::line::is_other_column;
use crate::ascii::{push_code, push_digits, push_nine};
use crate::capture::Notice;
use crate::capture::text::print::{CachedText, push_data};
use crate::capture::writer::FrameWriter;
use crate::frame::{CanId, Frame, FrameFlags, Timestamp};

/// Error frame flag of an identifier (SocketCAN's CAN_ERR_FLAG).
const ERROR_FLAG: u32 = 0x2000_0000;

const SECOND: i64 = 1_000_000_000;

/// Writer of candump text. Frames without time have lines without a timestamp, like the screen output of
/// `candump`. Times before 1970 are written as 0 because timestamps have no sign.
pub(super) struct CandumpWriter<W> {
    output: W,
    line: Vec<u8>,
    /// Start of a timestamp: `(1700000000.`
    seconds: CachedText<i64>,
    /// Name of a bus as written in a line, and the space after it.
    bus: CachedText<String>,
}

impl<W: Write> CandumpWriter<W> {
    pub(super) fn new(output: W) -> Self {
        let (seconds, bus) = (CachedText::default(), CachedText::default());
        Self { output, line: Vec::with_capacity(256), seconds, bus }
    }

    fn append_timestamp(&mut self, time: Timestamp) {
        let time = time.0.max(0);
        let (second, fraction) = (time / SECOND, (time % SECOND).unsigned_abs());
        let begin = self.seconds.cached_text(&second, |text, second| {
            text.extend_from_slice(format!("({second}.").as_bytes());
        });
        self.line.extend_from_slice(begin);
        if fraction.is_multiple_of(1_000) {
            push_digits(&mut self.line, fraction / 1_000, 6);
        } else {
            push_nine(&mut self.line, fraction);
        }
        self.line.extend_from_slice(b") ");
    }

    fn append_identifier(&mut self, frame: &Frame) {
        let is_error = frame.flags.contains(FrameFlags::ERROR);
        let flag = if is_error { ERROR_FLAG } else { 0 };
        let is_long = is_error || matches!(frame.id, CanId::Extended(_));
        push_code(&mut self.line, frame.id.number() | flag, if is_long { 8 } else { 3 });
    }

    fn append_payload(&mut self, frame: &Frame) {
        let (line, flags) = (&mut self.line, frame.flags);
        let is_fd = flags.contains(FrameFlags::FD);
        if is_fd {
            let switched = u8::from(flags.contains(FrameFlags::BIT_RATE_SWITCH));
            let passive = u8::from(flags.contains(FrameFlags::ERROR_STATE)) << 1;
            line.extend_from_slice(&[b'#', b'#', b'0' + (switched | passive)]);
        } else if flags.contains(FrameFlags::REMOTE) {
            line.extend_from_slice(&[b'#', b'R', b'0' + frame.length.min(8)]);
        } else {
            line.push(b'#');
        }
        push_data(line, frame);
        if frame.raw_dlc > 8 && !is_fd {
            line.extend_from_slice(format!("_{:X}", frame.raw_dlc).as_bytes());
        }
    }
}

/// Appends a name as one word that cannot be mistaken for a timestamp, a direction, or the mark of a line without
/// a frame.
fn push_name(line: &mut Vec<u8>, name: &str) {
    if name.starts_with(['(', '#', '*', ';']) || name.is_empty() || is_other_column(name.as_bytes()) {
        line.push(b'_');
    }
    line.extend(name.bytes().map(|byte| if byte.is_ascii_graphic() { byte } else { b'_' }));
    line.push(b' ');
}

impl<W: Write + Send> FrameWriter for CandumpWriter<W> {
    fn write(&mut self, frame: &Frame, bus: &str) -> io::Result<()> {
        self.line.clear();
        if let Some(time) = frame.time {
            self.append_timestamp(time);
        }
        let name = self.bus.cached_text(bus, push_name);
        self.line.extend_from_slice(name);
        self.append_identifier(frame);
        self.append_payload(frame);
        let end: &[u8] = match frame.flags {
            flags if flags.contains(FrameFlags::TRANSMITTED) => b" T\n",
            flags if flags.contains(FrameFlags::RECEIVED) => b" R\n",
            _ => b"\n",
        };
        self.line.extend_from_slice(end);
        self.output.write_all(&self.line)
    }

    /// Stores nothing: the log form has frames only, and other readers stop at a `DROPCOUNT` line of the
    /// screen form.
    fn notice(&mut self, _notice: &Notice, _bus: &str) -> io::Result<bool> {
        Ok(false)
    }

    fn flush(&mut self) -> io::Result<()> {
        self.output.flush()
    }
}
