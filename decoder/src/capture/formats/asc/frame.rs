//! Data and remote frames of ASC captures.
//!
//! ```text
//! 123x            Rx   d 8 05 0C 00 00 00 00 00 00  Length = 240015 BitCount = 124 ID = 291x
//! 123             Tx   r 8
//! Rx  30a  Name  1 0 8  8 11 C2 03 04 05 06 07 08   102203  133   303000 e0006659 …     after CANFD
//!     ID   name BRS ESI DLC length data             duration bits flags  checksum
//! ```
//!
//! `CANFD` means that the channel supports FD. The flags determine whether the frame is an FD frame.

use crate::capture::text::columns::{ColumnWords, NumberBase, parse_data, parse_identifier};
use crate::frame::{CanId, Frame, FrameFlags, MAX_DATA, fd_length, is_fd_length};

/// Flag of an FD line: a remote frame.
const REMOTE_FLAG: u32 = 1 << 4;

/// Flag of an FD line: an FD frame (formerly called extended data length).
const FD_FLAG: u32 = 1 << 12;

const SHORT: &str = "data: number of bytes differs from the length";
const DIRECTION: &str = "direction: expected Rx or Tx";
const LENGTH: &str = "length: expected a valid length of the frame type";
const IDENTIFIER: &str = "identifier: expected up to 7FF, or up to 1FFFFFFF followed by x";

/// A frame, or `None` for a request to send one.
type ParsedFrame = Result<Option<Frame>, &'static str>;

/// Meaning of the direction word.
#[derive(Debug, Clone, Copy)]
enum AscDirection {
    /// A frame on the bus.
    Frame(FrameFlags),
    /// A request to send a frame.
    Request,
}

/// Direction words, compared without regard to case.
const DIRECTIONS: &[(&[u8], AscDirection)] = &[
    (b"Rx", AscDirection::Frame(FrameFlags::RECEIVED)),
    (b"Tx", AscDirection::Frame(FrameFlags::TRANSMITTED)),
    (b"TxRq", AscDirection::Request),
];

fn parse_direction(word: &[u8]) -> Option<AscDirection> {
    DIRECTIONS.iter().find(|(known, _)| word.eq_ignore_ascii_case(known)).map(|(_, direction)| *direction)
}

/// Parses `123` or `18FEF100x`.
fn can_id(word: &[u8], base: NumberBase) -> Option<CanId> {
    let (digits, extended) = match word {
        [digits @ .., b'x' | b'X'] => (digits, true),
        digits => (digits, false),
    };
    parse_identifier(base.parse_number(digits)?, extended)
}

/// The identifier, or if a name replaces it, the decimal number after `ID =`.
fn classic_id(word: &[u8], base: NumberBase, mut line: ColumnWords<'_>) -> Option<CanId> {
    can_id(word, base).or_else(|| {
        line.find(|word| *word == b"ID")?;
        line.next().filter(|word| *word == b"=")?;
        can_id(line.next()?, NumberBase::Decimal)
    })
}

/// Parses a frame after its channel. `line` is a copy of the words, used to find the fields at the end.
pub(super) fn parse_classic(
    mut words: ColumnWords<'_>,
    base: NumberBase,
    line: ColumnWords<'_>,
) -> ParsedFrame {
    let id = words.next().unwrap_or_default();
    let way = parse_direction(words.next().unwrap_or_default()).ok_or(DIRECTION)?;
    let AscDirection::Frame(flags) = way else { return Ok(None) };
    let id = classic_id(id, base, line).ok_or(IDENTIFIER)?;
    let frame = Frame { id, flags, ..Frame::EMPTY };
    match words.next() {
        Some(b"r" | b"R") => Ok(Some(parse_remote(frame, &words, base))),
        Some(b"d" | b"D") => parse_payload(frame, words, base).map(Some),
        _ => Err("frame type: expected d or r"),
    }
}

/// Parses a remote frame; older files have no length.
fn parse_remote(frame: Frame, words: &ColumnWords<'_>, base: NumberBase) -> Frame {
    let dlc = words.peek().and_then(|word| base.parse_byte(word)).filter(|dlc| *dlc <= 15).unwrap_or(0);
    with_dlc(Frame { flags: frame.flags.with(FrameFlags::REMOTE), ..frame }, dlc)
}

/// Sets the DLC of a classic frame, which has at most eight bytes.
fn with_dlc(frame: Frame, dlc: u8) -> Frame {
    Frame { length: dlc.min(8), raw_dlc: if dlc > 8 { dlc } else { 0 }, ..frame }
}

/// Parses the data of a classic line.
///
/// Some programs write FD frames in this form too. The number before the data is then the DLC in the base of
/// the file, the DLC in decimal in spite of base hex, or the length. The number of bytes on the line
/// determines which; python-can cuts all of these to eight bytes.
fn parse_payload(frame: Frame, mut words: ColumnWords<'_>, base: NumberBase) -> Result<Frame, &'static str> {
    let number = words.next().ok_or(LENGTH)?;
    let there = words.clone().take(MAX_DATA).take_while(|word| base.parse_byte(word).is_some()).count();
    let readings = [base.parse_byte(number), NumberBase::Decimal.parse_byte(number)];
    let lengths = || readings.iter().flatten().flat_map(|number| readings_of(*number));
    let exact = lengths().find(|(length, _, _)| usize::from(*length) == there);
    // Extra bytes are accepted only if the number has a single meaning.
    let enough = || lengths().find(|(length, dlc, fd)| usize::from(*length) <= there && *dlc == 0 && !fd);
    if lengths().next().is_none() {
        return Err(LENGTH);
    }
    let (length, raw_dlc, fd) = exact.or_else(enough).ok_or(SHORT)?;
    let flags = if fd { frame.flags.with(FrameFlags::FD) } else { frame.flags };
    let bytes = parse_data(words, usize::from(length), base).ok_or(SHORT)?;
    Ok(Frame { flags, length, raw_dlc, bytes, ..frame })
}

/// Possible meanings of the number before the data: length, DLC and whether the frame is FD.
fn readings_of(number: u8) -> impl Iterator<Item = (u8, u8, bool)> {
    let as_length = (number > 15 && is_fd_length(number)).then_some((number, 0, true));
    let as_dlc = (9..=15).contains(&number).then_some((fd_length(number), 0, true));
    let classic = match number {
        0..=8 => Some((number, 0, false)),
        9..=15 => Some((8, number, false)),
        _ => None,
    };
    [as_length, as_dlc, classic].into_iter().flatten()
}

/// Parses a frame on an FD channel, after the channel number.
pub(super) fn on_fd_channel(mut words: ColumnWords<'_>, base: NumberBase) -> ParsedFrame {
    let first = words.next().unwrap_or_default();
    let second = words.next().unwrap_or_default();
    // Old files have the identifier before the direction.
    let (way, id) = match parse_direction(first) {
        Some(way) => (way, second),
        None => (parse_direction(second).ok_or(DIRECTION)?, first),
    };
    let AscDirection::Frame(mut flags) = way else { return Ok(None) };
    if !matches!(words.peek(), Some(b"0" | b"1")) {
        // Name of the message; it does not begin with a digit.
        words.next();
    }
    for flag in [FrameFlags::BIT_RATE_SWITCH, FrameFlags::ERROR_STATE] {
        match words.next() {
            Some(b"1") => flags = flags.with(flag),
            Some(b"0") => {}
            _ => return Err("bit rate switch, error state: expected 0 or 1"),
        }
    }
    let (dlc, length) = fd_lengths(&mut words).filter(|(_, length)| is_fd_length(*length)).ok_or(LENGTH)?;
    let base = fd_base(&words, length, base);
    let id = can_id(id, base).ok_or(IDENTIFIER)?;
    let bytes = parse_data(words.clone(), length.into(), base).ok_or(SHORT)?;
    // Duration and number of bits precede the flags. Flags of 0 mean that no flags were recorded.
    let marks = words.nth(usize::from(length) + 2).and_then(|word| NumberBase::Hex.parse_number(word));
    let marks = marks.filter(|marks| *marks != 0);
    let frame = Frame { id, flags, length, bytes, ..Frame::EMPTY };
    Ok(Some(kind_of_fd_line(frame, dlc, marks)))
}

/// Parses DLC (hex, or decimal above 9) and length (decimal); in old files `d` or `r` precedes them.
fn fd_lengths(words: &mut ColumnWords<'_>) -> Option<(u8, u8)> {
    let pair = |words: &mut ColumnWords<'_>| {
        let digits = words.next()?;
        let dlc = if digits.len() == 1 {
            NumberBase::Hex.parse_byte(digits)
        } else {
            NumberBase::Decimal.parse_byte(digits)
        };
        let length = NumberBase::Decimal.parse_byte(words.next()?)?;
        dlc.filter(|dlc| *dlc <= 15 && usize::from(length) <= MAX_DATA).map(|dlc| (dlc, length))
    };
    let has_kind = matches!(words.peek(), Some(b"d" | b"r"));
    let mut behind = words.clone();
    behind.next();
    let found = pair(words);
    let fits = |(dlc, length): &(u8, u8)| *length == 0 || fd_length(*dlc) == *length;
    if !has_kind || found.as_ref().is_some_and(fits) {
        return found;
    }
    *words = behind;
    pair(words)
}

/// Base of the data in an FD line. Vector's programs write hex even if the base is decimal: always two digits
/// per byte, which is unlikely in decimal data.
fn fd_base(words: &ColumnWords<'_>, length: u8, base: NumberBase) -> NumberBase {
    let all_pairs = words.clone().take(length.into()).all(|word| word.len() == 2);
    if all_pairs { NumberBase::Hex } else { base }
}

/// Sets the frame type from the flags of an FD line; without flags the word `CANFD` decides.
fn kind_of_fd_line(frame: Frame, dlc: u8, marks: Option<u32>) -> Frame {
    let switched = FrameFlags::BIT_RATE_SWITCH.0 | FrameFlags::ERROR_STATE.0;
    let marked = |flag| marks.is_some_and(|marks| marks & flag != 0);
    // FD has no remote frames, so a remote frame is a classic frame on an FD channel.
    if marked(REMOTE_FLAG) || (frame.length == 0 && dlc > 0) {
        let flags = FrameFlags(frame.flags.0 & !switched).with(FrameFlags::REMOTE);
        return with_dlc(Frame { flags, bytes: [0; MAX_DATA], ..frame }, dlc);
    }
    let is_classic =
        marks.is_some() && !marked(FD_FLAG) && frame.flags.0 & switched == 0 && frame.length <= 8;
    if is_classic {
        return Frame { raw_dlc: if dlc > 8 && frame.length == 8 { dlc } else { 0 }, ..frame };
    }
    Frame { flags: frame.flags.with(FrameFlags::FD), ..frame }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn classic_in(line: &str, base: NumberBase) -> Result<Frame, &'static str> {
        let words = ColumnWords::new(line.as_bytes());
        parse_classic(words.clone(), base, words).map(Option::unwrap)
    }

    fn fd(line: &str) -> Frame {
        on_fd_channel(ColumnWords::new(line.as_bytes()), NumberBase::Hex).unwrap().unwrap()
    }

    fn bytes(count: usize) -> String {
        " 5A".repeat(count)
    }

    #[test]
    fn classic_frames_in_both_bases() {
        let hex =
            classic_in("18EBFF00x  Rx d 3 01 A0 0F  Length = 273910 BitCount = 141 ID = 1x", NumberBase::Hex);
        let decimal = classic_in("418119424x Rx d 3   1 160  15", NumberBase::Decimal);
        assert_eq!(hex, decimal);
        let frame = hex.unwrap();
        assert_eq!(frame.id, CanId::Extended(0x18EB_FF00));
        assert_eq!((frame.data(), frame.flags), (&[1, 0xA0, 0x0F][..], FrameFlags::RECEIVED));
        assert_eq!(classic_in("7FF Tx d 0", NumberBase::Hex).unwrap().flags, FrameFlags::TRANSMITTED);
    }

    #[test]
    fn a_name_is_replaced_by_the_number_at_the_end() {
        let line = "EngineData Rx d 1 05  Length = 1 BitCount = 60 ID = 418119424x";
        assert_eq!(classic_in(line, NumberBase::Hex).unwrap().id, CanId::Extended(0x18EB_FF00));
        assert_eq!(classic_in("EngineData Rx d 1 05", NumberBase::Hex), Err(IDENTIFIER));
    }

    #[test]
    fn the_number_of_bytes_tells_what_the_length_means() {
        for (number, count, length, raw_dlc, is_fd) in [
            ("8", 8, 8, 0, false),
            ("D", 8, 8, 13, false),
            ("9", 12, 12, 0, true),
            ("10", 16, 16, 0, true),
            ("14", 48, 48, 0, true),
            ("14", 20, 20, 0, true),
            ("15", 64, 64, 0, true),
            ("40", 64, 64, 0, true),
            ("F", 64, 64, 0, true),
        ] {
            let frame = classic_in(&format!("123 Rx d {number}{}", bytes(count)), NumberBase::Hex).unwrap();
            let found = (frame.data().len(), frame.raw_dlc, frame.flags.contains(FrameFlags::FD));
            assert_eq!(found, (length, raw_dlc, is_fd), "{number} before {count} bytes");
        }
    }

    #[test]
    fn remote_frames_with_and_without_length() {
        for (line, length) in
            [("100 Rx r", 0), ("200 Tx r Length = 1704000 BitCount = 145", 0), ("300 Rx r 8", 8)]
        {
            let frame = classic_in(line, NumberBase::Hex).unwrap();
            assert!(frame.flags.contains(FrameFlags::REMOTE), "{line}");
            assert_eq!((frame.length, frame.data().len()), (length, 0), "{line}");
        }
    }

    #[test]
    fn fd_lines_with_and_without_a_name() {
        let named = fd("Rx 30a  Name_12  1 1 8  8 01 02 03 04 05 06 07 08   102203  133   303000 e0006659");
        let nameless = fd("Rx 30a  1 1 8 8 01 02 03 04 05 06 07 08");
        let early = fd("30a Rx 1 1 d 8 8 01 02 03 04 05 06 07 08");
        assert_eq!((nameless, early), (named, named));
        let expected = FrameFlags::FD.with(FrameFlags::BIT_RATE_SWITCH).with(FrameFlags::ERROR_STATE);
        assert_eq!(named.flags, expected.with(FrameFlags::RECEIVED));
        let long = fd(&format!("Tx 4EE 0 0 f 64{} 1331984 11 0", bytes(64)));
        assert_eq!((long.data().len(), long.flags.contains(FrameFlags::FD)), (64, true));
        let thirty_two = fd(&format!("Rx f6 Motor_55 1 0 d 32{}", bytes(32)));
        assert_eq!(thirty_two.data().len(), 32);
    }

    #[test]
    fn fd_lines_with_classic_frames() {
        let frame = fd("Rx 750 0 0 8 8 01 02 03 04 05 06 07 08 244000 126 200000 7e04 51200550 4b140250");
        assert!(frame.flags.is_classic_data());
        let unmarked = fd("Rx 750 0 0 2 2 01 02 0 0 0 0 0");
        assert!(unmarked.flags.contains(FrameFlags::FD));
        let frame = fd("Tx 50005x 0 0 5 0 140000 73 200050 7a60 46500250");
        assert_eq!(frame.flags, FrameFlags::REMOTE.with(FrameFlags::TRANSMITTED));
        assert_eq!((frame.length, frame.id), (5, CanId::Extended(0x50005)));
    }

    #[test]
    fn fd_lines_are_hex_in_decimal_files() {
        let line = "Rx a8 Motor_12 1 0 3 3 ad 69 1e 102031 130 323000 b0011297";
        let frame = on_fd_channel(ColumnWords::new(line.as_bytes()), NumberBase::Decimal).unwrap().unwrap();
        assert_eq!((frame.id, frame.data()), (CanId::Standard(0xA8), &[0xAD, 0x69, 0x1E][..]));
        let line = "Rx 168 1 0 3 3 173 105 30";
        let decimal = on_fd_channel(ColumnWords::new(line.as_bytes()), NumberBase::Decimal).unwrap().unwrap();
        assert_eq!(decimal, Frame { flags: decimal.flags, ..frame });
    }

    #[test]
    fn broken_lines_say_what_was_expected() {
        for (line, part) in [
            ("100 Xx d 0", DIRECTION),
            ("800 Rx d 0", IDENTIFIER),
            ("20000000x Rx d 0", IDENTIFIER),
            ("100 Rx q 0", "frame type: expected d or r"),
            ("100 Rx d", LENGTH),
            ("100 Rx d 99 00", LENGTH),
            ("100 Rx d 4 00 00", SHORT),
            ("100 Rx d 9 00 01 02 03 04 05 06 07 08 09 0A", SHORT),
        ] {
            assert_eq!(classic_in(line, NumberBase::Hex), Err(part), "{line}");
        }
        for (line, part) in [
            ("Rx 100 1 2 8 8", "bit rate switch, error state: expected 0 or 1"),
            ("Rx 100 1 0 8 65", LENGTH),
            ("Rx 100 1 0 8 8 00", SHORT),
        ] {
            assert_eq!(
                on_fd_channel(ColumnWords::new(line.as_bytes()), NumberBase::Hex),
                Err(part),
                "{line}"
            );
        }
    }
}
