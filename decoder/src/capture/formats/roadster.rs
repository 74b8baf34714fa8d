//! Annotated captures of the first Open Vehicle Monitoring System, the predecessor of CRTD: time, identifier,
//! data and remarks in columns of fixed width.
//!
//! ```text
//!               0 NOTE                                 a remark of the author
//!          0.0458 588 00 00 84
//!          0.2813 102 04 44                      VDS-> (message from VDS 04)
//! 0             15   19                        43
//! ```
//!
//! Remarks may look like data, so the end of the data is determined by the column.

use crate::capture::CaptureFormat;
use crate::capture::text::columns::{ColumnWords, parse_identifier, parse_time};
use crate::capture::text::line_format::{
    CaptureAssumptions, LineFault, LineFormat, LineParser, ONLY_BUS, ParsedLine,
};
use crate::capture::text::payload::{IDENTIFIER, frame_of_all, parse_hex};
use crate::frame::FrameFlags;

/// Unit of time in nanoseconds.
const SECOND: i64 = 1_000_000_000;

/// End columns of time, identifier and data.
const ENDS: [usize; 3] = [15, 19, 44];

/// Number of lines at the start within which a frame must occur.
const DETECTING_LINES: usize = 50;

pub(super) const FORMAT: CaptureFormat = CaptureFormat {
    name: "roadster",
    title: RoadsterFormat::TITLE,
    is_text: true,
    is_packed: false,
    detect: detect_roadster,
    parser: |_| Box::new(LineParser::new(RoadsterFormat)),
};

/// Whether the first line other than a note is a frame. The last line may be incomplete and is not checked.
fn detect_roadster(head: &[u8]) -> bool {
    let whole = memchr::memrchr(b'\n', head).and_then(|end| head.get(..end)).unwrap_or_default();
    for line in whole.split(|byte| *byte == b'\n').take(DETECTING_LINES) {
        match read_line(line.strip_suffix(b"\r").unwrap_or(line)) {
            Ok(Some(_)) => return true,
            Ok(None) => {}
            Err(_) => return false,
        }
    }
    false
}

fn read_line(text: &[u8]) -> Result<Option<ParsedLine<'_>>, LineFault> {
    let [stamp, id, data] = ENDS;
    let column = |from: usize, to: usize| text.get(from..to.min(text.len())).unwrap_or_default();
    let stamp_of = |word: &[u8]| parse_time(word.trim_ascii_start(), SECOND);
    let time = stamp_of(column(0, stamp)).ok_or("time: expected seconds in the first 15 columns")?;
    let name = column(stamp, id);
    if column(stamp, id + 1).trim_ascii() == b"NOTE" {
        return Ok(None);
    }
    let digits = name.strip_prefix(b" ").filter(|digits| digits.len() == 3);
    let number =
        digits.and_then(parse_hex).and_then(|number| parse_identifier(number, false)).ok_or(IDENTIFIER)?;
    let frame = frame_of_all(number, FrameFlags(0), ColumnWords::new(column(id, data)));
    Ok(Some(ParsedLine::new(Some(time), ONLY_BUS, frame.ok_or("data: expected up to 8 bytes in hex")?)))
}

/// Line format without state.
#[derive(Clone)]
struct RoadsterFormat;

impl LineFormat for RoadsterFormat {
    const TITLE: &'static str = "OVMS annotated text";

    fn parse_line<'a>(
        &'a mut self,
        text: &'a [u8],
        _: &mut CaptureAssumptions,
    ) -> Result<Option<ParsedLine<'a>>, LineFault> {
        read_line(text)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::capture::testing;

    const SAMPLE: &str = "              0 NOTE                                 a remark\n         0.0458 588 00 00 84                         \n         0.2813 102 04 44                      VDS-> (message from VDS 04)\n        10.5000 100 01 02 03 04 05 06 07 08    AB CD a remark in hex\n";

    #[test]
    fn remarks_are_distinguished_from_data_by_their_column() {
        let content = testing::read_capture(SAMPLE.as_bytes());
        assert_eq!(
            content.items,
            [
                "{1} (0.045800000) bus0 588#000084 flags=00 dlc=0",
                "{2} (0.281300000) bus0 102#0444 flags=00 dlc=0",
                "{3} (10.500000000) bus0 100#0102030405060708 flags=00 dlc=0",
            ]
        );
    }

    #[test]
    fn broken_lines_say_what_was_expected() {
        for (line, part) in [
            ("              x 588 00", "time"),
            ("         0.0458 8FF 00", "identifier"),
            ("         0.0458 588 0x 00", "data"),
            ("0.0458 588 00", "time"),
        ] {
            let Err(LineFault::Unreadable(reason)) = read_line(line.as_bytes()) else { panic!("{line}") };
            assert!(reason.starts_with(part), "{line}: {reason}");
        }
    }

    #[test]
    fn only_lines_of_this_layout_are_recognised() {
        assert!(detect_roadster(SAMPLE.as_bytes()));
        for other in ["", "0.0458 588 00 00 84\n", "   0.000000 1 123  Rx d 0\n", "              0 NOTE  x\n"]
        {
            assert!(!detect_roadster(other.as_bytes()), "{other}");
        }
    }
}
