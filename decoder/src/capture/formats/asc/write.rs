//! Writer of Vector's ASC, in the form that Vector's programs and python-can write.
//!
//! ```text
//! date Sat Sep 30 15:06:13.191 2017
//! base hex  timestamps absolute
//! internal events logged
//! Begin Triggerblock Sat Sep 30 15:06:13.191 2017
//!    0.000000 Start of measurement
//! // bus 1: can0
//!    0.000000 1  18EBFF00x       Rx   d 8 01 A0 0F A6 60 3B D1 40
//!    0.500000 1  ErrorFrame    Flags = 0x4 CodeExt = 0x20A2 Code = 0x0 ID = 0 DLC = 0 Position = 0 Length = 0
//!    1.000000 CANFD   1 Rx        300                                   1 0 9 12 01 … 0C        0    0     3000 …
//! End TriggerBlock
//! ```
//!
//! Fields after the data of an FD frame: duration and number of bits (unknown), flags, and five numbers about
//! checksum and bit timing (unknown).

use std::io::{self, Write};

use super::error;
use crate::ascii::{push_blanks, push_code, push_decimal, push_digits, push_nine, push_padded, push_part};
use crate::capture::Notice;
use crate::capture::bus_error::reported_violation;
use crate::capture::calendar::to_date;
use crate::capture::elapsed::Elapsed;
use crate::capture::text::print::{BusNumbering, CachedText, push_lines, push_spaced_data};
use crate::capture::writer::FrameWriter;
use crate::frame::{CanId, Frame, FrameFlags};

/// Resolution of the dates in the header, in nanoseconds.
const MILLISECOND: i64 = 1_000_000;
const SECOND: u64 = 1_000_000_000;

/// Format of `Sat Sep 30 15:06:13.191 2017`.
const DATE: &str = "%a %b %d %H:%M:%S%.3f %Y";

/// Flags of an FD line.
const FLAGS: [(FrameFlags, u32); 3] =
    [(FrameFlags::FD, 1 << 12), (FrameFlags::BIT_RATE_SWITCH, 1 << 13), (FrameFlags::ERROR_STATE, 1 << 14)];

/// Column widths: identifier of a classic line; identifier and name of an FD line.
const ID: usize = 15;
const FD_ID: usize = 8;
const FD_NAME: &[u8; 35] = b"                                   ";

/// Zeros for the duration, the number of bits, and the fields after the flags.
const UNKNOWN: &[u8; 14] = b"        0    0";
const UNKNOWN_END: &[u8; 46] = b"        0        0        0        0        0\n";

pub(super) struct AscWriter<W> {
    output: W,
    line: Vec<u8>,
    elapsed: Elapsed,
    seconds: CachedText<u64>,
    buses: BusNumbering,
    has_begun: bool,
    has_ended: bool,
}

impl<W: Write> AscWriter<W> {
    pub(super) fn new(output: W) -> Self {
        Self {
            output,
            line: Vec::with_capacity(512),
            elapsed: Elapsed::new(MILLISECOND, i64::MIN),
            seconds: CachedText::default(),
            buses: BusNumbering::default(),
            has_begun: false,
            has_ended: false,
        }
    }

    /// Writes the header, once the time of the first frame is known.
    fn begin_capture(&mut self, start: i64) {
        let date = to_date(start).strftime(DATE).to_string();
        let text = format!(
            "date {date}\nbase hex  timestamps absolute\ninternal events logged\n\
             Begin Triggerblock {date}\n   0.000000 Start of measurement\n"
        );
        self.line.extend_from_slice(text.as_bytes());
        self.has_begun = true;
    }

    fn write_frame(&mut self, frame: &Frame, bus: &str, comment: Option<&str>) -> io::Result<()> {
        self.line.clear();
        if let Some(start) = self.elapsed.start_time(frame.time) {
            self.begin_capture(start);
        }
        let (channel, is_new) = self.buses.bus_number(bus);
        if is_new {
            push_lines(&mut self.line, &format!("// bus {channel}: "), bus, "\n");
        }
        if let Some(comment) = comment {
            push_lines(&mut self.line, "// ", comment, "\n");
        }
        self.append_time(frame);
        let channel = u64::try_from(channel).unwrap_or(u64::MAX);
        match frame.flags {
            flags if flags.contains(FrameFlags::ERROR) => self.append_error(frame, channel),
            flags if flags.contains(FrameFlags::FD) => self.append_fd(frame, channel),
            _ => self.append_classic(frame, channel),
        }
        self.output.write_all(&self.line)
    }

    fn append_time(&mut self, frame: &Frame) {
        let time = self.elapsed.elapsed_since_start(frame.time);
        let (second, fraction) = (time / SECOND, time % SECOND);
        let begin = self.seconds.cached_text(&second, |text, second| {
            push_padded(text, *second, 4);
            text.push(b'.');
        });
        self.line.extend_from_slice(begin);
        if fraction.is_multiple_of(1_000) {
            push_digits(&mut self.line, fraction / 1_000, 6);
        } else {
            push_nine(&mut self.line, fraction);
        }
        self.line.push(b' ');
    }

    /// Appends the direction: transmitted, or received if unknown.
    fn append_direction(&mut self, frame: &Frame) {
        let sent = frame.flags.contains(FrameFlags::TRANSMITTED);
        self.line.extend_from_slice(if sent { b" Tx  " } else { b" Rx  " });
    }

    /// Appends `123` or `18FEF100x`; returns its length.
    fn append_identifier(&mut self, id: CanId) -> usize {
        let begin = self.line.len();
        push_code(&mut self.line, id.number(), 1);
        if let CanId::Extended(_) = id {
            self.line.push(b'x');
        }
        self.line.len().saturating_sub(begin)
    }

    fn append_classic(&mut self, frame: &Frame, channel: u64) {
        push_decimal(&mut self.line, channel);
        self.line.extend_from_slice(b"  ");
        let length = self.append_identifier(frame.id);
        push_blanks(&mut self.line, ID, length);
        self.append_direction(frame);
        let is_remote = frame.flags.contains(FrameFlags::REMOTE);
        self.line.extend_from_slice(if is_remote { b" r " } else { b" d " });
        push_code(&mut self.line, frame.dlc().into(), 1);
        push_spaced_data(&mut self.line, frame);
        self.line.push(b'\n');
    }

    fn append_fd(&mut self, frame: &Frame, channel: u64) {
        self.line.extend_from_slice(b"CANFD ");
        push_padded(&mut self.line, channel, 3);
        self.append_direction(frame);
        let digits = (u32::BITS - frame.id.number().leading_zeros()).div_ceil(4).max(1) as usize;
        let length = digits + usize::from(matches!(frame.id, CanId::Extended(_)));
        push_part(&mut self.line, *FD_NAME, FD_ID.saturating_sub(length).saturating_add(1));
        self.append_identifier(frame.id);
        self.line.extend_from_slice(FD_NAME);
        let is = |flag| u8::from(frame.flags.contains(flag)) + b'0';
        let (switched, passive) = (is(FrameFlags::BIT_RATE_SWITCH), is(FrameFlags::ERROR_STATE));
        self.line.extend_from_slice(&[switched, b' ', passive, b' ']);
        push_code(&mut self.line, frame.dlc().into(), 1);
        push_padded(&mut self.line, frame.length.into(), 3);
        push_spaced_data(&mut self.line, frame);
        self.line.extend_from_slice(UNKNOWN);
        let flags = FLAGS.iter().filter(|(flag, _)| frame.flags.contains(*flag));
        self.line.extend_from_slice(b"     ");
        push_code(&mut self.line, flags.fold(0, |all, (_, bit)| all | bit), 1);
        self.line.extend_from_slice(UNKNOWN_END);
    }

    fn append_error(&mut self, frame: &Frame, channel: u64) {
        push_decimal(&mut self.line, channel);
        self.line.extend_from_slice(b"  ");
        error::push(&mut self.line, reported_violation(frame));
        self.line.push(b'\n');
    }
}

impl<W: Write + Send> FrameWriter for AscWriter<W> {
    fn write(&mut self, frame: &Frame, bus: &str) -> io::Result<()> {
        self.write_frame(frame, bus, None)
    }

    fn write_commented(&mut self, frame: &Frame, bus: &str, comment: &str) -> io::Result<()> {
        self.write_frame(frame, bus, Some(comment))
    }

    /// Stores nothing: other readers know no lines for notices.
    fn notice(&mut self, _notice: &Notice, _bus: &str) -> io::Result<bool> {
        Ok(false)
    }

    fn flush(&mut self) -> io::Result<()> {
        self.output.flush()
    }

    fn finish(&mut self) -> io::Result<()> {
        if !std::mem::replace(&mut self.has_ended, true) {
            // Without a frame there is no date; a base line alone is a valid capture.
            let end: &[u8] =
                if self.has_begun { b"End TriggerBlock\n" } else { b"base hex  timestamps absolute\n" };
            self.output.write_all(end)?;
        }
        self.output.flush()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::frame::Timestamp;

    fn written(frames: &[(Frame, &str)]) -> String {
        let mut writer = AscWriter::new(Vec::new());
        for (frame, bus) in frames {
            writer.write(frame, bus).unwrap();
        }
        writer.finish().unwrap();
        String::from_utf8(writer.output).unwrap()
    }

    fn at(nanoseconds: i64, frame: Frame) -> Frame {
        Frame { time: Some(Timestamp(1_506_783_973_191_000_000 + nanoseconds)), ..frame }
    }

    #[test]
    fn a_capture_line_by_line() {
        let frame = Frame::data_frame(CanId::from_standard(0x6F9), &[5, 0x0C, 0, 0, 0, 0, 0, 0xAB]);
        let remote = Frame { flags: FrameFlags::REMOTE, length: 8, ..Frame::EMPTY };
        let error = Frame {
            flags: FrameFlags::ERROR,
            ..Frame::data_frame(CanId::from_extended(0x88), &[0, 0, 4, 2, 0, 0, 0, 0])
        };
        let sent = FrameFlags::FD.with(FrameFlags::BIT_RATE_SWITCH).with(FrameFlags::TRANSMITTED);
        let fd = Frame {
            flags: sent,
            ..Frame::data_frame(CanId::from_extended(0x50005), &[1, 2, 3, 4, 5, 6, 7, 8, 9])
        };
        let text = written(&[
            (at(250_000, frame), "can\x1b0"),
            (at(2_501_000_001, Frame { raw_dlc: 13, ..frame }), "can\x1b0"),
            (at(17_876_708_000, Frame { id: CanId::from_extended(0x18EB_FF00), ..remote }), "2"),
            (at(17_876_708_000, error), "2"),
            (at(12_345_000_000_000, fd), "2"),
        ]);
        let expected = "\
date Sat Sep 30 15:06:13.191 2017
base hex  timestamps absolute
internal events logged
Begin Triggerblock Sat Sep 30 15:06:13.191 2017
   0.000000 Start of measurement
// bus 1: can\\u{1b}0
   0.000250 1  6F9             Rx   d 8 05 0C 00 00 00 00 00 AB
   2.501000001 1  6F9             Rx   d D 05 0C 00 00 00 00 00 AB
// bus 2: 2
  17.876708 2  18EBFF00x       Rx   r 8
  17.876708 2  ErrorFrame\tFlags = 0x4 CodeExt = 0x20A2 Code = 0x0 ID = 0 DLC = 0 Position = 0 Length = 0
12345.000000 CANFD   2 Tx     50005x                                   1 0 9  9 01 02 03 04 05 06 07 08 09        0    0     3000        0        0        0        0        0
End TriggerBlock
";
        assert_eq!(text, expected);
    }

    #[test]
    fn comments_stand_before_their_frame_and_are_passed_over() {
        let mut writer = AscWriter::new(Vec::new());
        let frame = at(0, Frame::data_frame(CanId::from_standard(1), &[]));
        writer.write_commented(&frame, "1", "first\n1.0 1 123 Rx d 0\rsecond").unwrap();
        // The capture was not finished but is readable.
        let content = crate::capture::testing::read_capture(&writer.output);
        assert_eq!(content.frames.len(), 1);
        let text = String::from_utf8(writer.output).unwrap();
        let end = "// first\n// 1.0 1 123 Rx d 0\\rsecond\n   0.000000 1  1               Rx   d 0\n";
        assert!(text.ends_with(end), "{text}");
    }

    #[test]
    fn a_capture_without_frames_is_one() {
        let text = written(&[]);
        assert_eq!(text, "base hex  timestamps absolute\n");
        assert_eq!(crate::capture::detect_format(text.as_bytes(), true).unwrap().name, "asc");
    }
}
