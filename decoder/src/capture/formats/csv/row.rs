//! One row: its fields, and the frame they make.

use super::dialect::{Coding, Layout, Meaning};
use super::field::{Field, Fields};
use super::number::{Bytes, base64, decimal, hex, stamp};
use crate::capture::bus_error::{ControllerState, Violation, controller, violation};
use crate::capture::text::columns::{Base, identifier};
use crate::capture::text::line_format::{Assumptions, Fault, ONLY_BUS, Seen};
use crate::capture::text::payload::{self, IDENTIFIER, LENGTH, by_dlc, is_fd_length};
use crate::frame::{CanId, Frame, FrameFlags, MAX_DATA};

const TIME: &str = "time: expected a number as this header's program writes it";
const FLAG: &str = "flag: expected 0, 1, false or true";
const DATA: &str = "data: expected as many bytes as the length says";
const CODING: &str = "data: expected up to 64 bytes as this header's program writes them";
const KIND: &str = "type: expected RD, TD, RR or TR and 11 or 29, EF, BA, BP, BO, ST or !";
const SIZES: &str = "which identifiers are extended is not recorded: those above 7FF are";
const REQUESTS: &str = "requests to send are not taken for frames";

/// Bits of Kvaser's flags and what they are (canlib.h).
const KVASER_FLAGS: &[(u32, FrameFlags)] = &[
    (0x01, FrameFlags::REMOTE),
    (0x20, FrameFlags::ERROR),
    (0x40, FrameFlags::TRANSMITTED),
    (0x1_0000, FrameFlags::FD),
    (0x2_0000, FrameFlags::BIT_RATE_SWITCH),
    (0x4_0000, FrameFlags::ERROR_STATE),
];

/// Of these, an extended identifier, a request to send, and frames lost before this one.
const KVASER_EXTENDED: u32 = 0x04;
const KVASER_REQUEST: u32 = 0x80;
const KVASER_OVERRUN: u32 = 0x600;

/// States of the bus in Netronics' words.
const CANDO_STATES: &[(&[u8], ControllerState)] = &[
    (b"BA", ControllerState::Active),
    (b"BP", ControllerState::Passive),
    (b"BO", ControllerState::BusOff),
    (b"!", ControllerState::Overrun),
];

/// What the fields of a row hold.
struct Cells<'a> {
    time: Option<i64>,
    bus: Option<Field<'a>>,
    id: Option<u32>,
    extended: Option<bool>,
    flags: FrameFlags,
    dlc: Option<u8>,
    length: Option<u8>,
    bytes: Bytes,
    coding: Option<Coding>,
    /// A frame that reports the bus.
    report: Option<Frame>,
    lost: bool,
    /// The program records which frames are FD.
    knows_fd: bool,
    /// A request to send, a status, a remark: no frame.
    is_nothing: bool,
}

impl<'a> Cells<'a> {
    fn flag(&mut self, text: &[u8], flag: FrameFlags) -> Result<(), Fault> {
        if truth(text)? {
            self.flags = self.flags.with(flag);
        }
        Ok(())
    }

    fn take(&mut self, field: Field<'a>, meaning: Meaning) -> Result<(), Fault> {
        let text = field.text.trim_ascii();
        match meaning {
            Meaning::Time(_) | Meaning::Id(_) if text.is_empty() => {}
            Meaning::Time(style) => self.time = Some(stamp(text, style).ok_or(TIME)?),
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

    /// `RD11`: received data frame with a base identifier.
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
            Coding::Hex | Coding::Listed => hex(text),
            Coding::Decimal => decimal(text),
            Coding::Base64 => base64(text),
        };
        self.bytes = bytes.ok_or(CODING)?;
        Ok(())
    }

    /// A field of one byte; behind the last they are empty, or hold a remark.
    fn byte(&mut self, text: &[u8], base: Base) -> Result<(), Fault> {
        if text.starts_with(b";") {
            // CANdo has no other place for a note: a frame to be sent, without data.
            self.is_nothing |= self.bytes.count == 0 && self.flags.contains(FrameFlags::TRANSMITTED);
        } else if !text.is_empty() {
            let byte = if base == Base::Hex { payload::hex(text) } else { base.number(text) };
            let byte = byte.and_then(|byte| u8::try_from(byte).ok());
            byte.and_then(|byte| self.bytes.push(byte)).ok_or(CODING)?;
        }
        Ok(())
    }

    /// Length and raw DLC.
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

    /// The frame without number, time and bus.
    fn frame(mut self) -> Result<Frame, Fault> {
        let is_error = self.flags.contains(FrameFlags::ERROR);
        // python-can knows no more of most errors than that there was one.
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
        // Programs that do not record FD still record its longer frames.
        let length = self.length.or(u8::try_from(self.bytes.count).ok());
        if !self.knows_fd && length.is_some_and(|length| length > 8 && is_fd_length(length)) {
            self.flags = self.flags.with(FrameFlags::FD);
        }
        let (length, raw_dlc) = self.lengths().ok_or(LENGTH)?;
        let is_remote = self.flags.contains(FrameFlags::REMOTE);
        // Columns of a byte each may be filled up to the eighth whatever the length is.
        let fits = match self.coding {
            Some(_) => self.bytes.count == usize::from(length),
            None => self.bytes.count >= usize::from(length),
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

/// A decimal number, or none in an empty field.
fn number(text: &[u8]) -> Result<Option<u8>, Fault> {
    if text.is_empty() {
        return Ok(None);
    }
    Ok(Some(Base::Decimal.byte(text).ok_or(LENGTH)?))
}

/// Reads a row; `room` is for the name of its bus if that has quotes within it.
pub(super) fn read<'a>(
    text: &'a [u8],
    layout: &Layout,
    room: &'a mut Vec<u8>,
    assumptions: &mut Assumptions,
) -> Result<Option<Seen<'a>>, Fault> {
    if layout.has_text && !text.contains(&layout.separator) {
        return Ok(None);
    }
    let mut cells = Cells {
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
        cells.take(field, *meaning)?;
        if cells.is_nothing {
            if layout.has(Meaning::KvaserFlags) {
                assumptions.say(REQUESTS);
            }
            return Ok(None);
        }
    }
    if cells.extended.is_none() && cells.id.is_some() {
        assumptions.say(SIZES);
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
    Ok(Some(Seen { time, bus, frame, lost }))
}
