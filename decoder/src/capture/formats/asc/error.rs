//! Error frames of ASC captures.
//!
//! ```text
//! ErrorFrame
//! ErrorFrame ECC: 10100010                                     register of the SJA1000
//! ErrorFrame Flags = 0xe CodeExt = 0x20a2 Code = 0x82 ID = 0 DLC = 0 Position = 5 Length = 11300
//! Rx   ErrorFrame Stuff Error    fffe 82     20aa Data 104 …   after CANFD; the third number is CodeExt
//! OverloadFrame
//! ```
//!
//! ```text
//! ECC      7 6 error type   5 receiving   4…0 location
//! CodeExt  15…12 direction (1, 3 transmitting)   11…6 error type   5 receiving   4…0 location
//! ```
//!
//! Locations are the SJA1000's segment codes, as in SocketCAN.

use crate::capture::bus_error::{ProtocolViolation, Violation, violation_frame};
use crate::capture::text::columns::{ColumnWords, NumberBase};
use crate::frame::{Frame, FrameFlags};

/// Error types in both codes; an ECC contains the first four.
const KINDS: &[(u32, Violation)] = &[
    (0, Violation::Bit),
    (1, Violation::Form),
    (2, Violation::Stuff),
    (3, Violation::Other),
    (4, Violation::Checksum),
    (5, Violation::AcknowledgeDelimiter),
    (7, Violation::Acknowledgement),
];

/// Start of the text after `ErrorFrame` on FD channels, in lower case.
const TEXTS: &[(&[u8], Violation)] = &[
    (b"bit", Violation::Bit),
    (b"form", Violation::Form),
    (b"stuff", Violation::Stuff),
    (b"crc", Violation::Checksum),
    (b"not acknowledge", Violation::Acknowledgement),
];

/// Names of the frame phase, after `CodeExt`.
const PHASES: &[&[u8]] = &[b"Arb.", b"Data"];

/// Parses the text after the channel; `None` if it is not an error frame.
pub(super) fn parse_error(text: &[u8]) -> Option<Frame> {
    let mut words = ColumnWords::new(text);
    let mut flags = FrameFlags::ERROR;
    match words.peek() {
        Some(b"Rx") => flags = flags.with(FrameFlags::RECEIVED),
        Some(b"Tx") => flags = flags.with(FrameFlags::TRANSMITTED),
        _ => {}
    }
    if flags != FrameFlags::ERROR {
        words.next();
    }
    let first = words.next()?;
    if first.eq_ignore_ascii_case(b"OverloadFrame") {
        let frame = violation_frame(Violation::Overload, false, 0, None);
        return Some(Frame { flags, ..frame });
    }
    first.eq_ignore_ascii_case(b"ErrorFrame").then(|| Frame { flags, ..parse_details(&words) })
}

fn parse_details(words: &ColumnWords<'_>) -> Frame {
    let by_code = error_code_capture(words.clone()).or_else(|| extended_code(words.clone()));
    by_code.unwrap_or_else(|| {
        let text = words.remaining_text().trim_ascii_start().to_ascii_lowercase();
        let kind = TEXTS.iter().find(|(start, _)| text.starts_with(start));
        let kind = kind.map_or(Violation::Other, |(_, kind)| *kind);
        let code = behind_text(words.clone()).unwrap_or(0);
        violation_frame(kind, is_sending(code), segment_place(code), None)
    })
}

/// Parses `ECC: 10100010`.
fn error_code_capture(mut words: ColumnWords<'_>) -> Option<Frame> {
    words.find(|word| *word == b"ECC:")?;
    let digits = words.next().filter(|word| word.len() == 8)?;
    let code = digits.iter().try_fold(0_u32, |code, digit| match digit {
        b'0' | b'1' => Some(code << 1 | u32::from(digit - b'0')),
        _ => None,
    })?;
    Some(violation_frame(violation_kind(code >> 6)?, code & 0x20 == 0, segment_place(code), None))
}

/// Parses `CodeExt = 0x20a2`; decimal if the base of the file is decimal.
fn extended_code(mut words: ColumnWords<'_>) -> Option<Frame> {
    words.find(|word| *word == b"CodeExt")?;
    words.next().filter(|word| *word == b"=")?;
    let code = match words.next()? {
        [b'0', b'x' | b'X', digits @ ..] => NumberBase::Hex.parse_number(digits)?,
        digits => NumberBase::Decimal.parse_number(digits)?,
    };
    let kind = violation_kind(code >> 6 & 0x3F).unwrap_or(Violation::Other);
    Some(violation_frame(kind, is_sending(code), segment_place(code), None))
}

/// The number before the phase, in lines of FD channels.
fn behind_text(words: ColumnWords<'_>) -> Option<u32> {
    let mut last = None;
    for word in words {
        if PHASES.contains(&word) {
            return last.and_then(|word| NumberBase::Hex.parse_number(word));
        }
        last = Some(word);
    }
    None
}

fn violation_kind(code: u32) -> Option<Violation> {
    KINDS.iter().find(|(known, _)| *known == code).map(|(_, kind)| *kind)
}

fn is_sending(code: u32) -> bool {
    matches!(code >> 12 & 3, 1 | 3)
}

fn segment_place(code: u32) -> u8 {
    u8::try_from(code & 0x1F).unwrap_or(0)
}

/// Appends an error frame after its channel, with the protocol violation if known. The direction is part of
/// the code, because other readers accept no direction word here.
pub(super) fn push(line: &mut Vec<u8>, broken: Option<ProtocolViolation>) {
    /// Fields after `CodeExt`, which are unknown; the flag 0x4 marks `CodeExt` as valid.
    const BEHIND_CODE: &str = " Code = 0x0 ID = 0 DLC = 0 Position = 0 Length = 0";
    let (place, sending, kind) = match broken {
        Some(ProtocolViolation { kind: Violation::Overload, .. }) => {
            return line.extend_from_slice(b"OverloadFrame");
        }
        Some(ProtocolViolation { kind, sending, place }) => (place, sending, kind),
        None => (0, false, Violation::Other),
    };
    line.extend_from_slice(b"ErrorFrame");
    if kind == Violation::Other && place == 0 && !sending {
        return;
    }
    let kind = KINDS.iter().find(|(_, known)| *known == kind).map_or(3, |(code, _)| *code);
    let side = if sending { 1 << 12 } else { 2 << 12 | 1 << 5 };
    let code = side | kind << 6 | u32::from(place & 0x1F);
    line.extend_from_slice(format!("\tFlags = 0x4 CodeExt = 0x{code:04X}{BEHIND_CODE}").as_bytes());
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::frame::CanId;

    fn read(text: &str) -> Frame {
        parse_error(text.as_bytes()).unwrap()
    }

    #[test]
    fn a_bare_error_frame_is_an_unspecified_bus_error() {
        let frame = read("ErrorFrame");
        assert_eq!((frame.id, frame.data()), (CanId::Extended(0x088), &[0; 8][..]));
        assert_eq!(frame.flags, FrameFlags::ERROR);
    }

    #[test]
    fn all_codes_agree() {
        let ecc = read("ErrorFrame ECC: 10100010");
        assert_eq!(ecc.data(), [0, 0, 0x04, 0x02, 0, 0, 0, 0], "stuff error at ID.28 to ID.21, receiving");
        let hex =
            "ErrorFrame Flags = 0xe CodeExt = 0x20a2 Code = 0x82 ID = 0 DLC = 0 Position = 5 Length = 11300";
        assert_eq!(read(hex), ecc);
        assert_eq!(read("ErrorFrame\tFlags = 65534\tCodeExt = 8354\tCode = 129\tID = 958"), ecc);
    }

    #[test]
    fn fd_channels_report_errors_as_text() {
        let frame = read("Rx   ErrorFrame Stuff Error    fffe 82     20aa Data 104       f6  1 0 d 32 19 85");
        assert_eq!(frame.data(), [0, 0, 0x04, 0x0A, 0, 0, 0, 0]);
        let frame =
            read("Tx ErrorFrame Not Acknowledge error, dominant error flag fffe c7 31ca Arb. 556 44 0 0");
        assert_eq!(frame.id, CanId::Extended(0x0A8));
        assert_eq!(frame.data(), [0, 0, 0x80, 0x0A, 0, 0, 0, 0]);
        assert!(frame.flags.contains(FrameFlags::TRANSMITTED));
    }

    #[test]
    fn what_is_written_is_read_again() {
        for kind in [
            Violation::Bit,
            Violation::Form,
            Violation::Stuff,
            Violation::Checksum,
            Violation::Acknowledgement,
            Violation::Other,
        ] {
            for (sending, place) in [(false, 0), (true, 0), (false, 0x1F), (true, 0x19)] {
                let mut line = Vec::new();
                push(&mut line, Some(ProtocolViolation { kind, sending, place }));
                let frame = parse_error(&line).unwrap();
                assert_eq!(frame, violation_frame(kind, sending, place, None), "{kind:?} {sending} {place}");
            }
        }
        let mut line = Vec::new();
        push(&mut line, None);
        assert_eq!(line, b"ErrorFrame");
    }

    #[test]
    fn overload_frames_are_a_violation_and_data_frames_none() {
        assert_eq!(read("OverloadFrame").data()[2], 0x20);
        assert_eq!(parse_error(b"123 Rx d 0"), None);
        assert_eq!(parse_error(b"Rx"), None);
    }
}
