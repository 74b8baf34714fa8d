//! Lines with a time in an ASC capture: frames of all types, and other events.

use super::error;
use super::frame;
use crate::capture::text::columns::{ColumnWords, NumberBase, parse_time};
use crate::frame::Frame;

/// Unit of time in nanoseconds.
const SECOND: i64 = 1_000_000_000;

/// First words after the time of events other than frames: measurement events, variables, test steps,
/// positions, comments.
const NO_FRAME: &[&[u8]] = &[
    b"CAN", // `CAN 1 Status:chip status error passive …`
    b"SV:",
    b"GPS-Device:",
    b"Comment:",
    b"GMGroup:",
    b"TFS:",
    b"log",
    b"Trigger",
];

/// First words of frames of other bus systems, and the words after the number of their lines.
const OTHER_BUSES: &[(&[u8], &str)] = &[
    (b"Li", LIN),
    (b"LIN", LIN),
    (b"Fr", "of FlexRay"),
    (b"FR", "of FlexRay"),
    (b"ETH", "of Ethernet"),
    (b"MOST", "of MOST"),
    (b"MS", "of MOST"),
    (b"M50", "of MOST"),
    (b"M150", "of MOST"),
    (b"WLAN", "of WLAN"),
    (b"AFDX", "of AFDX"),
    (b"A429", "of ARINC 429"),
];

/// LIN frames begin with `Li` on the first channel, and with `L2`, `L3`, … on the other channels.
const LIN: &str = "of LIN";

/// Start of the word after a channel in lines about the channel or with repeated data: `Statistic:` has
/// counts, `J1939TP` is a transport message whose frames precede it.
const ABOUT_CHANNEL: &[&[u8]] = &[b"Statistic", b"Status", b"J1939TP", b"OSEKTL", b"LIN"];

/// A line with a time.
#[derive(Debug)]
pub(super) struct AscEvent<'a> {
    /// Time as in the line, in nanoseconds.
    pub(super) stamp: i64,
    /// The event, or the content expected.
    pub(super) content: Result<AscEventContent<'a>, &'static str>,
}

/// Content of a line with a time.
#[derive(Debug, PartialEq, Eq)]
pub(super) enum AscEventContent<'a> {
    /// Channel and frame; number, time and bus of the frame are not set.
    Frame(&'a [u8], Frame),
    /// `Start of measurement`: the date of the block is the zero of the times.
    Start,
    /// A request to send a frame; the transmitted frame has its own line.
    Request,
    /// A frame of another bus system: `of LIN`.
    Foreign(&'static str),
    /// Event without a frame.
    Nothing,
}

/// Parses a line; `None` if it does not begin with a time.
pub(super) fn parse_event(line: &[u8], base: NumberBase) -> Option<AscEvent<'_>> {
    let mut words = ColumnWords::new(line);
    let stamp = words.next().filter(|word| word.contains(&b'.')).and_then(|word| parse_time(word, SECOND))?;
    Some(AscEvent { stamp, content: parse_content(words, base) })
}

fn parse_content(mut words: ColumnWords<'_>, base: NumberBase) -> Result<AscEventContent<'_>, &'static str> {
    let first = words.next().unwrap_or_default();
    let rest = words.clone();
    if first == b"Start" {
        return Ok(AscEventContent::Start);
    }
    // `// comment`, `EnvVar := 1`
    let is_silent = first.starts_with(b"//") || words.peek() == Some(b":=") || NO_FRAME.contains(&first);
    if is_silent {
        return Ok(AscEventContent::Nothing);
    }
    if let Some(system) = foreign_system(first) {
        return Ok(AscEventContent::Foreign(system));
    }
    let is_fd = first.eq_ignore_ascii_case(b"CANFD");
    let channel = if is_fd { words.next().unwrap_or_default() } else { first };
    if first == b"CANXL" {
        return Err("CAN XL frame: not supported");
    }
    if channel.is_empty() || !channel.iter().all(u8::is_ascii_digit) {
        return Err("expected a channel number, CANFD or a known event after the time");
    }
    let about = words.peek().unwrap_or_default();
    if about == b"Start" {
        return Ok(AscEventContent::Start);
    }
    if ABOUT_CHANNEL.iter().any(|start| about.starts_with(start)) {
        return Ok(AscEventContent::Nothing);
    }
    if let Some(frame) = error::parse_error(words.remaining_text()) {
        return Ok(AscEventContent::Frame(channel, frame));
    }
    let frame =
        if is_fd { frame::on_fd_channel(words, base)? } else { frame::parse_classic(words, base, rest)? };
    Ok(frame.map_or(AscEventContent::Request, |frame| AscEventContent::Frame(channel, frame)))
}

fn foreign_system(first: &[u8]) -> Option<&'static str> {
    let lin = first.strip_prefix(b"L").filter(|digits| !digits.is_empty());
    if lin.is_some_and(|digits| digits.iter().all(u8::is_ascii_digit)) {
        return Some(LIN);
    }
    OTHER_BUSES.iter().find(|(word, _)| *word == first).map(|(_, system)| *system)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn content_of(line: &str) -> Result<AscEventContent<'_>, &'static str> {
        parse_event(line.as_bytes(), NumberBase::Hex).unwrap().content
    }

    #[test]
    fn known_events_are_no_frames() {
        for line in [
            "   0.015991 CAN 1 Status:chip status error passive - TxErr: 132 RxErr: 0",
            "   1.015991 1  Statistic: D 0 R 0 XD 0 XR 0 E 0 O 0 B 0.00%",
            "   3.297743 1  J1939TP FEE3p        6    0  0   -   Rx   d 23 A0 0F A6",
            "   3.3 CANFD   1 Statistic: D 0",
            "   1.5 EngineSpeed := 12.5",
            "   1.5 SV: 2 0 1 ::Namespace::Variable = 1",
            "   1.5 log trigger event",
            "   1.5 Comment: 1 text",
        ] {
            assert_eq!(content_of(line), Ok(AscEventContent::Nothing), "{line}");
        }
        for line in ["0.000000 Start of measurement", "0.000000 CANFD 1 Start of measurement"] {
            assert_eq!(content_of(line), Ok(AscEventContent::Start), "{line}");
        }
        assert_eq!(content_of("   0.1 1 291 TxRq d 0"), Ok(AscEventContent::Request));
    }

    #[test]
    fn frames_of_other_bus_systems_are_distinguished_from_can() {
        for (line, system) in [
            ("   0.1 Li 3c Tx     8 01 02 03 04 05 06 07 08  checksum = 7f", "of LIN"),
            ("   0.1 L12 3c Tx 8 01 02 03 04 05 06 07 08", "of LIN"),
            ("   0.1 Fr RMSG  0 0 1 1 1e 0 Rx 0 40 4 8 01 02", "of FlexRay"),
            ("   0.1 ETH  1 Rx 40:FFFFFFFFFFFF020000000001080045", "of Ethernet"),
        ] {
            assert_eq!(content_of(line), Ok(AscEventContent::Foreign(system)), "{line}");
        }
        assert!(content_of("   0.1 Lx 3c Tx 8").is_err());
    }

    #[test]
    fn others_are_unreadable() {
        for line in
            ["   0.1 hello", "   0.1", "   0.1 CANFD", "   0.1 CANXL 1 Rx", "  0.1 1", "  0.1 1 what is it"]
        {
            assert!(content_of(line).is_err(), "{line}");
        }
    }

    #[test]
    fn lines_of_the_header_have_no_time() {
        for line in ["base hex", "// 1.0 x", "-1.0 1 100 Rx d 0", "1 1 100 Rx d 0", ""] {
            assert!(parse_event(line.as_bytes(), NumberBase::Hex).is_none(), "{line}");
        }
    }
}
