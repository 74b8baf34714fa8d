//! Parser of one row into a frame.

use super::dialect::{Coding, Layout, Meaning, Stamp, decoded};
use super::field::{Field, Fields};
use super::number::{Bytes, base64, decimal, hex, is_zlg_time, stamp};
use crate::capture::bus_error::{ControllerState, Violation, controller, violation};
use crate::capture::text::columns::{Base, identifier};
use crate::capture::text::day::TimesOfDay;
use crate::capture::text::line_format::{Assumptions, Fault, ONLY_BUS, ParsedLine};
use crate::capture::text::payload::{self, IDENTIFIER, LENGTH, by_dlc, is_fd_length};
use crate::frame::{CanId, Frame, FrameFlags, MAX_DATA};

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

const OF_DAY: &str = "times of day without a date: times count from the midnight before the first frame";
const ADAPTER: &str = "times of the adapter used: units of 0.1 ms, seconds or time of day";
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

/// Clock of a capture whose rows may have times of the computer and of the adapter: one of them for all rows.
#[derive(Debug, Clone, Default)]
pub(super) struct Clock {
    uses: Option<Stamp>,
    days: TimesOfDay,
}

impl Clock {
    /// Whether times of this form are used. The first row decides between the times of ZLG's programs.
    fn uses(&mut self, style: Stamp, text: &[u8]) -> bool {
        match style {
            Stamp::ZlgSystem | Stamp::ZlgAdapter => {
                is_zlg_time(text) && *self.uses.get_or_insert(style) == style
            }
            _ => !text.is_empty(),
        }
    }

    fn time(&mut self, text: &[u8], style: Stamp, assumptions: &mut Assumptions) -> Option<i64> {
        let time = stamp(text, style)?;
        if style == Stamp::ZlgAdapter {
            assumptions.report(ADAPTER);
        }
        let is_of_day = text.contains(&b':');
        if is_of_day && style != Stamp::Clock {
            assumptions.report(OF_DAY);
        }
        Some(if is_of_day { self.days.elapsed(time) } else { time })
    }
}

/// Parsed fields of a row.
struct Cells<'a> {
    is_gbk: bool,
    time: Option<i64>,
    bus: Option<Field<'a>>,
    id: Option<u32>,
    extended: Option<bool>,
    flags: FrameFlags,
    dlc: Option<u8>,
    length: Option<u8>,
    bytes: Bytes,
    coding: Option<Coding>,
    /// Error frame for a bus state or bus error.
    report: Option<Frame>,
    lost: bool,
    /// Whether the program records which frames are FD frames.
    knows_fd: bool,
    /// Whether the row has no frame: a request to send, a status or a remark.
    is_nothing: bool,
}

impl<'a> Cells<'a> {
    fn flag(&mut self, text: &[u8], flag: FrameFlags) -> Result<(), Fault> {
        if truth(text)? {
            self.flags = self.flags.with(flag);
        }
        Ok(())
    }

    fn take(
        &mut self,
        field: Field<'a>,
        meaning: Meaning,
        clock: &mut Clock,
        assumptions: &mut Assumptions,
    ) -> Result<(), Fault> {
        let text = field.text.trim_ascii();
        match meaning {
            Meaning::Id(_) if text.is_empty() => {}
            Meaning::Time(style) => {
                if clock.uses(style, text) {
                    self.time = Some(clock.time(text, style, assumptions).ok_or(TIME)?);
                }
            }
            Meaning::ZlgDirection | Meaning::ZlgKind => self.zlg_word(text, meaning, assumptions)?,
            Meaning::Bus => self.bus = Some(Field { text, ..field }),
            Meaning::Id(Base::Hex) => self.id = Some(payload::hex(text).ok_or(IDENTIFIER)?),
            Meaning::Id(base) => self.id = Some(base.number(text).ok_or(IDENTIFIER)?),
            Meaning::Extended => self.extended = Some(truth(text)?),
            Meaning::Remote => self.flag(text, FrameFlags::REMOTE)?,
            Meaning::Error => self.flag(text, FrameFlags::ERROR)?,
            Meaning::Fd => self.flag(text, FrameFlags::FD)?,
            Meaning::Switch => self.flag(text, FrameFlags::BIT_RATE_SWITCH)?,
            Meaning::State => self.flag(text, FrameFlags::ERROR_STATE)?,
            Meaning::Direction => self.flags = self.flags.with(direction(text)?),
            Meaning::KvaserFlags => self.kvaser_flags(text)?,
            Meaning::IxxatFlags if text.eq_ignore_ascii_case(b"rtr") => {
                self.flags = self.flags.with(FrameFlags::REMOTE);
            }
            Meaning::CandoKind => self.cando_kind(text)?,
            Meaning::Dlc => self.dlc = number(text)?,
            Meaning::Length => self.length = number(text)?,
            Meaning::Data(coding) => self.data(text, coding)?,
            Meaning::Byte(base) => self.byte(text, base)?,
            Meaning::Nothing | Meaning::IxxatFlags => {}
        }
        Ok(())
    }

    /// Takes a direction, frame type or format of ZLG's programs. A word with invalid characters costs its
    /// meaning, not the frame.
    fn zlg_word(
        &mut self,
        text: &[u8],
        meaning: Meaning,
        assumptions: &mut Assumptions,
    ) -> Result<(), Fault> {
        let word = decoded(text, self.is_gbk).to_lowercase();
        let is = |known: &str| word == known;
        if word.is_empty() {
            return Ok(());
        }
        if word.contains(char::REPLACEMENT_CHARACTER) {
            assumptions.report(BROKEN);
            return Ok(());
        }
        if meaning == Meaning::ZlgDirection {
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
            self.report = Some(violation(Violation::Other, false, 0, None));
        }
        Ok(())
    }

    fn kvaser_flags(&mut self, text: &[u8]) -> Result<(), Fault> {
        let marks = Base::Decimal.number(text).ok_or("flags: expected a decimal number")?;
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
    fn cando_kind(&mut self, text: &[u8]) -> Result<(), Fault> {
        self.report = match text {
            b"EF" => Some(violation(Violation::Other, false, 0, None)),
            _ => CANDO_STATES.iter().find(|(name, _)| *name == text).map(|(_, state)| controller(*state)),
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

    fn data(&mut self, text: &[u8], coding: Coding) -> Result<(), Fault> {
        self.coding = Some(coding);
        // IXXAT's programs write `Remote request DLC=8` here.
        if let Some(at) = memchr::memmem::find(text, b"DLC").filter(|_| text.starts_with(b"Remote request")) {
            let digits = text.get(at + 3..).unwrap_or_default().trim_ascii();
            self.length = number(digits.strip_prefix(b"=").unwrap_or(digits).trim_ascii())?;
            self.flags = self.flags.with(FrameFlags::REMOTE);
            return Ok(());
        }
        let bytes = match coding {
            Coding::Hex | Coding::Listed | Coding::Marked => hex(text),
            Coding::Decimal => decimal(text),
            Coding::Base64 => base64(text),
        };
        self.bytes = bytes.ok_or(CODING)?;
        Ok(())
    }

    /// Parses a field with one byte; fields after the last byte are empty, or contain a remark.
    fn byte(&mut self, text: &[u8], base: Base) -> Result<(), Fault> {
        if text.starts_with(b";") {
            // CANdo stores a note as a transmitted frame without data.
            self.is_nothing |= self.bytes.count == 0 && self.flags.contains(FrameFlags::TRANSMITTED);
        } else if !text.is_empty() {
            let byte = if base == Base::Hex { payload::hex(text) } else { base.number(text) };
            let byte = byte.and_then(|byte| u8::try_from(byte).ok());
            byte.and_then(|byte| self.bytes.push(byte)).ok_or(CODING)?;
        }
        Ok(())
    }

    /// Length and raw DLC of the frame.
    fn lengths(&self) -> Option<(u8, u8)> {
        let is_fd = self.flags.contains(FrameFlags::FD);
        let most = if is_fd { MAX_DATA } else { 8 };
        let length = match (self.length, self.dlc) {
            (None, Some(dlc)) => return by_dlc(dlc, self.flags),
            (Some(length), _) => length,
            (None, None) => u8::try_from(self.bytes.count).ok()?,
        };
        let raw = self.dlc.filter(|dlc| (9..=15).contains(dlc) && !is_fd && length == 8);
        (usize::from(length) <= most).then_some((length, raw.unwrap_or(0)))
    }

    /// Builds the frame, without number, time and bus.
    fn frame(mut self) -> Result<Frame, Fault> {
        let is_error = self.flags.contains(FrameFlags::ERROR);
        // python-can stores most errors without details.
        let is_bare = self.coding == Some(Coding::Base64) && self.bytes.count == 0 && self.id == Some(0);
        let report = if is_error && (self.id.is_none() || is_bare) {
            Some(violation(Violation::Other, false, 0, None))
        } else {
            self.report
        };
        if let Some(frame) = report {
            return Ok(Frame { flags: frame.flags.with(self.flags), ..frame });
        }
        let id = self.can_id(is_error).ok_or(IDENTIFIER)?;
        let listed_none = self.coding == Some(Coding::Listed) && self.bytes.count == 0;
        if listed_none && self.dlc.is_some_and(|dlc| dlc > 0) {
            self.flags = self.flags.with(FrameFlags::REMOTE);
        }
        // Programs without an FD column still record FD frames, which are longer than 8 bytes.
        let length = self.length.or(u8::try_from(self.bytes.count).ok());
        if !self.knows_fd && length.is_some_and(|length| length > 8 && is_fd_length(length)) {
            self.flags = self.flags.with(FrameFlags::FD);
        }
        let (length, raw_dlc) = self.lengths().ok_or(LENGTH)?;
        let is_remote = self.flags.contains(FrameFlags::REMOTE);
        // Single-byte columns and those of ZLG's programs may be filled up to the eighth byte, independent of the length.
        let fits = match self.coding {
            Some(Coding::Marked) | None => self.bytes.count >= usize::from(length),
            Some(_) => self.bytes.count == usize::from(length),
        };
        if !fits && !is_remote {
            return Err(DATA.into());
        }
        let bytes = if is_remote { Bytes::NONE.bytes } else { self.bytes.bytes };
        Ok(Frame { id, flags: self.flags, length, raw_dlc, bytes, ..Frame::EMPTY })
    }

    fn can_id(&self, is_error: bool) -> Option<CanId> {
        let number = self.id?;
        let extended = self.extended.unwrap_or(number > 0x7FF);
        identifier(number, extended || is_error)
    }
}

fn truth(text: &[u8]) -> Result<bool, Fault> {
    match text.to_ascii_lowercase().as_slice() {
        b"" | b"0" | b"false" | b"std" => Ok(false),
        b"1" | b"true" | b"ext" => Ok(true),
        _ => Err(FLAG.into()),
    }
}

fn direction(text: &[u8]) -> Result<FrameFlags, Fault> {
    match text.to_ascii_lowercase().as_slice() {
        b"" => Ok(FrameFlags(0)),
        b"rx" | b"0" => Ok(FrameFlags::RECEIVED),
        b"tx" | b"1" => Ok(FrameFlags::TRANSMITTED),
        _ => Err("direction: expected rx or tx".into()),
    }
}

/// Parses a decimal number, or a hexadecimal one with 0x; `None` if the field is empty.
fn number(text: &[u8]) -> Result<Option<u8>, Fault> {
    if text.is_empty() {
        return Ok(None);
    }
    let hex = text.strip_prefix(b"0x").map(|digits| Base::Hex.byte(digits));
    Ok(Some(hex.unwrap_or_else(|| Base::Decimal.byte(text)).ok_or(LENGTH)?))
}

/// Parses a row; `room` is a buffer for a bus name that contains quotes.
pub(super) fn read<'a>(
    text: &'a [u8],
    layout: &Layout,
    room: &'a mut Vec<u8>,
    clock: &mut Clock,
    assumptions: &mut Assumptions,
) -> Result<Option<ParsedLine<'a>>, Fault> {
    if layout.has_text && !text.contains(&layout.separator) {
        return Ok(None);
    }
    let mut cells = Cells {
        is_gbk: layout.is_gbk,
        time: None,
        bus: None,
        id: None,
        extended: None,
        flags: FrameFlags(0),
        dlc: None,
        length: None,
        bytes: Bytes::NONE,
        coding: None,
        report: None,
        lost: false,
        knows_fd: layout.has(Meaning::Fd) || layout.has(Meaning::KvaserFlags),
        is_nothing: false,
    };
    for (field, meaning) in Fields::new(text, layout.separator).zip(&layout.columns) {
        cells.take(field, *meaning, clock, assumptions)?;
        if cells.is_nothing {
            if layout.has(Meaning::KvaserFlags) {
                assumptions.report(REQUESTS);
            }
            return Ok(None);
        }
    }
    if cells.extended.is_none() && cells.id.is_some() {
        assumptions.report(SIZES);
    }
    let (time, bus, lost) = (cells.time, cells.bus, cells.lost);
    let frame = cells.frame()?;
    let bus = match bus {
        None => ONLY_BUS,
        Some(field) if field.has_quotes => {
            field.unquoted(room);
            room
        }
        Some(field) => field.text,
    };
    Ok(Some(ParsedLine { time, bus, frame, lost }))
}
