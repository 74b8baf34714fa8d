//! Run reports of the CANopen Conformance Test Tool (CTT of CiA), saved as text.
//!
//! ```text
//! General       : ### Prepare DUT for test ###
//! Test Info     : ### Test case : 2.1  -  Test name : SDO 01 ###
//! Test CAN      : CAN1  604 Tx SD  8  40 00 10 00 00 00 00 00
//! Test CAN      : CAN1  704 Rx SD  1  00
//! ```
//!
//! A tab and a colon follow the kind of a line. The report has no times, and the order of its frames may differ from that
//! on the bus (a remark of the tool). Frame types: SD and XD are data frames with 11 and 29 bits, SR and XR remote frames.

use crate::capture::text::columns::{ColumnWords, NumberBase, parse_identifier};
use crate::capture::text::evidence::{LineClass, is_proven};
use crate::capture::text::line_format::{CaptureAssumptions, LineFault, LineFormat, LineParser, ParsedLine};
use crate::capture::text::lines::SkippedLines;
use crate::capture::text::payload::{IDENTIFIER, LENGTH, SHORT, build_frame, by_length};
use crate::capture::{Batch, CaptureFormat};
use crate::frame::FrameFlags;

const NO_TIMES: &str = "run report of the CTT: frames have no times, and may be out of order";

/// Kinds of lines.
const KINDS: &[&[u8]] =
    &[b"General", b"Test Info", b"Test Notice", b"Test Warning", b"Test Error", b"Test CAN"];

/// Frame types: word, whether the identifier has 29 bits, and flags.
const TYPES: &[(&[u8], bool, FrameFlags)] = &[
    (b"SD", false, FrameFlags(0)),
    (b"XD", true, FrameFlags(0)),
    (b"SR", false, FrameFlags::REMOTE),
    (b"XR", true, FrameFlags::REMOTE),
];

pub(super) const FORMAT: CaptureFormat = CaptureFormat {
    name: "ctt",
    title: CttReport::TITLE,
    is_text: true,
    is_packed: false,
    detect: |head| {
        is_proven(head, |line| match split_kind(line) {
            Some((b"Test CAN", _)) => LineClass::Proof,
            Some(_) => LineClass::Related,
            None if line.starts_with(b"```") => LineClass::Related,
            None => LineClass::Misfit,
        })
    },
    parser: |_| Box::new(LineParser::new(CttReport::default())),
};

#[derive(Clone, Default)]
struct CttReport {
    texts: SkippedLines,
    line: u64,
}

/// Kind and content of a line.
fn split_kind(line: &[u8]) -> Option<(&'static [u8], &[u8])> {
    let colon = line.iter().position(|byte| *byte == b':')?;
    let (kind, content) = (line.get(..colon)?.trim_ascii(), line.get(colon + 1..)?);
    KINDS.iter().find(|known| **known == kind).map(|known| (*known, content))
}

impl LineFormat for CttReport {
    const TITLE: &'static str = "run report of the CTT";

    fn parse_line<'a>(
        &'a mut self,
        text: &'a [u8],
        assumptions: &mut CaptureAssumptions,
    ) -> Result<Option<ParsedLine<'a>>, LineFault> {
        let Some((b"Test CAN", content)) = split_kind(text.trim_ascii()) else {
            self.texts.add_line("with texts of the report", self.line);
            return Ok(None);
        };
        assumptions.add_assumption(NO_TIMES);
        let mut words = ColumnWords::new(content);
        let bus = words.next().ok_or("channel: expected a name such as CAN1")?;
        let number = words.next().and_then(|word| NumberBase::Hex.parse_number(word));
        let way = match words.next() {
            Some(b"Rx") => FrameFlags::RECEIVED,
            Some(b"Tx") => FrameFlags::TRANSMITTED,
            _ => return Err("direction: expected Rx or Tx".into()),
        };
        let kind = words.next().and_then(|word| TYPES.iter().find(|(known, ..)| *known == word));
        let (_, is_extended, flags) = kind.ok_or("frame type: expected SD, XD, SR or XR")?;
        let id = number.and_then(|number| parse_identifier(number, *is_extended)).ok_or(IDENTIFIER)?;
        let length = words.next().and_then(|word| NumberBase::Decimal.parse_byte(word));
        let lengths = length.and_then(|length| by_length(length, *flags)).ok_or(LENGTH)?;
        let frame = build_frame(id, flags.with(way), lengths, words, NumberBase::Hex).ok_or(SHORT)?;
        Ok(Some(ParsedLine::new(None, bus, frame)))
    }

    fn at_line(&mut self, number: u64) {
        self.line = number;
    }

    fn report_skipped(&mut self, batch: &mut Batch) {
        self.texts.report_lines(batch);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::capture::testing::read_capture;

    #[test]
    fn frames_between_texts() {
        let text = "General\t: ### Prepare ###\r\nTest CAN\t: CAN1  000 Tx SD  2  81 04\r\nTest Notice\t: 12 34 56\r\n\
                    Test CAN\t: CAN2  18FEF100 Rx XD  1  05\r\nTest CAN\t: CAN1  704 Tx SR  1\r\n";
        let content = read_capture(text.as_bytes());
        assert_eq!(
            content.items,
            [
                NO_TIMES,
                "{1} bus0 000#8104 flags=20 dlc=0",
                "{2} bus1 18FEF100#05 flags=40 dlc=0",
                "{3} bus0 704#R1 flags=21 dlc=0",
                "2 lines with texts of the report skipped (first: line 1)",
            ]
        );
        assert_eq!(content.buses, ["CAN1", "CAN2"]);
    }

    #[test]
    fn broken_lines_say_what_was_expected() {
        let rows = [
            "CAN1 704 Up SD 1 00",
            "CAN1 704 Rx XX 1 00",
            "CAN1 804 Rx SD 1 00",
            "CAN1 704 Rx SD 9 00",
            "CAN1 704 Rx SD 2 00",
        ];
        let text = rows.map(|row| format!("Test CAN\t: {row}\n")).concat();
        let items = read_capture(text.as_bytes()).items;
        for (item, expected) in
            items.iter().skip(1).zip(["direction", "frame type", "identifier", "length", "data"])
        {
            assert!(item.contains(&format!(": {expected}:")), "{item}");
        }
        assert_eq!(items.len(), 6);
        assert!(!(FORMAT.detect)(b"General\t: hello\n") && !(FORMAT.detect)(b"Test: CAN\n"));
    }
}
