//! The serial text protocol of Lawicel's CAN232 and CANUSB ("slcan"), with the FD frames of CANable 2.
//!
//! ```text
//! t 123 2 11 22 [EA5F] CR     11-bit data frame: identifier, DLC, data, milliseconds 0..=59,999
//! T 18FEF100 1 AA CR          29-bit        r, R  remote frames: no data after the DLC
//! d, D  FD frame       b, B  FD frame with bit rate switch: DLC 9..F mean 12..64 bytes
//! CR done    BEL refused    F 00 CR status flags
//! s p 130 005 CR              state (a, w, p, b) and receive and transmit error counters, decimal
//! e 2 a c CR                  number of bus errors, then one letter per error
//! ```
//!
//! Sources: Lawicel, CAN232 manual version 3; README of the CANable 2 firmware (normaldotcom/canable2-fw);
//! the state and error lines are those of Linux' slcan driver (drivers/net/can/slcan/slcan-core.c).

use std::fmt;

use super::{PendingReply, parse_hexadecimal};
use crate::capture::text::lines::line_excerpt;
use crate::frame::{CanId, Frame, FrameFlags, fd_length};

/// Longest accepted line in bytes, without its end; the longest frame has 142.
pub const LONGEST_LINE: usize = 160;

/// Ends a line; alone, it means "done".
const CR: u8 = b'\r';

/// Means "refused".
const BEL: u8 = 0x07;

/// A bit rate for which the protocol has a command.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct SlcanBitRate(usize);

/// Bit rates in bit/s and the commands that set them. (Some CANable firmware has 750,000 for `S7`.)
const BIT_RATES: [(u32, &[u8]); 9] = [
    (10_000, b"S0\r"),
    (20_000, b"S1\r"),
    (50_000, b"S2\r"),
    (100_000, b"S3\r"),
    (125_000, b"S4\r"),
    (250_000, b"S5\r"),
    (500_000, b"S6\r"),
    (800_000, b"S7\r"),
    (1_000_000, b"S8\r"),
];

impl SlcanBitRate {
    /// The command for this bit rate; `None` if the protocol has none.
    pub fn for_rate(bits_per_second: u32) -> Option<Self> {
        BIT_RATES.iter().position(|(rate, _)| *rate == bits_per_second).map(Self)
    }

    /// All supported bit rates in bit/s, ascending.
    pub fn supported_rates() -> impl Iterator<Item = u32> {
        BIT_RATES.iter().map(|(rate, _)| *rate)
    }
}

/// Commands to an adapter. No command transmits a frame or opens the channel in another mode than
/// listen-only, and none can be constructed.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum SlcanCommand {
    /// Close the channel.
    Close,
    /// Set the bit rate; only while the channel is closed.
    SetBitRate(SlcanBitRate),
    /// Append milliseconds to each frame; only while the channel is closed.
    TimestampsOn,
    /// Open the channel in listen-only mode: the controller does not even acknowledge frames.
    Listen,
    /// Read the status flags, which also clears them.
    ReadFlags,
}

impl SlcanCommand {
    /// The bytes to write: one complete line.
    pub fn bytes(self) -> &'static [u8] {
        match self {
            Self::Close => b"C\r",
            Self::SetBitRate(SlcanBitRate(index)) => BIT_RATES.get(index).map_or(b"C\r", |(_, bytes)| bytes),
            Self::TimestampsOn => b"Z1\r",
            Self::Listen => b"L\r",
            Self::ReadFlags => b"F\r",
        }
    }
}

/// The adapter's status flags since the last read.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct StatusFlags(pub u8);

/// Bit and meaning, from command `F` of the CAN232 manual.
const FLAGS: [(u8, &str); 7] = [
    (0, "receive queue full"),
    (1, "transmit queue full"),
    (2, "error warning"),
    (3, "data overrun"),
    (5, "error passive"),
    (6, "arbitration lost"),
    (7, "bus error"),
];

impl StatusFlags {
    /// Whether frames were lost in the adapter: full queue (bit 0) or overrun of the controller (bit 3).
    pub const fn lost_frames(self) -> bool {
        self.0 & 0b1001 != 0
    }
}

/// Names of the set flags: `error warning, bus error`; empty if none is set.
impl fmt::Display for StatusFlags {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let set = FLAGS.iter().filter(|(bit, _)| self.0 >> bit & 1 != 0);
        for (index, (_, name)) in set.enumerate() {
            f.write_str(if index == 0 { "" } else { ", " })?;
            f.write_str(name)?;
        }
        Ok(())
    }
}

/// Fault confinement state of a controller (ISO 11898-1).
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum SlcanConfinement {
    /// Both error counters are below 96.
    Active,
    /// An error counter is 96 or more.
    Warning,
    /// An error counter is 128 or more.
    Passive,
    /// Bus off: the transmit error counter exceeded 255.
    BusOff,
}

/// State of the adapter's controller.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct SlcanControllerState {
    /// Fault confinement state.
    pub confinement: SlcanConfinement,
    /// Receive error counter.
    pub receive_errors: u16,
    /// Transmit error counter.
    pub transmit_errors: u16,
}

impl SlcanConfinement {
    /// Example: `error passive`.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Active => "error active",
            Self::Warning => "error warning",
            Self::Passive => "error passive",
            Self::BusOff => "bus-off",
        }
    }
}

/// Example: `error passive, rx 130 tx 5`.
impl fmt::Display for SlcanControllerState {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let name = self.confinement.name();
        write!(f, "{name}, rx {} tx {}", self.receive_errors, self.transmit_errors)
    }
}

/// A reply of an adapter.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum SlcanReply {
    /// A frame without number and time, on bus 0, and the adapter's milliseconds, which restart each minute.
    Frame(Frame, Option<u16>),
    /// The last command was executed.
    Done,
    /// The last command was refused.
    Refused,
    /// Status flags of the adapter.
    Flags(StatusFlags),
    /// New state of the controller; the corresponding error frame follows.
    State(SlcanControllerState),
    /// An unknown line: the text found and the text expected, already escaped.
    Unreadable(String),
}

/// Parses an adapter's output, which may arrive in pieces of any size.
#[derive(Debug, Clone, Default)]
pub struct SlcanReader {
    begun: PendingReply,
}

impl SlcanReader {
    /// Parses `input`, the continuation of the previous input, and passes each complete reply to `give`.
    pub fn read_input(&mut self, input: &[u8], mut give: impl FnMut(SlcanReply)) {
        let mut rest = input;
        while let Some(end) = memchr::memchr2(CR, BEL, rest) {
            let (piece, behind) = rest.split_at_checked(end).unwrap_or((rest, &[]));
            let (is_refused, after) = match behind {
                [first, after @ ..] => (*first == BEL, after),
                [] => (false, behind),
            };
            rest = after;
            if self.begun.bytes.is_empty() && piece.len() <= LONGEST_LINE {
                parse_line(piece, is_refused, &mut give);
                continue;
            }
            self.begun.append_piece(piece, LONGEST_LINE);
            if self.begun.is_too_long {
                let start = line_excerpt(&self.begun.bytes);
                give(SlcanReply::Unreadable(format!(
                    "slcan: line too long (max {LONGEST_LINE} bytes); found {start}"
                )));
                if is_refused {
                    give(SlcanReply::Refused);
                }
            } else {
                parse_line(&self.begun.bytes, is_refused, &mut give);
            }
            self.begun.clear();
        }
        self.begun.append_piece(rest, LONGEST_LINE);
    }

    /// Discards an incomplete line: the next input is from another connection.
    pub fn reset(&mut self) {
        self.begun.clear();
    }
}

/// Parses one line; a refusal within a line ends it early.
fn parse_line(line: &[u8], is_refused: bool, give: &mut impl FnMut(SlcanReply)) {
    // Firmware that ends its lines with CR LF leaves the LF at the start of the next line.
    let line = line.trim_ascii();
    let unreadable =
        |what: &str| SlcanReply::Unreadable(format!("slcan: {what}; found {}", line_excerpt(line)));
    if is_refused {
        if !line.is_empty() {
            give(unreadable("incomplete line"));
        }
        return give(SlcanReply::Refused);
    }
    match line {
        [] => give(SlcanReply::Done),
        [b'F', digits @ ..] => {
            give(match parse_hexadecimal(digits).and_then(|flags| u8::try_from(flags).ok()) {
                Some(flags) if digits.len() == 2 => SlcanReply::Flags(StatusFlags(flags)),
                _ => unreadable("expected two hex digits of status flags after F"),
            });
        }
        [b's', rest @ ..] => match parse_state(rest) {
            Some(state) => {
                give(SlcanReply::State(state));
                give(SlcanReply::Frame(state_frame(state), None));
            }
            None => give(unreadable("expected s, then a, w, p or b, and two counters of three digits")),
        },
        [b'e', rest @ ..] => give(match error_frame(rest) {
            Some(frame) => SlcanReply::Frame(frame, None),
            None => unreadable("expected e, a count and that number of letters of a, b, B, c, f, o, O, s"),
        }),
        line => give(match frame_of_line(line) {
            Some(Ok((frame, milliseconds))) => SlcanReply::Frame(frame, milliseconds),
            Some(Err(what)) => unreadable(what),
            None => unreadable("expected a frame (t, T, r, R, d, D, b, B), F, s or e"),
        }),
    }
}

/// Parses a line of text as an adapter sends it; `None` if it does not begin with the letter of a frame.
pub(in crate::capture) fn frame_of_line(line: &[u8]) -> Option<Result<(Frame, Option<u16>), &'static str>> {
    let (kind, rest) = line.split_first()?;
    let (_, is_extended, flags) = KINDS.iter().find(|(letter, ..)| letter == kind)?;
    Some(parse_frame(*is_extended, *flags, rest))
}

/// Parses a report of the controller's state or of bus errors into its error frame.
pub(in crate::capture) fn report_of_line(line: &[u8]) -> Option<Frame> {
    match line {
        [b's', rest @ ..] => parse_state(rest).map(state_frame),
        [b'e', rest @ ..] => error_frame(rest),
        _ => None,
    }
}

/// Per frame type: its letter, whether the identifier has 29 bits, and its flags.
const KINDS: [(u8, bool, FrameFlags); 8] = [
    (b't', false, FrameFlags(0)),
    (b'T', true, FrameFlags(0)),
    (b'r', false, FrameFlags::REMOTE),
    (b'R', true, FrameFlags::REMOTE),
    (b'd', false, FrameFlags::FD),
    (b'D', true, FrameFlags::FD),
    (b'b', false, FrameFlags::FD.with(FrameFlags::BIT_RATE_SWITCH)),
    (b'B', true, FrameFlags::FD.with(FrameFlags::BIT_RATE_SWITCH)),
];

/// Parses a frame after its letter.
fn parse_frame(
    is_extended: bool,
    flags: FrameFlags,
    rest: &[u8],
) -> Result<(Frame, Option<u16>), &'static str> {
    const SHORT: &str = "frame: ends before its identifier and DLC";
    let (digits, rest) = rest.split_at_checked(if is_extended { 8 } else { 3 }).ok_or(SHORT)?;
    let number = parse_hexadecimal(digits).ok_or("identifier: expected hex digits")?;
    let id = match u16::try_from(number) {
        Ok(number) if !is_extended && number <= 0x7FF => CanId::from_standard(number),
        _ if is_extended && number <= 0x1FFF_FFFF => CanId::from_extended(number),
        _ => return Err("identifier: expected at most 7FF, or 1FFFFFFF after a capital letter"),
    };
    let (dlc, rest) = rest.split_first().ok_or(SHORT)?;
    let dlc = char::from(*dlc).to_digit(16).and_then(|dlc| u8::try_from(dlc).ok());
    let dlc = dlc.ok_or("DLC: expected a hex digit")?;
    let mut frame = Frame { id, flags, ..Frame::EMPTY };
    if flags.contains(FrameFlags::FD) {
        frame.length = fd_length(dlc);
    } else {
        // The DLC of classic frames may be 9 to 15; they have eight data bytes (ISO 11898-1).
        frame.length = dlc.min(8);
        frame.raw_dlc = if dlc > 8 { dlc } else { 0 };
    }
    let count = if flags.contains(FrameFlags::REMOTE) { 0 } else { usize::from(frame.length) };
    let (data, rest) = rest.split_at_checked(2 * count).ok_or("data: fewer bytes than the DLC")?;
    for (slot, digits) in frame.bytes.iter_mut().zip(data.chunks_exact(2)) {
        let byte = parse_hexadecimal(digits).and_then(|byte| u8::try_from(byte).ok());
        *slot = byte.ok_or("data: expected pairs of hex digits")?;
    }
    let stamp = match rest.len() {
        0 => None,
        4 => Some(parse_hexadecimal(rest).and_then(|stamp| u16::try_from(stamp).ok()).ok_or(STAMP)?),
        _ => return Err(STAMP),
    };
    Ok((frame, stamp))
}

const STAMP: &str = "after the data: expected nothing or four hex digits of milliseconds";

/// Parses a state: one letter and two counters of three digits.
fn parse_state(rest: &[u8]) -> Option<SlcanControllerState> {
    let [letter, counters @ ..] = rest else { return None };
    let confinement = match letter {
        b'a' => SlcanConfinement::Active,
        b'w' => SlcanConfinement::Warning,
        b'p' => SlcanConfinement::Passive,
        b'b' => SlcanConfinement::BusOff,
        _ => return None,
    };
    if counters.len() != 6 || !counters.iter().all(u8::is_ascii_digit) {
        return None;
    }
    let number =
        |digits: &[u8]| digits.iter().fold(0_u16, |value, digit| value * 10 + u16::from(digit - b'0'));
    let (receive, transmit) = counters.split_at_checked(3)?;
    Some(SlcanControllerState {
        confinement,
        receive_errors: number(receive),
        transmit_errors: number(transmit),
    })
}

/// The error frame that SocketCAN creates for a state (linux/can/error.h): counters in bytes 6 and 7.
pub(super) fn state_frame(state: SlcanControllerState) -> Frame {
    const CONTROLLER: u32 = 0x004;
    const BUS_OFF: u32 = 0x040;
    const COUNTERS: u32 = 0x200;
    let [transmit, receive] =
        [state.transmit_errors, state.receive_errors].map(|count| u8::try_from(count).unwrap_or(u8::MAX));
    let (is_receive, is_transmit) = (receive >= transmit, transmit >= receive);
    let either = |on_receive: u8, on_transmit: u8| {
        (if is_receive { on_receive } else { 0 }) | (if is_transmit { on_transmit } else { 0 })
    };
    let (class, controller) = match state.confinement {
        SlcanConfinement::Active => (CONTROLLER, 0x40),
        SlcanConfinement::Warning => (CONTROLLER, either(0x04, 0x08)),
        SlcanConfinement::Passive => (CONTROLLER, either(0x10, 0x20)),
        SlcanConfinement::BusOff => (BUS_OFF, 0),
    };
    build_error_frame(class | COUNTERS, [0, controller, 0, 0, 0, 0, transmit, receive])
}

fn build_error_frame(classes: u32, bytes: [u8; 8]) -> Frame {
    Frame { flags: FrameFlags::ERROR, ..Frame::data_frame(CanId::from_extended(classes), &bytes) }
}

/// Letter of a bus error, its class in addition to "protocol" and "bus error", index of the byte in the error
/// frame, and the bits in that byte (linux/can/error.h).
const ERRORS: [(u8, u32, usize, u8); 8] = [
    (b'a', 0x20, 3, 0x19),
    (b'b', 0, 2, 0x08),
    (b'B', 0, 2, 0x10),
    (b'c', 0, 3, 0x08),
    (b'f', 0, 2, 0x02),
    (b'o', 0x04, 1, 0x01),
    (b'O', 0x04, 1, 0x02),
    (b's', 0, 2, 0x04),
];

/// Parses a count and its letters into the error frame that SocketCAN creates for them.
fn error_frame(rest: &[u8]) -> Option<Frame> {
    let (count, letters) = rest.split_first()?;
    let count = usize::from(count.checked_sub(b'0')?);
    if letters.is_empty() || letters.len() != count || count > 8 {
        return None;
    }
    let mut classes = 0x08 | 0x80;
    let mut bytes = [0; 8];
    for letter in letters {
        let (_, class, index, bits) = ERRORS.iter().find(|(known, ..)| known == letter)?;
        classes |= class;
        *bytes.get_mut(*index)? |= bits;
    }
    Some(build_error_frame(classes, bytes))
}

#[cfg(test)]
mod tests;
