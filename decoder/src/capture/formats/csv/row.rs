//! Parser of one row into a frame.

use super::clock::CsvClock;
use super::dialect::{ColumnMeaning, CsvLayout, DataCoding, decode_text};
use super::field::{CsvField, CsvFields};
use super::number::{RowBytes, parse_base64, parse_decimal, parse_hex};
use crate::capture::bus_error::{ControllerState, Violation, controller_frame, violation_frame};
use crate::capture::text::columns::{NumberBase, parse_identifier};
use crate::capture::text::line_format::{CaptureAssumptions, LineFault, ONLY_BUS, ParsedLine};
use crate::capture::text::payload::{self, IDENTIFIER, LENGTH, by_dlc};
use crate::frame::{CanId, Frame, FrameFlags, MAX_DATA, is_fd_length};

const TIME: &str = "time: expected a number in the format of this header's program";
const FLAG: &str = "flag: expected 0, 1, false or true";
const DATA: &str = "data: expected as many bytes as the length";
const CODING: &str = "data: expected up to 64 bytes in the format of this header's program";
const KIND: &str = "type: expected RD, TD, RR or TR and 11 or 29, EF, BA, BP, BO, ST or !";
const SIZES: &str = "identifier type not recorded: identifiers above 7FF read as 29-bit";
const REQUESTS: &str = "requests to send ignored";

/// Flags of Kvaser (canlib.h) and the corresponding flags of a frame.
const KVASER_FLAGS: &[(u32, FrameFlags)] = &[
    (0x01, FrameFlags::REMOTE),
    (0x20, FrameFlags::ERROR),
    (0x40, FrameFlags::TRANSMITTED),
    (0x1_0000, FrameFlags::FD),
    (0x2_0000, FrameFlags::BIT_RATE_SWITCH),
    (0x4_0000, FrameFlags::ERROR_STATE),
];

/// Further flags of Kvaser: extended identifier, request to send, frames lost before this one.
const KVASER_EXTENDED: u32 = 0x04;
const KVASER_REQUEST: u32 = 0x80;
const KVASER_OVERRUN: u32 = 0x600;

/// Bus states in Netronics' form.
const CANDO_STATES: &[(&[u8], ControllerState)] = &[
    (b"BA", ControllerState::Active),
    (b"BP", ControllerState::Passive),
    (b"BO", ControllerState::BusOff),
    (b"!", ControllerState::Overrun),
];

const BROKEN: &str = "words with invalid characters ignored: direction or frame type unknown";

/// Words of ZLG's programs for directions.
const ZLG_DIRECTIONS: &[(&str, FrameFlags)] = &[
    ("接收", FrameFlags::RECEIVED),
    ("发送", FrameFlags::TRANSMITTED),
    ("receive", FrameFlags::RECEIVED),
    ("send", FrameFlags::TRANSMITTED),
    ("transmit", FrameFlags::TRANSMITTED),
    ("rx", FrameFlags::RECEIVED),
    ("tx", FrameFlags::TRANSMITTED),
];

/// Words of ZLG's programs for frame types and formats: extended, and flags.
const ZLG_KINDS: &[(&str, Option<bool>, FrameFlags)] = &[
    ("数据帧", None, FrameFlags(0)),
    ("远程帧", None, FrameFlags::REMOTE),
    ("错误帧", None, FrameFlags::ERROR),
    ("标准帧", Some(false), FrameFlags(0)),
    ("扩展帧", Some(true), FrameFlags(0)),
    ("can", None, FrameFlags(0)),
    ("canfd", None, FrameFlags::FD),
    ("canfd加速", None, FrameFlags::FD.with(FrameFlags::BIT_RATE_SWITCH)),
    ("data", None, FrameFlags(0)),
    ("data frame", None, FrameFlags(0)),
    ("remote", None, FrameFlags::REMOTE),
    ("remote frame", None, FrameFlags::REMOTE),
    ("standard", Some(false), FrameFlags(0)),
    ("standard frame", Some(false), FrameFlags(0)),
    ("std", Some(false), FrameFlags(0)),
    ("extended", Some(true), FrameFlags(0)),
    ("extended frame", Some(true), FrameFlags(0)),
    ("ext", Some(true), FrameFlags(0)),
];

/// Parsed fields of a row.
struct CsvRowCells<'a> {
    is_gbk: bool,
    time: Option<i64>,
    bus: Option<CsvField<'a>>,
    id: Option<u32>,
    extended: Option<bool>,
    flags: FrameFlags,
    dlc: Option<u8>,
    length: Option<u8>,
    bytes: RowBytes,
    coding: Option<DataCoding>,
    /// Error frame for a bus state or bus error.
    report: Option<Frame>,
    lost: bool,
    /// Whether the program records which frames are FD frames.
    knows_fd: bool,
    /// Whether the row has no frame: a request to send, a status or a remark.
    is_nothing: bool,
}

impl<'a> CsvRowCells<'a> {
    fn set_flag(&mut self, text: &[u8], flag: FrameFlags) -> Result<(), LineFault> {
        if parse_truth(text)? {
            self.flags = self.flags.with(flag);
        }
        Ok(())
    }

    fn take_field(
        &mut self,
        field: CsvField<'a>,
        meaning: ColumnMeaning,
        clock: &mut CsvClock,
        assumptions: &mut CaptureAssumptions,
    ) -> Result<(), LineFault> {
        let text = field.text.trim_ascii();
        match meaning {
            ColumnMeaning::Id(_) if text.is_empty() => {}
            ColumnMeaning::Time(style) => {
                if clock.uses_style(style, text) {
                    self.time = Some(clock.parse_time(text, style, assumptions).ok_or(TIME)?);
                }
            }
            ColumnMeaning::ZlgDirection | ColumnMeaning::ZlgKind => {
                self.zlg_word(text, meaning, assumptions)?;
            }
            ColumnMeaning::Bus => self.bus = Some(CsvField { text, ..field }),
            ColumnMeaning::Id(NumberBase::Hex) => self.id = Some(payload::parse_hex(text).ok_or(IDENTIFIER)?),
            ColumnMeaning::Id(base) => self.id = Some(base.parse_number(text).ok_or(IDENTIFIER)?),
            ColumnMeaning::Extended => self.extended = Some(parse_truth(text)?),
            ColumnMeaning::Remote => self.set_flag(text, FrameFlags::REMOTE)?,
            ColumnMeaning::Error => self.set_flag(text, FrameFlags::ERROR)?,
            ColumnMeaning::Fd => self.set_flag(text, FrameFlags::FD)?,
            ColumnMeaning::Switch => self.set_flag(text, FrameFlags::BIT_RATE_SWITCH)?,
            ColumnMeaning::State => self.set_flag(text, FrameFlags::ERROR_STATE)?,
            ColumnMeaning::Direction => self.flags = self.flags.with(parse_direction(text)?),
            ColumnMeaning::KvaserFlags => self.kvaser_flags(text)?,
            ColumnMeaning::IxxatFlags if text.eq_ignore_ascii_case(b"rtr") => {
                self.flags = self.flags.with(FrameFlags::REMOTE);
            }
            ColumnMeaning::CandoKind => self.cando_kind(text)?,
            ColumnMeaning::Dlc => self.dlc = parse_number(text)?,
            ColumnMeaning::Length => self.length = parse_number(text)?,
            ColumnMeaning::Data(coding) => self.parse_data(text, coding)?,
            ColumnMeaning::Byte(base) => self.parse_byte(text, base)?,
            ColumnMeaning::Nothing | ColumnMeaning::IxxatFlags => {}
        }
        Ok(())
    }

    /// Takes a direction, frame type or format of ZLG's programs. A word with invalid characters costs its
    /// meaning, not the frame.
    fn zlg_word(
        &mut self,
        text: &[u8],
        meaning: ColumnMeaning,
        assumptions: &mut CaptureAssumptions,
    ) -> Result<(), LineFault> {
        let word = decode_text(text, self.is_gbk).to_lowercase();
        let is = |known: &str| word == known;
        if word.is_empty() {
            return Ok(());
        }
        if word.contains(char::REPLACEMENT_CHARACTER) {
            assumptions.add_assumption(BROKEN);
            return Ok(());
        }
        if meaning == ColumnMeaning::ZlgDirection {
            let (_, flag) = ZLG_DIRECTIONS
                .iter()
                .find(|(known, _)| is(known))
                .ok_or("direction: expected 接收, 发送, Receive or Send")?;
            self.flags = self.flags.with(*flag);
            return Ok(());
        }
        let (_, extended, flags) = ZLG_KINDS
            .iter()
            .find(|(known, ..)| is(known))
            .ok_or("frame type: expected 数据帧, 远程帧, 标准帧 or 扩展帧")?;
        self.extended = extended.or(self.extended);
        self.flags = self.flags.with(*flags);
        if flags.contains(FrameFlags::ERROR) {
            self.report = Some(violation_frame(Violation::Other, false, 0, None));
        }
        Ok(())
    }

    fn kvaser_flags(&mut self, text: &[u8]) -> Result<(), LineFault> {
        let marks = NumberBase::Decimal.parse_number(text).ok_or("flags: expected a decimal number")?;
        for (_, flag) in KVASER_FLAGS.iter().filter(|(bits, _)| marks & bits != 0) {
            self.flags = self.flags.with(*flag);
        }
        if !self.flags.contains(FrameFlags::TRANSMITTED) {
            self.flags = self.flags.with(FrameFlags::RECEIVED);
        }
        self.extended = Some(marks & KVASER_EXTENDED != 0);
        self.lost = marks & KVASER_OVERRUN != 0;
        self.is_nothing = marks & KVASER_REQUEST != 0;
        Ok(())
    }

    /// Parses a frame type such as `RD11`, a received data frame with a base identifier.
    fn cando_kind(&mut self, text: &[u8]) -> Result<(), LineFault> {
        self.report = match text {
            b"EF" => Some(violation_frame(Violation::Other, false, 0, None)),
            _ => {
                CANDO_STATES.iter().find(|(name, _)| *name == text).map(|(_, state)| controller_frame(*state))
            }
        };
        self.lost = text == b"!";
        self.is_nothing = text == b"ST";
        if self.report.is_some() || self.is_nothing {
            return Ok(());
        }
        let [way, kind, width @ ..] = text else { return Err(KIND.into()) };
        self.flags = match way {
            b'R' => FrameFlags::RECEIVED,
            b'T' => FrameFlags::TRANSMITTED,
            _ => return Err(KIND.into()),
        };
        if *kind == b'R' {
            self.flags = self.flags.with(FrameFlags::REMOTE);
        }
        self.extended = Some(width == b"29");
        let known = matches!(kind, b'D' | b'R') && matches!(width, b"11" | b"29");
        if known { Ok(()) } else { Err(KIND.into()) }
    }

    fn parse_data(&mut self, text: &[u8], coding: DataCoding) -> Result<(), LineFault> {
        self.coding = Some(coding);
        // IXXAT's programs write `Remote request DLC=8` here.
        if let Some(at) = memchr::memmem::find(text, b"DLC").filter(|_| text.starts_with(b"Remote request")) {
            let digits = text.get(at + 3..).unwrap_or_default().trim_ascii();
            self.length = parse_number(digits.strip_prefix(b"=").unwrap_or(digits).trim_ascii())?;
            self.flags = self.flags.with(FrameFlags::REMOTE);
            return Ok(());
        }
        let bytes = match coding {
            DataCoding::Hex | DataCoding::Listed | DataCoding::Marked => parse_hex(text),
            DataCoding::Decimal => parse_decimal(text),
            DataCoding::Base64 => parse_base64(text),
        };
        self.bytes = bytes.ok_or(CODING)?;
        Ok(())
    }

    /// Parses a field with one byte; fields after the last byte are empty, or contain a remark.
    fn parse_byte(&mut self, text: &[u8], base: NumberBase) -> Result<(), LineFault> {
        if text.starts_with(b";") {
            // CANdo stores a note as a transmitted frame without data.
            self.is_nothing |= self.bytes.count == 0 && self.flags.contains(FrameFlags::TRANSMITTED);
        } else if !text.is_empty() {
            let byte =
                if base == NumberBase::Hex { payload::parse_hex(text) } else { base.parse_number(text) };
            let byte = byte.and_then(|byte| u8::try_from(byte).ok());
            byte.and_then(|byte| self.bytes.push(byte)).ok_or(CODING)?;
        }
        Ok(())
    }

    /// Length and raw DLC of the frame.
    fn frame_lengths(&self) -> Option<(u8, u8)> {
        let is_fd = self.flags.contains(FrameFlags::FD);
        let most = if is_fd { MAX_DATA } else { 8 };
        let length = match (self.length, self.dlc) {
            (None, Some(dlc)) => return by_dlc(dlc, self.flags),
            (Some(length), _) => length,
            (None, None) => u8::try_from(self.bytes.count).ok()?,
        };
        let raw = self.dlc.filter(|dlc| (9..=15).contains(dlc) && !is_fd && length == 8);
        let exists = usize::from(length) <= most && (!is_fd || is_fd_length(length));
        exists.then_some((length, raw.unwrap_or(0)))
    }

    /// Builds the frame, without number, time and bus.
    fn build_frame(mut self) -> Result<Frame, LineFault> {
        let is_error = self.flags.contains(FrameFlags::ERROR);
        // python-can stores most errors without details.
        let is_bare = self.coding == Some(DataCoding::Base64) && self.bytes.count == 0 && self.id == Some(0);
        let report = if is_error && (self.id.is_none() || is_bare) {
            Some(violation_frame(Violation::Other, false, 0, None))
        } else {
            self.report
        };
        if let Some(frame) = report {
            return Ok(Frame { flags: frame.flags.with(self.flags), ..frame });
        }
        let id = self.can_id(is_error).ok_or(IDENTIFIER)?;
        let listed_none = self.coding == Some(DataCoding::Listed) && self.bytes.count == 0;
        if listed_none && self.dlc.is_some_and(|dlc| dlc > 0) {
            self.flags = self.flags.with(FrameFlags::REMOTE);
        }
        // Programs without an FD column still record FD frames, which are longer than 8 bytes.
        let length = self.length.or(u8::try_from(self.bytes.count).ok());
        if !self.knows_fd && length.is_some_and(|length| length > 8 && is_fd_length(length)) {
            self.flags = self.flags.with(FrameFlags::FD);
        }
        let (length, raw_dlc) = self.frame_lengths().ok_or(LENGTH)?;
        let is_remote = self.flags.contains(FrameFlags::REMOTE);
        // Single-byte columns and those of ZLG's programs may be filled up to the eighth byte, independent of the length.
        let fits = match self.coding {
            Some(DataCoding::Marked) | None => self.bytes.count >= usize::from(length),
            Some(_) => self.bytes.count == usize::from(length),
        };
        if !fits && !is_remote {
            return Err(DATA.into());
        }
        let bytes = if is_remote { RowBytes::NONE.bytes } else { self.bytes.bytes };
        Ok(Frame { id, flags: self.flags, length, raw_dlc, bytes, ..Frame::EMPTY })
    }

    fn can_id(&self, is_error: bool) -> Option<CanId> {
        let number = self.id?;
        let extended = self.extended.unwrap_or(number > 0x7FF);
        parse_identifier(number, extended || is_error)
    }
}

fn parse_truth(text: &[u8]) -> Result<bool, LineFault> {
    match text.to_ascii_lowercase().as_slice() {
        b"" | b"0" | b"false" | b"std" => Ok(false),
        b"1" | b"true" | b"ext" => Ok(true),
        _ => Err(FLAG.into()),
    }
}

fn parse_direction(text: &[u8]) -> Result<FrameFlags, LineFault> {
    match text.to_ascii_lowercase().as_slice() {
        b"" => Ok(FrameFlags(0)),
        b"rx" | b"0" => Ok(FrameFlags::RECEIVED),
        b"tx" | b"1" => Ok(FrameFlags::TRANSMITTED),
        _ => Err("direction: expected rx or tx".into()),
    }
}

/// Parses a decimal number, or a hexadecimal one with 0x; `None` if the field is empty.
fn parse_number(text: &[u8]) -> Result<Option<u8>, LineFault> {
    if text.is_empty() {
        return Ok(None);
    }
    let hex = text.strip_prefix(b"0x").map(|digits| NumberBase::Hex.parse_byte(digits));
    Ok(Some(hex.unwrap_or_else(|| NumberBase::Decimal.parse_byte(text)).ok_or(LENGTH)?))
}

/// Parses a row; `room` is a buffer for a bus name that contains quotes.
pub(super) fn read_row<'a>(
    text: &'a [u8],
    layout: &CsvLayout,
    room: &'a mut Vec<u8>,
    clock: &mut CsvClock,
    assumptions: &mut CaptureAssumptions,
) -> Result<Option<ParsedLine<'a>>, LineFault> {
    if layout.has_text && !text.contains(&layout.separator) {
        return Ok(None);
    }
    let mut cells = CsvRowCells {
        is_gbk: layout.is_gbk,
        time: None,
        bus: None,
        id: None,
        extended: None,
        flags: FrameFlags(0),
        dlc: None,
        length: None,
        bytes: RowBytes::NONE,
        coding: None,
        report: None,
        lost: false,
        knows_fd: layout.has_column(ColumnMeaning::Fd) || layout.has_column(ColumnMeaning::KvaserFlags),
        is_nothing: false,
    };
    for (field, meaning) in CsvFields::new(text, layout.separator).zip(&layout.columns) {
        cells.take_field(field, *meaning, clock, assumptions)?;
        if cells.is_nothing {
            if layout.has_column(ColumnMeaning::KvaserFlags) {
                assumptions.add_assumption(REQUESTS);
            }
            return Ok(None);
        }
    }
    if cells.extended.is_none() && cells.id.is_some() {
        assumptions.add_assumption(SIZES);
    }
    let (time, bus, lost) = (cells.time, cells.bus, cells.lost);
    let frame = cells.build_frame()?;
    let bus = match bus {
        None => ONLY_BUS,
        Some(field) if field.has_quotes => {
            field.unquote_into(room);
            room
        }
        Some(field) => field.text,
    };
    Ok(Some(ParsedLine { time, bus, frame, lost }))
}
