//! Writes candump's log form: `(1700000000.000000) can0 123#1122`.

use std::io::{self, Write};

use super::super::Notice;
use super::super::writer::FrameWriter;
use crate::frame::{CanId, Frame, FrameFlags, Timestamp};

/// Bit of an identifier that says "error frame" (SocketCAN's CAN_ERR_FLAG).
const ERROR_FLAG: u32 = 0x2000_0000;

/// Writer of candump text. Frames without time have lines without a stamp, as `candump` on the screen.
pub(super) struct CandumpWriter<W> {
    output: W,
    line: Vec<u8>,
}

impl<W: Write> CandumpWriter<W> {
    pub(super) fn new(output: W) -> Self {
        Self { output, line: Vec::with_capacity(128) }
    }

    /// Writing to a vector cannot fail, so only the output's errors are real.
    fn line(&mut self, frame: &Frame, bus: &str) -> io::Result<()> {
        let line = &mut self.line;
        line.clear();
        if let Some(Timestamp(stamp)) = frame.time {
            let (seconds, nanoseconds) = (stamp.div_euclid(1_000_000_000), stamp.rem_euclid(1_000_000_000));
            if nanoseconds % 1_000 == 0 {
                write!(line, "({seconds}.{:06}) ", nanoseconds / 1_000)?;
            } else {
                write!(line, "({seconds}.{nanoseconds:09}) ")?;
            }
        }
        line.extend(bus.bytes().map(|byte| if byte.is_ascii_graphic() { byte } else { b'_' }));
        line.push(b' ');
        match frame.id {
            _ if frame.flags.contains(FrameFlags::ERROR) => {
                write!(line, "{:08X}#", frame.id.number() | ERROR_FLAG)?;
            }
            CanId::Standard(id) => write!(line, "{id:03X}#")?,
            CanId::Extended(id) => write!(line, "{id:08X}#")?,
        }
        if frame.flags.contains(FrameFlags::FD) {
            let switched = u8::from(frame.flags.contains(FrameFlags::BIT_RATE_SWITCH));
            let passive = u8::from(frame.flags.contains(FrameFlags::ERROR_STATE)) << 1;
            write!(line, "#{:X}", switched | passive)?;
        } else if frame.flags.contains(FrameFlags::REMOTE) {
            write!(line, "R{}", frame.length)?;
        }
        for byte in frame.data() {
            write!(line, "{byte:02X}")?;
        }
        if frame.raw_dlc > 8 && !frame.flags.contains(FrameFlags::FD) {
            write!(line, "_{:X}", frame.raw_dlc)?;
        }
        if frame.flags.contains(FrameFlags::TRANSMITTED) {
            line.extend_from_slice(b" T");
        } else if frame.flags.contains(FrameFlags::RECEIVED) {
            line.extend_from_slice(b" R");
        }
        line.push(b'\n');
        self.output.write_all(line)
    }
}

impl<W: Write + Send> FrameWriter for CandumpWriter<W> {
    fn write(&mut self, frame: &Frame, bus: &str) -> io::Result<()> {
        self.line(frame, bus)
    }

    /// The log form has frames only; a `DROPCOUNT` line, which candump prints on the screen, stops other readers.
    fn notice(&mut self, _notice: &Notice, _bus: &str) -> io::Result<bool> {
        Ok(false)
    }

    fn flush(&mut self) -> io::Result<()> {
        self.output.flush()
    }
}
