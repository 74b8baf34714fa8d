//! Vector's ASCII captures (ASC), as Vector's programs, python-can and converters write them.
//!
//! ```text
//! date Sam Sep 30 15:06:13.191 2017
//! base hex  timestamps absolute
//! internal events logged
//! Begin Triggerblock Sam Sep 30 15:06:13.191 2017
//!    0.000000 Start of measurement
//!   17.876708 1  6F9             Rx   d 8 05 0C 00 00 00 00 00 00  Length = 240015 BitCount = 124 ID = 1785
//!   30.005021 CANFD   1 Rx        300   1 0 8  8 11 c2 03 04 05 06 07 08   102203  133   303000 …
//! End TriggerBlock
//! ```
//!
//! All header lines are optional, and a frame may follow directly. Rows without any header are recognised by `Rx d 8`
//! and `Tx r` behind time, channel and identifier. python-can treats the first line that is
//! not part of its header as a header line, and so loses a frame if `internal events logged` is missing.

mod error;
mod event;
mod frame;
mod header;
mod write;

use event::AscEventContent;
use header::AscHeader;

use crate::capture::text::bus_labels::BusLabels;
use crate::capture::text::columns::NumberBase;
use crate::capture::text::evidence::{LineClass, is_proven};
use crate::capture::text::line_format::{
    CaptureAssumptions, LineFault, LineFormat, LineParser, ParsedLine, split_at,
};
use crate::capture::text::lines::SkippedLines;
use crate::capture::{
    Batch, CaptureFormat, DirectionSupport, ErrorFrames, FormatCapabilities, WritableFormat,
};

/// Number of lines at the start within which a header line must occur.
const DETECTING_LINES: usize = 50;

pub(super) const FORMAT: CaptureFormat = CaptureFormat {
    name: "asc",
    title: AscFormat::TITLE,
    is_text: true,
    is_packed: false,
    detect: detect_asc,
    parser: |_| Box::new(LineParser::new(AscFormat::default())),
};

pub(super) const WRITABLE: WritableFormat = WritableFormat {
    name: FORMAT.name,
    suffix: "asc",
    title: FORMAT.title,
    holds: FormatCapabilities {
        untimed: false,
        backwards: false,
        errors: ErrorFrames::Violations,
        directions: DirectionSupport::Assumed,
        bus_names: false,
        notices: false,
        ..FormatCapabilities::ALL
    },
    writer: |output, _| Box::new(write::AscWriter::new(output)),
};

fn detect_asc(head: &[u8]) -> bool {
    has_header(head) || is_proven(head, classify_row)
}

/// Relation of a line to a capture without header.
fn classify_row(line: &[u8]) -> LineClass {
    match event::parse_event(line, NumberBase::Hex).map(|event| event.content) {
        Some(Ok(AscEventContent::Frame(..) | AscEventContent::Request)) => LineClass::Proof,
        Some(Ok(_)) => LineClass::Related,
        None if header::parse_header(line).is_ok() => LineClass::Related,
        Some(Err(_)) | None => LineClass::Misfit,
    }
}

/// Whether a complete header line occurs. The last line may be incomplete and is not checked.
fn has_header(head: &[u8]) -> bool {
    let head = head.strip_prefix(b"\xEF\xBB\xBF").unwrap_or(head);
    let whole = memchr::memrchr(b'\n', head).and_then(|end| head.get(..end)).unwrap_or_default();
    let lines = split_at(whole, |text| memchr::memchr(b'\n', text));
    let mut lines = lines.take(DETECTING_LINES).map(<[u8]>::trim_ascii);
    lines.any(|line| matches!(header::parse_header(line), Ok(AscHeader::Date(_) | AscHeader::Base { .. })))
}

const NO_HEADER: &str =
    "no header: numbers read as hexadecimal, times as seconds from the start of the measurement";

/// State that affects later lines.
#[derive(Clone, Default)]
struct AscFormat {
    base: NumberBase,
    clock: AscClock,
    buses: BusLabels,
    /// Whether a header stated a date, or the base and the meaning of times.
    has_header: bool,
    foreign: SkippedLines,
    line: u64,
}

/// Meaning of times.
#[derive(Clone, Default)]
struct AscClock {
    relative: bool,
    elapsed: i64,
    start: Option<i64>,
    /// Date of a further header, until it is known whether the times restart after it.
    again: Option<i64>,
    /// Date of a block whose `Start of measurement` has not been read yet.
    block: Option<i64>,
}

impl AscClock {
    /// Sets the date of a header. Concatenated captures in one file have one header each.
    fn set_date(&mut self, date: i64) {
        if self.relative || self.start.is_none() {
            (self.start, self.elapsed) = (Some(date), 0);
        } else {
            self.again = Some(date);
        }
    }

    /// Advances to a line with a time: differences are relative to the previous line of any type.
    fn advance_to(&mut self, stamp: i64) {
        if let (Some(date), Some(start)) = (self.again.take(), self.start) {
            // BUSMASTER repeats the header at each pause, but its times continue. A time that is large enough
            // for the interval between the two dates continues.
            let goes_on = stamp >= self.elapsed && stamp >= date.saturating_sub(start);
            self.start = Some(if goes_on { start } else { date });
        }
        self.elapsed = if self.relative { self.elapsed.saturating_add(stamp) } else { stamp };
    }

    /// Handles the start of the measurement: the date of its block is the zero of the times. A block begun
    /// later by a trigger has no such line; its times still count from the date of the header.
    fn start_of_measurement(&mut self) {
        if let Some(block) = self.block.take() {
            self.start = Some(block.saturating_sub(self.elapsed));
        }
    }

    /// Time of the current line.
    fn current_time(&self) -> i64 {
        self.start.or(self.block).unwrap_or(0).saturating_add(self.elapsed)
    }
}

impl AscFormat {
    fn on_header(&mut self, text: &[u8], assumptions: &mut CaptureAssumptions) -> Result<(), LineFault> {
        const ZONE: &str = "start date without time zone: times read as UTC";
        match header::parse_header(text)? {
            AscHeader::Date(date) => {
                self.has_header = true;
                self.clock.set_date(date);
                assumptions.add_assumption(ZONE);
            }
            AscHeader::TriggerBlock(date) => {
                self.clock.block = date;
                if date.is_some() {
                    assumptions.add_assumption(ZONE);
                }
            }
            AscHeader::Base { base, relative } => {
                self.has_header = true;
                self.base = base;
                self.clock.relative = relative;
            }
            AscHeader::Silent => {}
        }
        Ok(())
    }
}

impl LineFormat for AscFormat {
    const TITLE: &'static str = "Vector ASC";

    fn parse_line<'a>(
        &'a mut self,
        text: &'a [u8],
        assumptions: &mut CaptureAssumptions,
    ) -> Result<Option<ParsedLine<'a>>, LineFault> {
        let text = text.trim_ascii();
        if let Some(label) = text.strip_prefix(b"// bus ") {
            self.buses.learn_label(label);
            return Ok(None);
        }
        let Some(event) = event::parse_event(text, self.base) else {
            return self.on_header(text, assumptions).map(|()| None);
        };
        self.clock.advance_to(event.stamp);
        match event.content? {
            AscEventContent::Frame(channel, frame) => {
                if !self.has_header {
                    assumptions.add_assumption(NO_HEADER);
                }
                let time = self.clock.current_time();
                return Ok(Some(ParsedLine::new(Some(time), self.buses.name(channel), frame)));
            }
            AscEventContent::Start => self.clock.start_of_measurement(),
            AscEventContent::Request => assumptions.add_assumption("requests to send (TxRq) ignored"),
            AscEventContent::Foreign(system) => self.foreign.add_line(system, self.line),
            AscEventContent::Nothing => {}
        }
        Ok(None)
    }

    fn at_line(&mut self, number: u64) {
        self.line = number;
    }

    fn report_skipped(&mut self, batch: &mut Batch) {
        self.foreign.report_lines(batch);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::capture::{FormatParser, Notice};

    fn read(text: &str) -> Batch {
        let mut batch = Batch::new();
        assert_eq!(
            LineParser::new(AscFormat::default()).parse(text.as_bytes(), true, &mut batch).unwrap(),
            text.len()
        );
        batch
    }

    fn times(batch: &Batch) -> Vec<String> {
        batch.frames().iter().map(|frame| frame.time.unwrap().to_string()).collect()
    }

    const DATE: &str = "date Thu Jan 1 00:01:40 1970\n";

    #[test]
    fn a_frame_may_follow_the_base_at_once() {
        let batch = read("base hex  timestamps absolute\n  348.161550 1 123  Rx d 0 \n");
        assert_eq!(times(&batch), ["348.161550000"]);
        assert!(batch.notices().is_empty());
    }

    #[test]
    fn absolute_times_count_from_the_start_of_the_measurement() {
        let batch = read(&format!("{DATE}base hex\n 0.5 1 123 Rx d 0\n 0.75 1 123 Rx d 0\n"));
        assert_eq!(times(&batch), ["100.500000000", "100.750000000"]);
        assert!(matches!(batch.notices(), [(0, Notice::Assumption(_))]), "{:?}", batch.notices());
    }

    #[test]
    fn a_block_with_the_start_of_measurement_dates_it() {
        let block = "Begin Triggerblock Thu Jan 1 00:05:00 1970\n";
        let batch = read(&format!("{DATE}{block} 0.0 Start of measurement\n 0.5 1 123 Rx d 0\n"));
        assert_eq!(times(&batch), ["300.500000000"]);
        let later = read(&format!("{DATE}{block} 200.5 1 123 Rx d 0\n"));
        assert_eq!(times(&later), ["300.500000000"]);
        let alone = read(&format!("base hex\n{block} 0.5 1 123 Rx d 0\n"));
        assert_eq!(times(&alone), ["300.500000000"]);
    }

    #[test]
    fn a_second_header_restarts_unless_times_continue() {
        let second = "date Thu Jan 1 00:05:00 1970\n";
        let batch = read(&format!("{DATE} 2.5 1 1 Rx d 0\n{second} 0.5 1 1 Rx d 0\n"));
        assert_eq!(times(&batch), ["102.500000000", "300.500000000"]);
        let batch = read(&format!("{DATE} 2.5 1 1 Rx d 0\n{second} 210.5 1 1 Rx d 0\n"));
        assert_eq!(times(&batch), ["102.500000000", "310.500000000"]);
    }

    #[test]
    fn relative_times_add_up_over_every_line_with_a_time() {
        let text = "base dec  timestamps relative\n 0.1 1 291 Rx d 0\n 0.05 1 Statistic: D 0\n 0.1 what\n 0.05 2 100x Tx d 1 16\n";
        let batch = read(text);
        assert_eq!(times(&batch), ["0.100000000", "0.300000000"]);
        assert_eq!(batch.frames()[1].data(), [16]);
        let [(1, notice)] = batch.notices() else { panic!("{:?}", batch.notices()) };
        assert!(notice.to_string().starts_with("line 4: expected a channel number"), "{notice}");
    }

    #[test]
    fn other_bus_systems_are_skipped_and_counted_by_name() {
        let batch = read(
            "base hex\n 0.1 Li 3c Tx 1 01\n 0.2 1 123 Rx d 0\n 0.3 ETH 1 Rx 40:FF\n 0.4 L2 3c Rx 1 01\n",
        );
        assert_eq!(times(&batch), ["0.200000000"]);
        let notices: Vec<_> = batch.notices().iter().map(|(_, notice)| notice.to_string()).collect();
        let expected =
            ["2 lines of LIN skipped (first: line 2)", "1 line of Ethernet skipped (first: line 4)"];
        assert_eq!(notices, expected);
    }

    #[test]
    fn rows_without_a_header_are_hexadecimal_seconds() {
        let batch = read("0.001001 1  0CF00203x Rx d 2 CC 10\n0.001002 1 10 Tx d 1 10\n");
        let frames: Vec<_> = batch.frames().iter().map(|frame| format!("{frame:?}")).collect();
        assert_eq!(
            frames,
            [
                "{1} (0.001001000) bus0 0CF00203#CC10 flags=40 dlc=0",
                "{2} (0.001002000) bus0 010#10 flags=20 dlc=0",
            ]
        );
        let [(0, notice)] = batch.notices() else { panic!("{:?}", batch.notices()) };
        assert_eq!(notice.to_string(), NO_HEADER);
    }

    #[test]
    fn channels_are_buses() {
        let mut batch = Batch::new();
        let mut reader = LineParser::new(AscFormat::default());
        reader
            .parse(b" 0.1 2 1 Rx d 0\n 0.1 CANFD 1 Rx 1 0 0 0 0\n 0.1 2 1 TxRq d 0\n", true, &mut batch)
            .unwrap();
        assert_eq!(reader.buses().names(), ["2", "1"]);
        assert_eq!(batch.notices().len(), 2, "no header, and a request");
    }

    #[test]
    fn captures_are_recognised_by_their_header() {
        for head in [
            "date Sam Sep 30 15:06:13.191 2017\n",
            "\u{FEFF}base hex  timestamps absolute\r\n",
            "// generated\n\nbase dec\n",
            "0.001001 1  0CF00203x Rx d 8 CC 00 00 FF FF 00 00 FF\n0.1 2 18EAFFF9x Tx d 3 EC FE 00",
            "Begin TriggerBlock\n0.0 Start of measurement\n0.1 1 123 Rx r\n",
            "0.1 CANFD 1 Rx 1 0 0 0 0\n",
        ] {
            assert!(detect_asc(head.as_bytes()), "{head}");
        }
        for head in [
            "",
            "base hex",
            "date now\n",
            "(1.0) can0 123#11\n",
            ";$FILEVERSION=1.1\n",
            "// only a comment\n",
            "0.1 Start of measurement\n",
            "// version 9.0.0\n0.1 1 123 Rx e 1 05\n",
        ] {
            assert!(!detect_asc(head.as_bytes()), "{head}");
        }
    }
}
