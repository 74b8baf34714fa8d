//! Parsers of one pasted row.

use crate::capture::formats::candump::line as candump_line;
use crate::capture::formats::candump::stamp::leading_stamp;
use crate::capture::formats::trc::line as trc_line;
use crate::capture::text::columns::{ColumnWords, NumberBase, time_of_day};
use crate::capture::text::payload::{build_frame, by_length};
use crate::frame::{CanId, Frame, FrameFlags, MAX_DATA};

/// One second in nanoseconds.
const SECOND: i64 = 1_000_000_000;

/// A frame of a row.
#[derive(Debug)]
pub(super) struct ExcerptRow<'a> {
    /// Time in nanoseconds.
    pub(super) time: Option<i64>,
    /// Whether the time is a time of day, which starts again at midnight.
    pub(super) is_time_of_day: bool,
    /// Bus name, if the row states it.
    pub(super) bus: Option<&'a [u8]>,
    /// The frame, without number, time and bus.
    pub(super) frame: Frame,
}

/// A column of a row.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum ExcerptColumn {
    /// A count, not used: `12`, `12)`.
    Number,
    /// Cycle time, not used.
    Cycle,
    /// Seconds with a fraction, or a time of day, with or without parentheses.
    Time,
    /// Bus name.
    Bus,
    /// Identifier of three or more hex digits, with or without 0x or h.
    Id,
    /// Identifier with h: `181h`.
    Hex,
    /// Identifier with a colon: `601:`, `0x601:`.
    Colon,
    /// Rx or Tx.
    Direction,
    /// Frame type: [`KINDS`].
    Kind,
    /// Length in bytes, with or without brackets.
    Length,
    /// Data in pairs of hex digits, as many as the length.
    Data,
}

/// Frame types: word, extended, remote.
const KINDS: &[(&str, Option<bool>, bool)] = &[
    ("SD", Some(false), false),
    ("XD", Some(true), false),
    ("ED", Some(true), false),
    ("SR", Some(false), true),
    ("XR", Some(true), true),
    ("ER", Some(true), true),
    ("S", Some(false), false),
    ("X", Some(true), false),
    ("STD", Some(false), false),
    ("EXT", Some(true), false),
    ("SFF", Some(false), false),
    ("EFF", Some(true), false),
    ("D", None, false),
    ("R", None, true),
    ("DATA", None, false),
    ("RTR", None, true),
];

/// Parses a row of candump without interface, as the same line with an interface.
pub(super) fn parse_candump(row: &[u8]) -> Option<ExcerptRow<'_>> {
    let (rest, _) = leading_stamp(row).ok()?;
    let stamp = row.get(..row.len().checked_sub(rest.len())?)?;
    let whole = [stamp, b"can0 ", rest].concat();
    let Ok(candump_line::CandumpLine::Frame(found)) = candump_line::parse_line(&whole) else { return None };
    let candump_line::CandumpFrameLine { stamp: time, id, flags, length, raw_dlc, bytes, .. } = found;
    let frame = Frame { id, flags, length, raw_dlc, bytes, ..Frame::EMPTY };
    Some(ExcerptRow { time, is_time_of_day: false, bus: None, frame })
}

/// Parses a row of a PEAK TRC capture of this version.
pub(super) fn parse_trc<'a>(row: &'a [u8], version: &str) -> Option<ExcerptRow<'a>> {
    let (_, layout) = trc_line::LAYOUTS.iter().find(|(known, _)| *known == version)?;
    let number = ColumnWords::new(row).next()?;
    let digits = number.strip_suffix(b")").unwrap_or(number);
    let has_bracket = digits.len() < number.len();
    if has_bracket != version.starts_with('1') || !is_number(digits) {
        return None;
    }
    let Ok(trc_line::TrcLine::Frame(found)) = trc_line::parse_line(layout, row) else { return None };
    Some(ExcerptRow {
        time: Some(found.offset),
        is_time_of_day: false,
        bus: Some(found.bus),
        frame: found.frame,
    })
}

/// Parses a message as python-can prints it: `Timestamp: 1.5  ID: 0181  S Rx  DL: 2  40 18  Channel: can0`.
pub(super) fn python_can(row: &[u8]) -> Option<ExcerptRow<'_>> {
    let mut words = ColumnWords::new(row);
    let mut label =
        |expected: &[u8]| words.next().filter(|word| *word == expected).and_then(|_| words.next());
    let (time, _) = parse_time(label(b"Timestamp:")?)?;
    let digits = label(b"ID:")?;
    let (mut flags, mut extended) = (FrameFlags(0), false);
    let length = loop {
        match words.next()? {
            b"S" => {}
            b"X" => extended = true,
            b"Rx" => flags = flags.with(FrameFlags::RECEIVED),
            b"Tx" => flags = flags.with(FrameFlags::TRANSMITTED),
            b"R" => flags = flags.with(FrameFlags::REMOTE),
            b"F" => flags = flags.with(FrameFlags::FD),
            b"BS" => flags = flags.with(FrameFlags::BIT_RATE_SWITCH),
            b"EI" => flags = flags.with(FrameFlags::ERROR_STATE),
            b"DL:" | b"DLC:" => break NumberBase::Decimal.parse_byte(words.next()?)?,
            _ => return None,
        }
    };
    let id = parse_identifier(NumberBase::Hex.parse_number(digits)?, Some(extended))?;
    let frame = build_frame(id, flags, by_length(length, flags)?, words.clone(), NumberBase::Hex)?;
    let bus = words.skip_while(|word| *word != b"Channel:").nth(1);
    Some(ExcerptRow { time: Some(time), is_time_of_day: false, bus, frame })
}

/// Parses a row of these columns; nothing may follow them.
pub(super) fn parse_columns<'a>(row: &'a [u8], columns: &[ExcerptColumn]) -> Option<ExcerptRow<'a>> {
    let mut words = ColumnWords::new(row);
    let mut cells = ExcerptCells::default();
    for column in columns {
        match column {
            ExcerptColumn::Data => cells.parse_data(&mut words)?,
            column => cells.take_column(*column, words.next()?)?,
        }
    }
    words.next().is_none().then_some(())?;
    cells.build_row()
}

/// Parsed columns of a row.
#[derive(Default)]
struct ExcerptCells<'a> {
    time: Option<(i64, bool)>,
    bus: Option<&'a [u8]>,
    id: u32,
    extended: Option<bool>,
    flags: FrameFlags,
    length: Option<u8>,
    data: ColumnWords<'a>,
}

impl<'a> ExcerptCells<'a> {
    fn take_column(&mut self, column: ExcerptColumn, word: &'a [u8]) -> Option<()> {
        match column {
            ExcerptColumn::Number => is_number(word.strip_suffix(b")").unwrap_or(word)).then_some(())?,
            ExcerptColumn::Cycle => {
                crate::capture::text::columns::parse_time(word, SECOND)?;
            }
            ExcerptColumn::Time => self.time = Some(parse_time(word)?),
            ExcerptColumn::Bus => {
                let is_name = word.first().is_some_and(u8::is_ascii_alphabetic) && !is_hex(word);
                self.bus = Some(is_name.then_some(word)?);
            }
            ExcerptColumn::Id => self.id(word)?,
            ExcerptColumn::Hex => self.id(word.strip_suffix(b"h").or(word.strip_suffix(b"H"))?)?,
            ExcerptColumn::Colon => {
                let word = word.strip_suffix(b":")?;
                // Without a time, a row with more digits is a line of a hex dump.
                (self.time.is_some() || word.len() == 3 || word.starts_with(b"0x")).then_some(())?;
                self.id(word)?;
            }
            ExcerptColumn::Direction => self.flags = self.flags.with(parse_direction(word)?),
            ExcerptColumn::Kind => self.parse_kind(word)?,
            ExcerptColumn::Length => {
                let inner = word.strip_prefix(b"[").and_then(|word| word.strip_suffix(b"]")).unwrap_or(word);
                self.length = Some(NumberBase::Decimal.parse_byte(inner)?);
            }
            ExcerptColumn::Data => {}
        }
        Some(())
    }

    fn id(&mut self, word: &[u8]) -> Option<()> {
        let word = word.strip_suffix(b"h").or(word.strip_suffix(b"H")).unwrap_or(word);
        let (digits, least) = match word.strip_prefix(b"0x").or(word.strip_prefix(b"0X")) {
            Some(digits) => (digits, 1),
            None => (word, 3),
        };
        (least..=8).contains(&digits.len()).then_some(())?;
        self.id = NumberBase::Hex.parse_number(digits)?;
        // Programs print four digits for a base identifier, and eight for an extended one.
        self.extended = (digits.len() > 4).then_some(true);
        Some(())
    }

    fn parse_kind(&mut self, word: &[u8]) -> Option<()> {
        let known = KINDS.iter().find(|(name, ..)| word.eq_ignore_ascii_case(name.as_bytes()));
        let (_, extended, is_remote) = known?;
        self.extended = extended.or(self.extended);
        if *is_remote {
            self.flags = self.flags.with(FrameFlags::REMOTE);
        }
        Some(())
    }

    /// Takes the words of the data: as many as the length, or all.
    fn parse_data(&mut self, words: &mut ColumnWords<'a>) -> Option<()> {
        self.data = words.clone();
        let count = match self.length {
            Some(_) if self.flags.contains(FrameFlags::REMOTE) => 0,
            Some(length) => usize::from(length),
            None => words.clone().take(MAX_DATA + 1).count(),
        };
        let is_pair = |word: &[u8]| matches!(word, [_, _] | [b'0', b'x', _, _]) && is_hex(word);
        words.by_ref().take(count).all(is_pair).then_some(())?;
        if self.length.is_none() {
            self.length = Some(u8::try_from(count).ok().filter(|count| (1..=8).contains(count))?);
        }
        Some(())
    }

    fn build_row(self) -> Option<ExcerptRow<'a>> {
        let length = self.length?;
        let flags = if length > 8 { self.flags.with(FrameFlags::FD) } else { self.flags };
        let id = parse_identifier(self.id, self.extended)?;
        let words = self.data.map(|word| word.strip_prefix(b"0x").unwrap_or(word));
        let frame = build_frame(id, flags, by_length(length, flags)?, words, NumberBase::Hex)?;
        let (time, is_time_of_day) = self.time.map_or((None, false), |(time, is)| (Some(time), is));
        Some(ExcerptRow { time, is_time_of_day, bus: self.bus, frame })
    }
}

fn parse_identifier(number: u32, extended: Option<bool>) -> Option<CanId> {
    crate::capture::text::columns::parse_identifier(number, extended.unwrap_or(number > 0x7FF))
}

fn parse_direction(word: &[u8]) -> Option<FrameFlags> {
    match word.to_ascii_lowercase().as_slice() {
        b"rx" => Some(FrameFlags::RECEIVED),
        b"tx" => Some(FrameFlags::TRANSMITTED),
        _ => None,
    }
}

/// Parses a time in nanoseconds, and whether it is a time of day. Seconds must have a fraction: the unit of a
/// whole number is unknown.
fn parse_time(word: &[u8]) -> Option<(i64, bool)> {
    let word = word.strip_prefix(b"(").and_then(|word| word.strip_suffix(b")")).unwrap_or(word);
    if word.contains(&b':') {
        return time_of_day(word).map(|time| (time, true));
    }
    word.iter().any(|byte| matches!(byte, b'.' | b',')).then_some(())?;
    crate::capture::text::columns::parse_time(word, SECOND).map(|time| (time, false))
}

fn is_number(word: &[u8]) -> bool {
    !word.is_empty() && word.iter().all(u8::is_ascii_digit)
}

fn is_hex(word: &[u8]) -> bool {
    word.strip_prefix(b"0x").unwrap_or(word).iter().all(u8::is_ascii_hexdigit)
}
