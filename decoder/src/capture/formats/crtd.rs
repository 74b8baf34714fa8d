//! CRTD, the text captures of the Open Vehicle Monitoring System (docs.openvehicles.com, "CRTD CAN Log
//! Format", versions 1.0 to 3.1).
//!
//! ```text
//! 1542473901.020305 CXX OVMS CRTD              comment; also CER, CST, CEV, CBC, CMT and others
//! 1542473901.020305 1R11 7E8 04 41 0C 00 00    received on bus 1, base identifier
//! 1542473901.021 2T29 18DAF110 02 01 0C        transmitted on bus 2, extended identifier
//! 1542473901.021 R11 7E8 01                    without a number: bus 1
//! # comment                                    in captures, though in no version of the specification
//! ```
//!
//! Times are seconds in UTC, or since the recorder was switched on. The format has no remote frames. Comments
//! on errors and statistics are not converted to frames.

use crate::capture::CaptureFormat;
use crate::capture::text::columns::{ColumnWords, parse_identifier, parse_time};
use crate::capture::text::line_format::{
    CaptureAssumptions, LineFault, LineFormat, LineParser, ONLY_BUS, ParsedLine, first_lines,
};
use crate::capture::text::payload::{IDENTIFIER, frame_of_all, parse_hex};
use crate::frame::FrameFlags;

/// Unit of time in nanoseconds.
const SECOND: i64 = 1_000_000_000;

/// Number of lines at the start within which a record must occur.
const DETECTING_LINES: usize = 50;

/// Records that contain frames: name, direction, and whether the identifier is extended.
const RECORDS: &[(&[u8], FrameFlags, bool)] = &[
    (b"R11", FrameFlags::RECEIVED, false),
    (b"R29", FrameFlags::RECEIVED, true),
    (b"T11", FrameFlags::TRANSMITTED, false),
    (b"T29", FrameFlags::TRANSMITTED, true),
];

pub(super) const FORMAT: CaptureFormat = CaptureFormat {
    name: "crtd",
    title: CrtdFormat::TITLE,
    is_text: true,
    is_packed: false,
    detect: detect_crtd,
    parser: |_| Box::new(LineParser::new(CrtdFormat)),
};

/// Whether the first line other than a comment is a known record.
fn detect_crtd(head: &[u8]) -> bool {
    let first = first_lines(head, DETECTING_LINES).find(|line| !line.starts_with(b"#"));
    first.is_some_and(|line| split_line(line).is_some_and(|(_, _, record, _)| is_record(record)))
}

/// Whether the record is a frame or a known comment.
fn is_record(record: &[u8]) -> bool {
    matches!(record, b"CXX" | b"CER" | b"CST" | b"CEV" | b"CBC" | b"CDP" | b"CMT" | b"CVR")
        || RECORDS.iter().any(|(name, _, _)| *name == record)
}

/// Splits a line into time, bus, record name, and the remaining words.
fn split_line(line: &[u8]) -> Option<(i64, &[u8], &[u8], ColumnWords<'_>)> {
    let mut words = ColumnWords::new(line);
    let stamp = words.next().filter(|word| word.contains(&b'.'))?;
    let record = words.next()?;
    let digits = record.iter().take_while(|byte| byte.is_ascii_digit()).count();
    let (bus, record) = record.split_at_checked(digits)?;
    Some((parse_time(stamp, SECOND)?, if bus.is_empty() { ONLY_BUS } else { bus }, record, words))
}

/// Line format without state.
#[derive(Clone)]
struct CrtdFormat;

impl LineFormat for CrtdFormat {
    const TITLE: &'static str = "OVMS CRTD";

    fn parse_line<'a>(
        &'a mut self,
        text: &'a [u8],
        _: &mut CaptureAssumptions,
    ) -> Result<Option<ParsedLine<'a>>, LineFault> {
        let text = text.trim_ascii();
        if text.starts_with(b"#") {
            return Ok(None);
        }
        let (time, bus, record, mut words) =
            split_line(text).ok_or("expected seconds and a record, such as 1.5 1R11")?;
        if record.starts_with(b"C") {
            return Ok(None);
        }
        let record = RECORDS.iter().find(|(name, _, _)| *name == record);
        let (_, flags, extended) =
            *record.ok_or("record: expected R11, R29, T11, T29 or C and two letters")?;
        let id = words.next().and_then(parse_hex).and_then(|number| parse_identifier(number, extended));
        let frame = frame_of_all(id.ok_or(IDENTIFIER)?, flags, words);
        Ok(Some(ParsedLine::new(Some(time), bus, frame.ok_or("data: expected up to 8 bytes in hex")?)))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::capture::testing::read_capture;

    #[test]
    fn frames_of_both_directions_on_every_bus() {
        let content = read_capture(
            b"1542473901.020305 CXX OVMS CRTD\n\
              # a remark\n\
              1542473901.020305 1R11 7E8 04 41 0C\r\n\
              1542473901.021 2T29 18DAF110 02 01 0C \n\
              1542473901.021 R11 00000123\n",
        );
        assert_eq!(
            content.items,
            [
                "{1} (1542473901.020305000) bus0 7E8#04410C flags=40 dlc=0",
                "{2} (1542473901.021000000) bus1 18DAF110#02010C flags=20 dlc=0",
                "{3} (1542473901.021000000) bus0 123# flags=40 dlc=0",
            ]
        );
        assert_eq!(content.buses, ["1", "2"]);
    }

    #[test]
    fn comments_are_neither_frames_nor_errors() {
        let content = read_capture(
            b"169.971289 CXX Info Type:crtd; Vehicle:TSHK;\n\
              19292.299819 CEV vehicle.alert this is a textual vehicle alert\n\
              19292.3 2CER TX_Fail T11 123 00 11\n\
              198923.283738 CST intr=0 rxpkt=0 errflags=0\n\
              198923.3 1CMT metric\n",
        );
        assert_eq!(content.items, [] as [&str; 0]);
    }

    #[test]
    fn broken_lines_say_what_was_expected() {
        let content = read_capture(
            b"1.0 CXX x\n1.0 R12 123 00\n1.0 R11 800 00\n1.0 R29 20000000\n1.0 R11 123 00 1x\nx R11 1\n1.0 R11 1 0 1 2 3 4 5 6 7 8\n",
        );
        let expected = ["record", "identifier", "identifier", "data", "expected seconds", "data"];
        assert_eq!(content.items.len(), expected.len());
        for (line, (item, part)) in content.items.iter().zip(expected).enumerate() {
            assert!(item.starts_with(&format!("line {}: {part}", line + 2)), "{item}");
        }
    }

    #[test]
    fn captures_are_recognised_by_their_first_record() {
        for head in ["100.602 CXX Info\n", "# x\n\n1705316400.05 3R11 131 00\n", "1.0 R11 131"] {
            assert!(detect_crtd(head.as_bytes()), "{head}");
        }
        for head in ["", "100 R11 1", "1.0 1 R11", "1.000 1 123 Rx d 0\n", "hello\n1.0 R11 1\n"] {
            assert!(!detect_crtd(head.as_bytes()), "{head}");
        }
    }
}
