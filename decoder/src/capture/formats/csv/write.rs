//! Writer of CSV for spreadsheets and scripts: RFC 4180, a header line, one line per frame.
//!
//! ```text
//! time,bus,id,extended,remote,error,fd,brs,esi,direction,dlc,length,data,comment
//! 1700000000.000001000,can0,185,0,0,0,0,0,0,rx,3,3,010203,
//! 1700000000.000002000,can1,18FECA80,1,0,0,1,1,0,,9,12,0102030405060708090A0B0C,"one, two"
//! ```
//!
//! time: seconds with nine decimals, empty if the frame has no time. id: hexadecimal, three or eight digits;
//! the SocketCAN error class of an error frame. dlc: the number in the frame, 0 to 15. length: data bytes; of
//! a remote frame the number of bytes requested. Control characters are escaped, and an apostrophe precedes
//! text that a spreadsheet would evaluate as a formula.

use std::io::{self, Write};

use crate::ascii::{push_code, push_decimal, push_nine};
use crate::capture::text::print::{CachedText, push_data, push_escaped};
use crate::capture::{FormatCapabilities, FrameWriter, Notice, WritableFormat};
use crate::frame::{CanId, Frame, FrameFlags, Timestamp};

/// The header line.
const NAMES: &[u8] = b"time,bus,id,extended,remote,error,fd,brs,esi,direction,dlc,length,data,comment\n";

const SECOND: u64 = 1_000_000_000;

pub(in crate::capture::formats) const WRITABLE: WritableFormat = WritableFormat {
    name: "csv",
    suffix: "csv",
    title: "CSV of frames",
    holds: FormatCapabilities { notices: false, ..FormatCapabilities::ALL },
    writer: |output, _| Box::new(CsvWriter::new(output)),
};

struct CsvWriter<W> {
    output: W,
    line: Vec<u8>,
    /// Seconds, with the decimal point.
    seconds: CachedText<u64>,
    /// Cell of a bus, with the commas around it.
    bus: CachedText<String>,
    has_begun: bool,
}

impl<W: Write> CsvWriter<W> {
    fn new(output: W) -> Self {
        let (seconds, bus) = (CachedText::default(), CachedText::default());
        Self { output, line: Vec::with_capacity(512), seconds, bus, has_begun: false }
    }

    fn begin_capture(&mut self) -> io::Result<()> {
        if std::mem::replace(&mut self.has_begun, true) {
            return Ok(());
        }
        self.output.write_all(NAMES)
    }

    fn write_frame(&mut self, frame: &Frame, bus: &str, comment: &str) -> io::Result<()> {
        self.begin_capture()?;
        self.line.clear();
        if let Some(time) = frame.time {
            self.append_time(time);
        }
        let bus = self.bus.cached_text(bus, |text, bus| {
            text.push(b',');
            push_cell(text, bus);
            text.push(b',');
        });
        self.line.extend_from_slice(bus);
        self.append_kind(frame);
        self.append_payload(frame);
        push_cell(&mut self.line, comment);
        self.line.push(b'\n');
        self.output.write_all(&self.line)
    }

    fn append_time(&mut self, Timestamp(time): Timestamp) {
        if time < 0 {
            self.line.push(b'-');
        }
        let (second, fraction) = (time.unsigned_abs() / SECOND, time.unsigned_abs() % SECOND);
        let begin = self.seconds.cached_text(&second, |text, second| {
            push_decimal(text, *second);
            text.push(b'.');
        });
        self.line.extend_from_slice(begin);
        push_nine(&mut self.line, fraction);
    }

    /// Appends the columns from the identifier to the direction, with the comma after them.
    fn append_kind(&mut self, frame: &Frame) {
        let is_extended = matches!(frame.id, CanId::Extended(_));
        push_code(&mut self.line, frame.id.number(), if is_extended { 8 } else { 3 });
        let bit = |flag| u8::from(frame.flags.contains(flag)) + b'0';
        let extended = u8::from(is_extended) + b'0';
        self.line.extend_from_slice(&[
            b',',
            extended,
            b',',
            bit(FrameFlags::REMOTE),
            b',',
            bit(FrameFlags::ERROR),
            b',',
            bit(FrameFlags::FD),
            b',',
            bit(FrameFlags::BIT_RATE_SWITCH),
            b',',
            bit(FrameFlags::ERROR_STATE),
            b',',
        ]);
        self.line.extend_from_slice(match frame.flags {
            flags if flags.contains(FrameFlags::TRANSMITTED) => b"tx,",
            flags if flags.contains(FrameFlags::RECEIVED) => b"rx,",
            _ => b",",
        });
    }

    /// Appends DLC, length and data, with the comma after them.
    fn append_payload(&mut self, frame: &Frame) {
        push_decimal(&mut self.line, frame.dlc().into());
        self.line.push(b',');
        push_decimal(&mut self.line, frame.length.into());
        self.line.push(b',');
        push_data(&mut self.line, frame);
        self.line.push(b',');
    }
}

/// Appends text as a cell.
fn push_cell(line: &mut Vec<u8>, text: &str) {
    if text.is_empty() {
        return;
    }
    // Spreadsheets evaluate cells that begin with these characters. Control characters are escaped below.
    let is_formula = text.starts_with(['=', '+', '-', '@', '\u{FF1D}', '\u{FF0B}', '\u{FF0D}', '\u{FF20}']);
    let mut cell = Vec::with_capacity(text.len() + 1);
    if is_formula {
        cell.push(b'\'');
    }
    push_escaped(&mut cell, text);
    if !cell.iter().any(|byte| matches!(byte, b'"' | b',')) {
        line.extend_from_slice(&cell);
        return;
    }
    line.push(b'"');
    for byte in cell {
        if byte == b'"' {
            line.push(b'"');
        }
        line.push(byte);
    }
    line.push(b'"');
}

impl<W: Write + Send> FrameWriter for CsvWriter<W> {
    fn write(&mut self, frame: &Frame, bus: &str) -> io::Result<()> {
        self.write_frame(frame, bus, "")
    }

    fn write_commented(&mut self, frame: &Frame, bus: &str, comment: &str) -> io::Result<()> {
        self.write_frame(frame, bus, comment)
    }

    /// Stores nothing: all lines are frames.
    fn notice(&mut self, _notice: &Notice, _bus: &str) -> io::Result<bool> {
        Ok(false)
    }

    fn flush(&mut self) -> io::Result<()> {
        self.begin_capture()?;
        self.output.flush()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn written(frame: &Frame, bus: &str, comment: &str) -> String {
        let mut writer = CsvWriter::new(Vec::new());
        writer.write_commented(frame, bus, comment).unwrap();
        writer.finish().unwrap();
        let text = String::from_utf8(writer.output).unwrap();
        text.strip_prefix(std::str::from_utf8(NAMES).unwrap()).unwrap().to_owned()
    }

    #[test]
    fn every_sort_of_frame_is_a_line() {
        let frame = Frame {
            time: Some(Timestamp(1_700_000_000_000_001_002)),
            ..Frame::data_frame(CanId::from_standard(0x7A), &[1, 0xAB])
        };
        let extended = Frame { id: CanId::from_extended(0x18FE_CA80), ..frame };
        let with = |flags, frame| Frame { flags, ..frame };
        let fd = with(
            FrameFlags::FD.with(FrameFlags::BIT_RATE_SWITCH).with(FrameFlags::ERROR_STATE),
            Frame::data_frame(CanId::from_standard(5), &[9; 12]),
        );
        for (frame, line) in [
            (with(FrameFlags::RECEIVED, frame), "1700000000.000001002,can0,07A,0,0,0,0,0,0,rx,2,2,01AB,\n"),
            (
                with(FrameFlags::TRANSMITTED, extended),
                "1700000000.000001002,can0,18FECA80,1,0,0,0,0,0,tx,2,2,01AB,\n",
            ),
            (with(FrameFlags::REMOTE, frame), "1700000000.000001002,can0,07A,0,1,0,0,0,0,,2,2,,\n"),
            (fd, ",can0,005,0,0,0,1,1,1,,9,12,090909090909090909090909,\n"),
            (
                Frame { time: Some(Timestamp(-1_500_000_000)), raw_dlc: 15, length: 8, ..frame },
                "-1.500000000,can0,07A,0,0,0,0,0,0,,15,8,01AB000000000000,\n",
            ),
            (
                with(FrameFlags::ERROR, Frame::data_frame(CanId::from_extended(0x20), &[0; 8])),
                ",can0,00000020,1,0,1,0,0,0,,8,8,0000000000000000,\n",
            ),
        ] {
            assert_eq!(written(&frame, "can0", ""), line);
        }
    }

    #[test]
    fn cells_are_texts_and_nothing_else() {
        for (text, cell) in [
            ("=1+1", "'=1+1"),
            ("@SUM(A1,A2)", "\"'@SUM(A1,A2)\""),
            ("-2", "'-2"),
            ("\t=1", "\\t=1"),
            ("\r=1\nx", "\\r=1\\nx"),
            ("say \"a\"", "\"say \"\"a\"\"\""),
            ("a\x1b[2J\u{202e}é", "a\\u{1b}[2J\\u{202e}é"),
            ("plain text", "plain text"),
        ] {
            let line = written(&Frame::EMPTY, text, text);
            assert_eq!(line, format!(",{cell},000,0,0,0,0,0,0,,0,0,,{cell}\n"), "{text:?}");
        }
    }

    #[test]
    fn names_come_first_even_without_frames() {
        let mut writer = CsvWriter::new(Vec::new());
        writer.finish().unwrap();
        assert_eq!(writer.output, NAMES);
    }
}
