//! Captures of Microchip's CAN BUS Analyzer.
//!
//! ```text
//! //---------------------------------
//! Microchip Technology Inc.
//! CAN BUS Analyzer
//! Logging Started: 23/9/2015 22:17:43
//! //---------------------------------
//! 1218;RX;0x236;1;0x00;0x00;0x00;0x00;0x00;0x00;0x00;0xF0     milliseconds, direction, ID, length, data
//! ```
//!
//! A line may have eight data bytes with a smaller length. Times are not added to the date above: the format
//! does not define this, and in some captures they do not count from it. An extended identifier is recognised
//! only by its value.

use crate::capture::CaptureFormat;
use crate::capture::text::columns::{NumberBase, parse_time};
use crate::capture::text::line_format::{
    CaptureAssumptions, LineFault, LineFormat, LineParser, ONLY_BUS, ParsedLine, first_lines,
};
use crate::capture::text::payload::{IDENTIFIER, LENGTH, by_length, by_size, parse_hex};
use crate::frame::{Frame, FrameFlags, MAX_DATA};

/// Unit of time in nanoseconds.
const MILLISECOND: i64 = 1_000_000;

/// Number of lines at the start within which the program name must occur.
const DETECTING_LINES: usize = 10;

pub(super) const FORMAT: CaptureFormat = CaptureFormat {
    name: "microchip",
    title: MicrochipFormat::TITLE,
    is_text: true,
    is_packed: false,
    detect: detect_microchip,
    parser: |_| Box::new(LineParser::new(MicrochipFormat::default())),
};

/// Whether the capture has the program's heading.
fn detect_microchip(head: &[u8]) -> bool {
    let mut lines = first_lines(head, DETECTING_LINES);
    let is_comment = lines.next().is_some_and(|line| line.starts_with(b"//"));
    is_comment && lines.any(|line| line == b"CAN BUS Analyzer")
}

/// State that affects later lines.
#[derive(Clone, Default)]
struct MicrochipFormat {
    in_heading: bool,
}

impl LineFormat for MicrochipFormat {
    const TITLE: &'static str = "Microchip CAN BUS Analyzer";

    fn parse_line<'a>(
        &'a mut self,
        text: &'a [u8],
        assumptions: &mut CaptureAssumptions,
    ) -> Result<Option<ParsedLine<'a>>, LineFault> {
        let text = text.trim_ascii();
        if text.starts_with(b"//") {
            self.in_heading = !self.in_heading;
            return Ok(None);
        }
        let mut fields = text.split(|byte| *byte == b';').map(<[u8]>::trim_ascii);
        let stamp = fields.next().and_then(|word| parse_time(word, MILLISECOND));
        if self.in_heading && stamp.is_none() {
            return Ok(None);
        }
        let time = stamp.ok_or("time: expected milliseconds, such as 1218")?;
        let flags = match fields.next() {
            Some(b"RX") => FrameFlags::RECEIVED,
            Some(b"TX") => FrameFlags::TRANSMITTED,
            _ => return Err("direction: expected RX or TX".into()),
        };
        assumptions.add_assumption("identifier type not recorded: identifiers above 7FF read as 29-bit");
        let id = fields.next().and_then(parse_hex).and_then(by_size).ok_or(IDENTIFIER)?;
        let length = fields.next().and_then(|word| NumberBase::Decimal.parse_byte(word));
        let (length, raw_dlc) = length.and_then(|length| by_length(length, flags)).ok_or(LENGTH)?;
        let mut bytes = [0; MAX_DATA];
        for slot in bytes.iter_mut().take(length.into()) {
            let byte = fields.next().and_then(parse_hex).and_then(|byte| u8::try_from(byte).ok());
            *slot = byte.ok_or("data: expected as many bytes as the length, such as 0x00")?;
        }
        let frame = Frame { id, flags, length, raw_dlc, bytes, ..Frame::EMPTY };
        Ok(Some(ParsedLine::new(Some(time), ONLY_BUS, frame)))
    }
}

#[cfg(test)]
mod tests {
    use crate::capture::testing::read_capture;

    const HEADING: &str = "//-----\nMicrochip Technology Inc.\nCAN BUS Analyzer\nLogging Started: 23/9/2015 22:17:43\n//-----\n";

    #[test]
    fn frames_have_as_many_bytes_as_the_length_says() {
        let text = format!(
            "{HEADING}1218;RX;0x236;1;0x01;0x00;0x00;0x00;0x00;0x00;0x00;0xF0\n1219;TX;0x18FEF100;0;\n"
        );
        let content = read_capture(text.as_bytes());
        assert_eq!(
            content.items,
            [
                "identifier type not recorded: identifiers above 7FF read as 29-bit",
                "{1} (1.218000000) bus0 236#01 flags=40 dlc=0",
                "{2} (1.219000000) bus0 18FEF100# flags=20 dlc=0",
            ]
        );
        assert_eq!(content.buses, ["1"]);
    }

    #[test]
    fn broken_lines_say_what_was_expected() {
        let text = format!("{HEADING}x;RX;0x1;0\n1;XX;0x1;0\n1;RX;0x20000000;0\n1;RX;0x1;9\n1;RX;0x1;1;\n");
        let items = read_capture(text.as_bytes()).items;
        let expected = ["time", "direction", "identifier", "length", "data"];
        let items: Vec<_> = items.iter().filter(|item| item.starts_with("line ")).collect();
        assert_eq!(items.len(), expected.len());
        for (item, part) in items.iter().zip(expected) {
            assert!(item.contains(&format!(": {part}: expected")), "{item}");
        }
    }
}
