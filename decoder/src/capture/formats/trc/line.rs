//! One line of a PEAK capture, split into the columns of its version or of `$COLUMNS`.
//!
//! ```text
//! N     O             T  B I        d  R L    D
//! 1     17535.400     DT 1 00000100 Tx -  8   00 00 00 00 00 00 00 00     2.1
//! 7     1334.522      ER            Rx        04 00 02 00 00              2.0: empty columns
//! 2)    17540.3       Warng  FFFFFFFF     4   00 00 00 08  BUSHEAVY       1.1
//! ```

use crate::capture::bus_error::{self, ControllerState, Counters, Violation};
use crate::capture::text::columns::{ColumnWords, NumberBase, parse_data, parse_identifier, parse_time};
use crate::frame::{CanId, Frame, FrameFlags, MAX_DATA, fd_length};

/// Unit of time offsets in nanoseconds.
const MILLISECOND: i64 = 1_000_000;

/// Identifier of lines with a bus state, up to version 1.3.
const STATUS_ID: &[u8] = b"FFFFFFFF";

/// Versions and their columns; `$COLUMNS` overrides those of 2.x. Version 1.0 has no `$FILEVERSION`.
pub(in crate::capture::formats) const LAYOUTS: &[(&str, &[u8])] = &[
    ("1.0", b"NOILD"),
    ("1.1", b"NOTILD"),
    ("1.2", b"NOBTILD"),
    ("1.3", b"NOBTIRLD"),
    ("2.0", b"NOTIdlD"),
    ("2.1", b"NOTBIdRLD"),
];

/// Types of lines with frames. Up to 1.3 the type is the direction.
const FRAME_TYPES: &[(&[u8], FrameFlags)] = &[
    (b"DT", FrameFlags(0)),
    (b"Rx", FrameFlags::RECEIVED),
    (b"Tx", FrameFlags::TRANSMITTED),
    (b"RR", FrameFlags::REMOTE),
    (b"FD", FrameFlags::FD),
    (b"FB", FrameFlags::FD.with(FrameFlags::BIT_RATE_SWITCH)),
    (b"FE", FrameFlags::FD.with(FrameFlags::BIT_RATE_SWITCH).with(FrameFlags::ERROR_STATE)),
    (b"BI", FrameFlags::FD.with(FrameFlags::ERROR_STATE)),
];

/// Error types in the numbering of PEAK's drivers. "Other" includes CRC and acknowledgement errors.
const VIOLATIONS: &[(u32, Violation)] =
    &[(1, Violation::Bit), (2, Violation::Form), (4, Violation::Stuff), (8, Violation::Other)];

/// Status bits, the most severe first. "Heavy" and "light" are limits of the error counters, which
/// differ between PEAK's interfaces; both are at or above the controller's warning limit.
const STATES: &[(u32, ControllerState)] = &[
    (0x0000_0010, ControllerState::BusOff),
    (0x0004_0000, ControllerState::Passive),
    (0x0000_0008, ControllerState::Warning),
    (0x0000_0004, ControllerState::Warning),
    (OVERRUN, ControllerState::Overrun),
];

/// Status bits for lost frames: the controller, or the driver's queue, was read too late.
const OVERRUN: u32 = 0x0000_0042;

/// Content of a line.
#[derive(Debug, PartialEq, Eq)]
pub(in crate::capture::formats) enum TrcLine<'a> {
    /// A frame, or a bus report converted to an error frame.
    Frame(TrcFrameLine<'a>),
    /// An event that the user entered.
    Nothing,
}

/// A frame, without the properties that depend on its position in the capture.
#[derive(Debug, PartialEq, Eq)]
pub(in crate::capture::formats) struct TrcFrameLine<'a> {
    /// Nanoseconds since the start of the capture.
    pub(in crate::capture::formats) offset: i64,
    /// Bus name.
    pub(in crate::capture::formats) bus: &'a [u8],
    /// The frame, without number, time and bus.
    pub(in crate::capture::formats) frame: Frame,
    /// Whether the line reports lost frames.
    pub(in crate::capture::formats) lost: bool,
}

/// The columns of one line; missing columns are empty.
#[derive(Debug, Default)]
struct TrcColumns<'a> {
    offset: &'a [u8],
    kind: &'a [u8],
    bus: &'a [u8],
    id: &'a [u8],
    direction: &'a [u8],
    length: &'a [u8],
    is_dlc: bool,
    data: ColumnWords<'a>,
}

impl<'a> TrcColumns<'a> {
    fn split_columns(layout: &[u8], line: &'a [u8]) -> Self {
        let mut words = ColumnWords::new(line);
        let mut columns = Self::default();
        for column in layout {
            if *column == b'D' {
                columns.data = words;
                break;
            }
            let word = words.next().unwrap_or_default();
            match column {
                b'O' => columns.offset = word,
                b'T' => columns.kind = word,
                b'B' => columns.bus = word,
                b'I' => columns.id = word,
                b'd' => columns.direction = word,
                b'l' => columns.length = word,
                b'L' => (columns.length, columns.is_dlc) = (word, true),
                // N is the line number, R is reserved.
                _ => {}
            }
        }
        columns
    }
}

/// Parses a line other than a comment; the error contains the expected content.
pub(in crate::capture::formats) fn parse_line<'a>(
    layout: &[u8],
    line: &'a [u8],
) -> Result<TrcLine<'a>, &'static str> {
    let columns = TrcColumns::split_columns(layout, line);
    let offset = parse_time(columns.offset, MILLISECOND)
        .ok_or("time offset: expected milliseconds, such as 12.345")?;
    let Some((frame, lost)) = parse_content(&columns, line)? else { return Ok(TrcLine::Nothing) };
    let bus = if columns.bus.is_empty() { b"1" } else { columns.bus };
    Ok(TrcLine::Frame(TrcFrameLine { offset, bus, frame, lost }))
}

/// Parses the frame of a line, and whether the line reports lost frames.
fn parse_content(columns: &TrcColumns<'_>, line: &[u8]) -> Result<Option<(Frame, bool)>, &'static str> {
    let has_type = !columns.kind.is_empty();
    let words = columns.data.clone();
    let report = match columns.kind {
        b"EV" => return Ok(None),
        b"ER" => last_bytes::<5>(line)
            .and_then(|[kind, rest @ ..]| error_frame(kind.into(), rest))
            .map(plain_frame),
        b"EC" => last_bytes(line)
            .map(|[receive, transmit]| Counters { receive, transmit })
            .map(|counters| plain_frame(bus_error::counter_frame(counters))),
        b"ST" => last_bytes(line).map(parse_status),
        b"Warng" => first_bytes(words).map(parse_status),
        b"Error" => old_error(columns.id, words),
        _ if !has_type && columns.id == STATUS_ID => first_bytes(words).map(parse_status),
        _ if !has_type && columns.data.peek() == Some(b"ERROR") => old_error(columns.id, words.skip(1)),
        _ => return parse_frame(columns).map(|frame| Some((frame, false))),
    };
    report.map(Some).ok_or("error or status: expected 2, 4 or 5 data bytes")
}

fn plain_frame(frame: Frame) -> (Frame, bool) {
    (frame, false)
}

/// Parses an error line up to version 1.3, whose identifier is the error type.
fn old_error<'a>(id: &[u8], words: impl Iterator<Item = &'a [u8]>) -> Option<(Frame, bool)> {
    error_frame(NumberBase::Hex.parse_number(id)?, first_bytes(words)?).map(plain_frame)
}

/// Error frame from an error type, direction (0 = transmitting), segment code of the SJA1000, and both
/// counters.
fn error_frame(kind: u32, [direction, place, receive, transmit]: [u8; 4]) -> Option<Frame> {
    let (_, kind) = VIOLATIONS.iter().find(|(code, _)| *code == kind)?;
    let counters = Counters { receive, transmit }.of_error();
    Some(bus_error::violation_frame(*kind, direction == 0, place & 0x1F, counters))
}

/// Parses a status of four bytes, most significant first. Without a known bit the state is error active.
fn parse_status(bytes: [u8; 4]) -> (Frame, bool) {
    let status = u32::from_be_bytes(bytes);
    let state = STATES.iter().find(|(bits, _)| status & bits != 0);
    let state = state.map_or(ControllerState::Active, |(_, state)| *state);
    (bus_error::controller_frame(state), status & OVERRUN != 0)
}

fn first_bytes<'a, const N: usize>(words: impl Iterator<Item = &'a [u8]>) -> Option<[u8; N]> {
    parse_data(words, N, NumberBase::Hex)?.first_chunk().copied()
}

/// The last words of a line as bytes. Lines of errors and states leave columns empty, so only the end of the
/// line has a fixed position.
fn last_bytes<const N: usize>(line: &[u8]) -> Option<[u8; N]> {
    let skipped = ColumnWords::new(line).count().checked_sub(N)?;
    first_bytes(ColumnWords::new(line).skip(skipped))
}

fn parse_frame(columns: &TrcColumns<'_>) -> Result<Frame, &'static str> {
    const SHORT: &str = "data: fewer bytes than the length";
    let mut flags = match FRAME_TYPES.iter().find(|(kind, _)| *kind == columns.kind) {
        Some((_, flags)) => *flags,
        None if columns.kind.is_empty() => FrameFlags(0),
        None => return Err("type: expected Rx, Tx, DT, RR, FD, FB, FE, BI, ER, EC, ST, EV, Error or Warng"),
    };
    if matches!(columns.direction, b"Rx" | b"Tx") {
        let sent = columns.direction == b"Tx";
        flags = flags.with(if sent { FrameFlags::TRANSMITTED } else { FrameFlags::RECEIVED });
    }
    let id = can_id(columns.id).ok_or("identifier: expected 4 hex digits up to 07FF or 8 up to 1FFFFFFF")?;
    if columns.data.peek() == Some(b"RTR") {
        flags = flags.with(FrameFlags::REMOTE);
    }
    let (length, raw_dlc) =
        parse_length(columns, flags).ok_or("length: expected a valid length of the frame type")?;
    let count = if flags.contains(FrameFlags::REMOTE) { 0 } else { usize::from(length) };
    let bytes = parse_data(columns.data.clone(), count, NumberBase::Hex).ok_or(SHORT)?;
    Ok(Frame { id, flags, length, raw_dlc, bytes, ..Frame::EMPTY })
}

/// Four digits are a base identifier, eight an extended one; the length is the only difference.
fn can_id(digits: &[u8]) -> Option<CanId> {
    parse_identifier(NumberBase::Hex.parse_number(digits)?, digits.len() > 4)
}

/// Length in bytes, and the DLC of a classic frame if above 8.
fn parse_length(columns: &TrcColumns<'_>, flags: FrameFlags) -> Option<(u8, u8)> {
    let number = NumberBase::Decimal.parse_byte(columns.length)?;
    let is_fd = flags.contains(FrameFlags::FD);
    match number {
        0..=8 => Some((number, 0)),
        9..=15 if columns.is_dlc && is_fd => Some((fd_length(number), 0)),
        9..=15 if columns.is_dlc => Some((8, number)),
        _ if !columns.is_dlc && is_fd && usize::from(number) <= MAX_DATA => Some((number, 0)),
        _ => None,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn layout(version: &str) -> &'static [u8] {
        LAYOUTS.iter().find(|(known, _)| *known == version).unwrap().1
    }

    fn read(version: &str, line: &'static str) -> TrcFrameLine<'static> {
        match parse_line(layout(version), line.as_bytes()) {
            Ok(TrcLine::Frame(found)) => found,
            other => panic!("{line}: {other:?}"),
        }
    }

    #[test]
    fn a_data_frame_in_every_version() {
        for (version, line, offset, sent) in [
            ("1.0", "     1)      1841      0601  2  40 18", 1_841_000_000, 0),
            ("1.1", "     3)      1298.9  Tx         0601  2  40 18", 1_298_900_000, 0x20),
            ("1.2", "     3)      1298.945  1  Tx         0601  2  40 18", 1_298_945_000, 0x20),
            ("1.3", "     3)      1298.945 1  Tx        0601 -  2    40 18", 1_298_945_000, 0x20),
            ("2.0", "      3      1298.945 DT     0601 Tx 2  40 18", 1_298_945_000, 0x20),
            ("2.1", "      3      1298.945 DT 1      0601 Tx -  2    40 18", 1_298_945_000, 0x20),
        ] {
            let found = read(version, line);
            assert_eq!((found.offset, found.bus), (offset, &b"1"[..]), "{line}");
            assert_eq!(found.frame.id, CanId::Standard(0x601), "{line}");
            assert_eq!(found.frame.data(), [0x40, 0x18], "{line}");
            assert_eq!(found.frame.flags, FrameFlags(sent), "{line}");
        }
    }

    #[test]
    fn four_digits_are_standard_and_eight_extended() {
        assert_eq!(read("1.0", "1) 1 00000100 0").frame.id, CanId::Extended(0x100));
        assert_eq!(read("1.0", "1) 1 0100 0").frame.id, CanId::Standard(0x100));
        assert!(parse_line(layout("1.0"), b"1) 1 0800 0").is_err());
        assert!(parse_line(layout("1.0"), b"1) 1 20000000 0").is_err());
    }

    #[test]
    fn remote_frames_have_a_length_and_no_data() {
        for (version, line) in
            [("1.1", "     6)       234.7  Rx         070A  1  RTR"), ("2.0", "12 48937.600 RR 070A Rx 1")]
        {
            let frame = read(version, line).frame;
            assert!(frame.flags.contains(FrameFlags::REMOTE.with(FrameFlags::RECEIVED)), "{line}");
            assert_eq!((frame.length, frame.data()), (1, &[] as &[u8]), "{line}");
        }
    }

    #[test]
    fn fd_frames_count_in_bytes_or_in_dlc() {
        let line = "5 1334.416 FB 0500 Tx 12 01 02 03 04 05 06 07 08 09 0A 0B 0C";
        let by_length = read("2.0", line).frame;
        let line = "5 1334.416 FB 2 0500 Tx - 9 01 02 03 04 05 06 07 08 09 0A 0B 0C";
        let by_dlc = read("2.1", line);
        assert_eq!(by_dlc.frame, by_length);
        assert_eq!(by_dlc.bus, b"2");
        assert_eq!(by_length.data().len(), 12);
        assert!(by_length.flags.contains(FrameFlags::FD.with(FrameFlags::BIT_RATE_SWITCH)));
        let line = "5 1334.416 BI 2 0500 Tx - 0";
        assert!(read("2.1", line).frame.flags.contains(FrameFlags::FD.with(FrameFlags::ERROR_STATE)));
        let classic = read("2.1", "5 1.0 DT 1 0500 Rx - 13 01 02 03 04 05 06 07 08").frame;
        assert_eq!((classic.length, classic.raw_dlc), (8, 13));
    }

    #[test]
    fn errors_of_both_generations_read_alike() {
        let old = read("1.1", "     6)      1349.2  Error      0008  4  00 19 08 08").frame;
        let older = read("1.0", "     2)      1842      0008  4  ERROR 00 19 08 08").frame;
        let new = read("2.1", "6 1334.222 ER 1         - Rx -  5    08 00 19 08 08").frame;
        assert_eq!(old.id, CanId::Extended(0x2A8), "no acknowledgement, at its slot, while sending");
        assert_eq!(old.data(), [0, 0, 0x80, 0x19, 0, 0, 8, 8]);
        assert_eq!((older, new), (old, old));
        let stuff = read("2.0", "      6      1334.522 ER          Rx    04 01 02 00 00").frame;
        assert_eq!((stuff.id, stuff.data()), (CanId::Extended(0x088), &[0, 0, 4, 2, 0, 0, 0, 0][..]));
    }

    #[test]
    fn states_of_the_bus_are_controller_errors() {
        for (version, line) in [
            ("1.0", "     2)     17540  FFFFFFFF  4  00 00 00 08 -- -- -- -- BUSHEAVY"),
            ("1.3", "     2)     17540.300 1  Warng FFFFFFFF -  4    00 00 00 08 BUSHEAVY"),
            ("2.0", "      2     17540.300 ST          Rx    00 00 00 08"),
            ("2.1", "      2     17540.300 ST 1         - Rx -  4    00 00 00 08"),
        ] {
            let found = read(version, line);
            assert_eq!(found.frame.id, CanId::Extended(0x004), "{line}");
            assert_eq!((found.frame.data()[1], found.lost), (0x0C, false), "{line}");
        }
        assert_eq!(read("2.0", "2 1.0 ST Rx 00 00 00 10").frame.id, CanId::Extended(0x040));
        assert!(read("2.0", "2 1.0 ST Rx 00 00 00 02").lost);
        let counters = read("2.1", "11 1334.643 EC 1         - Rx -  2    02 03").frame;
        assert_eq!((counters.id, counters.data()[6], counters.data()[7]), (CanId::Extended(0x200), 3, 2));
    }

    #[test]
    fn events_of_the_user_are_nothing() {
        let line = b"      8      1334.225 EV -  User-defined event for all busses";
        assert_eq!(parse_line(layout("2.1"), line), Ok(TrcLine::Nothing));
    }

    #[test]
    fn broken_lines_say_what_was_expected() {
        for (line, part) in [
            ("1) x Rx 0100 0", "time offset"),
            ("1) 1.0 Xx 0100 0", "type"),
            ("1) 1.0 Rx 01G0 0", "identifier"),
            ("1) 1.0 Rx 0100 16", "length"),
            ("1) 1.0 Rx 0100", "length"),
            ("1) 1.0 Rx 0100 2 11", "data"),
            ("1) 1.0 Error 0003 4 00 19 08 08", "error"),
            ("1) 1.0 Warng FFFFFFFF 4 00 00", "error or status"),
        ] {
            let reason = parse_line(layout("1.1"), line.as_bytes()).unwrap_err();
            assert!(reason.starts_with(part), "{line}: {reason}");
        }
    }
}
