//! Output of `isotpdump` (can-utils): frames of ISO-TP with their protocol control information in words.
//!
//! ```text
//!  can0  7E0  [8]  [SF] ln: 3    data: 22 F1 90 00 00 00 00
//!  (1700000000.123456)  can0  7E8  [8]  [FF] ln: 20   data: 62 F1 90 57 30 4C
//!  can0  7E0  [3]  [FC] FC: 0 = CTS # BS: 0 = off # STmin: 0x0A = 10 ms
//!  can0  7E8  [8]  [CF] sn: 1    data: 30 30 30 30 34 33 4D
//!  can0  18DA10F1{F1}  [8]  [SF] …                      extended addressing
//! ```
//!
//! Source: can-utils, isotpdump.c. The bytes before the data are built again from the words (ISO 15765-2 table 9); the
//! program does not print the bytes after a flow control.

use crate::capture::CaptureFormat;
use crate::capture::formats::candump::line::without_colors;
use crate::capture::formats::candump::stamp::leading_stamp;
use crate::capture::text::columns::{ColumnWords, NumberBase, parse_identifier};
use crate::capture::text::evidence::{LineClass, is_proven};
use crate::capture::text::line_format::{CaptureAssumptions, LineFault, LineFormat, LineParser, ParsedLine};
use crate::frame::{CanId, Frame, FrameFlags, MAX_DATA, is_fd_length};

const FILLERS: &str = "bytes after a flow control are not printed by isotpdump, and are missing";

pub(super) const FORMAT: CaptureFormat = CaptureFormat {
    name: "isotpdump",
    title: IsoTpText::TITLE,
    is_text: true,
    is_packed: false,
    detect: |head| {
        is_proven(head, |line| match parse_row(&without_colors(line)) {
            Ok(_) => LineClass::Proof,
            Err(_) => LineClass::Misfit,
        })
    },
    parser: |_| Box::new(LineParser::new(IsoTpText::default())),
};

#[derive(Clone, Default)]
struct IsoTpText {
    bus: Vec<u8>,
}

/// A row: time, interface, frame, and whether bytes are missing.
struct IsoTpRow<'a> {
    time: Option<i64>,
    bus: &'a [u8],
    frame: Frame,
    is_cut: bool,
}

const LENGTH: &str = "length: expected [8], or [12] of CAN FD";
const DATA: &str = "data: expected pairs of hex digits, as many as the length";

fn parse_row(line: &[u8]) -> Result<IsoTpRow<'_>, &'static str> {
    let (rest, (time, _)) = leading_stamp(line).map_err(|_| "timestamp: expected (seconds.fraction)")?;
    let mut words = ColumnWords::new(rest);
    let bus = words.next().ok_or("interface: expected a name")?;
    let (id, extension) = parse_address(words.next().unwrap_or_default())
        .ok_or("identifier: expected hex digits, and an address in braces")?;
    let length = words.next().and_then(|word| word.strip_prefix(b"[")?.strip_suffix(b"]"));
    let length = length.and_then(|digits| NumberBase::Decimal.parse_byte(digits)).ok_or(LENGTH)?;
    let mut bytes: Vec<u8> = extension.into_iter().collect();
    let is_cut = push_control(&mut words, &mut bytes)?;
    // `-a` prints the characters after a dash.
    let data = words.take_while(|word| *word != b"-");
    for word in data.take(MAX_DATA) {
        bytes.push(NumberBase::Hex.parse_byte(word).filter(|_| word.len() == 2).ok_or(DATA)?);
    }
    if bytes.len() > usize::from(length) || !is_cut && bytes.len() < usize::from(length) {
        return Err(DATA);
    }
    if !is_fd_length(length) {
        return Err(LENGTH);
    }
    let flags = if length > 8 { FrameFlags::FD } else { FrameFlags(0) };
    // The shortest length with room for the known bytes.
    let room = (0..=length).find(|room| is_fd_length(*room) && usize::from(*room) >= bytes.len());
    bytes.resize(room.map_or(0, usize::from), 0);
    let is_cut = is_cut && room != Some(length);
    Ok(IsoTpRow { time, bus, frame: Frame { flags, ..Frame::data_frame(id, &bytes) }, is_cut })
}

/// Parses `7E0`, or `18DA10F1{F1}` with an address extension.
fn parse_address(word: &[u8]) -> Option<(CanId, Option<u8>)> {
    let (digits, extension) = match word.iter().position(|byte| *byte == b'{') {
        Some(brace) => {
            let inner = word.get(brace + 1..)?.strip_suffix(b"}")?;
            (word.get(..brace)?, Some(NumberBase::Hex.parse_byte(inner)?))
        }
        None => (word, None),
    };
    let number = NumberBase::Hex.parse_number(digits).filter(|_| digits.len() <= 8)?;
    let id = parse_identifier(number, digits.len() > 3)?;
    Some((id, extension))
}

/// Appends the control bytes that words such as `[FF] ln: 20   data:` state; whether bytes after them are missing.
fn push_control(words: &mut ColumnWords<'_>, bytes: &mut Vec<u8>) -> Result<bool, &'static str> {
    const KIND: &str = "frame type: expected [SF], [FF], [CF] or [FC]";
    let kind = words.next().unwrap_or_default();
    let mut after = |label: &[u8]| words.next().filter(|word| *word == label).and_then(|_| words.next());
    match kind {
        b"[SF]" => {
            let length = after(b"ln:").and_then(|word| NumberBase::Decimal.parse_byte(word)).ok_or(KIND)?;
            match length {
                0..=7 => bytes.push(length),
                _ => bytes.extend([0, length]),
            }
        }
        b"[FF]" => {
            let length = after(b"ln:").and_then(|word| NumberBase::Decimal.parse_number(word)).ok_or(KIND)?;
            let [_, _, high, low] = length.to_be_bytes();
            match length {
                1..=0xFFF => bytes.extend([0x10 | high, low]),
                _ => bytes.extend([&[0x10, 0][..], &length.to_be_bytes()].concat()),
            }
        }
        b"[CF]" => {
            let number = after(b"sn:").and_then(|word| NumberBase::Hex.parse_byte(word)).ok_or(KIND)?;
            bytes.push(0x20 | number & 0x0F);
        }
        b"[FC]" => {
            let status = after(b"FC:").and_then(|word| NumberBase::Decimal.parse_byte(word)).ok_or(KIND)?;
            let mut number = |label: &[u8]| words.by_ref().skip_while(|word| *word != label).nth(1);
            let block = number(b"BS:").and_then(|word| NumberBase::Decimal.parse_byte(word)).ok_or(KIND)?;
            let separation = number(b"STmin:").and_then(|word| word.strip_prefix(b"0x"));
            let separation = separation.and_then(|word| NumberBase::Hex.parse_byte(word)).ok_or(KIND)?;
            bytes.extend([0x30 | status & 0x0F, block, separation]);
            *words = ColumnWords::default();
            return Ok(true);
        }
        _ => return Err(KIND),
    }
    let has_data = words.next() == Some(b"data:");
    if has_data { Ok(false) } else { Err("expected data: after the length or number") }
}

impl LineFormat for IsoTpText {
    const TITLE: &'static str = "isotpdump text";

    fn parse_line<'a>(
        &'a mut self,
        text: &'a [u8],
        assumptions: &mut CaptureAssumptions,
    ) -> Result<Option<ParsedLine<'a>>, LineFault> {
        let plain = without_colors(text);
        let row = parse_row(&plain)?;
        if row.is_cut {
            assumptions.add_assumption(FILLERS);
        }
        self.bus.clear();
        self.bus.extend_from_slice(row.bus);
        Ok(Some(ParsedLine::new(row.time, &self.bus, row.frame)))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::capture::testing::{read_capture, read_in_pieces};

    #[test]
    fn all_kinds_of_frames() {
        let text = " can0  7E0  [8]  [SF] ln: 3    data: 22 F1 90 00 00 00 00 \r\n \
                    (1700000000.123456)  can0  7E8  [8]  [FF] ln: 20   data: 62 F1 90 57 30 4C -  'b..W0L'\r\n \
                    can0  7E0  [8]  [FC] FC: 0 = CTS # BS: 2 # STmin: 0x0A = 10 ms\r\n \
                    can0  7E8  [8]  [CF] sn: A    data: 30 30 30 30 34 33 4D \r\n \
                    can0  18DA10F1{F1}  [4]  [SF] ln: 2    data: 3E 00 \r\n \
                    can0  7E0 [12]  [SF] ln: 9    data: 01 02 03 04 05 06 07 08 09 CC \r\n \
                    can0  7E8  [8]  [FF] ln: 4096 data: 36 01 \r\n";
        let whole = read_capture(text.as_bytes());
        assert_eq!(whole, read_in_pieces(text.as_bytes(), &[7, 2]));
        assert_eq!(
            whole.items,
            [
                "{1} bus0 7E0#0322F19000000000 flags=00 dlc=0",
                "{2} (1700000000.123456000) bus0 7E8#101462F19057304C flags=00 dlc=0",
                FILLERS,
                "{3} bus0 7E0#30020A flags=00 dlc=0",
                "{4} bus0 7E8#2A3030303034334D flags=00 dlc=0",
                "{5} bus0 18DA10F1#F1023E00 flags=00 dlc=0",
                "{6} bus0 7E0#0009010203040506070809CC flags=04 dlc=0",
                "{7} bus0 7E8#1000000010003601 flags=00 dlc=0",
            ]
        );
    }

    #[test]
    fn broken_rows_say_what_was_expected() {
        for (line, expected) in [
            ("can0  7E0  [8]  [??]", "frame type"),
            ("can0  7E0  [8]  [SF] ln: x", "frame type"),
            ("can0  7E0  [8]  [SF] ln: 3    data: 22 F1 90", "data"),
            ("can0  7E0  [3]  [SF] ln: 3    data: 22 F1 90", "data"),
            ("can0  7E0  [4]  [SF] ln: 3    data: 22 F1 9", "data"),
            ("can0  7E0  8  [SF] ln: 3", "length"),
            ("can0  7E0{F  [8]  [SF] ln: 3", "identifier"),
            ("can0  800  [1]  [SF] ln: 0    data:", "identifier"),
            ("can0", "identifier"),
            ("(x) can0", "timestamp"),
        ] {
            let found = parse_row(line.as_bytes()).err().unwrap();
            assert!(found.starts_with(expected), "{line}: {found}");
        }
        for other in ["", "can0  7E0   [8]  03 22 F1 90 00 00 00 00\n", "hello\n"] {
            assert!(!(FORMAT.detect)(other.as_bytes()), "{other}");
        }
    }
}
