//! One CAN frame as a capture or a bus delivered it.
//!
//! Everything downstream works on [`Frame`]: 11-bit and 29-bit identifiers (ISO 11898-1), classic and
//! FD payloads, remote frames, and the error frames SocketCAN makes of controller reports.

use std::fmt;

/// Largest payload of a frame in bytes: CAN FD. CAN XL is not represented.
pub const MAX_DATA: usize = 64;

/// Nanoseconds since the clock's zero; which zero depends on the capture (Unix epoch or its first frame).
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Default)]
pub struct Timestamp(pub i64);

impl Timestamp {
    /// Nanoseconds from `earlier` to `self`, saturating.
    pub const fn since(self, earlier: Self) -> i64 {
        self.0.saturating_sub(earlier.0)
    }

    /// This time moved by `nanoseconds`, saturating.
    #[must_use]
    pub const fn plus(self, nanoseconds: i64) -> Self {
        Self(self.0.saturating_add(nanoseconds))
    }
}

/// Seconds with nine digits, as the JSON contract writes them.
impl fmt::Display for Timestamp {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let sign = if self.0 < 0 { "-" } else { "" };
        let nanoseconds = self.0.unsigned_abs();
        write!(f, "{sign}{}.{:09}", nanoseconds / 1_000_000_000, nanoseconds % 1_000_000_000)
    }
}

/// Index of a bus within one capture; the reader knows its name.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Default)]
pub struct BusIndex(pub u8);

/// What the recorder knew of the way to a bus.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum LinkState {
    /// Frames come, if there are any.
    Up,
    /// The interface is there but switched off, or its controller went off the bus.
    Down,
    /// The interface, adapter or server is not there any more.
    Gone,
}

impl LinkState {
    /// All of them.
    pub const ALL: [Self; 3] = [Self::Up, Self::Down, Self::Gone];

    /// `up`, `down` or `gone`.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Up => "up",
            Self::Down => "down",
            Self::Gone => "gone",
        }
    }
}

/// A CAN identifier (ISO 11898-1): 11 or 29 bits.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum CanId {
    /// 11-bit base identifier, 0..=0x7FF.
    Standard(u16),
    /// 29-bit extended identifier, 0..=0x1FFF_FFFF.
    Extended(u32),
}

impl CanId {
    /// A base identifier; bits above the eleventh are cut.
    pub const fn standard(id: u16) -> Self {
        Self::Standard(id & 0x7FF)
    }

    /// An extended identifier; bits above the 29th are cut.
    pub const fn extended(id: u32) -> Self {
        Self::Extended(id & 0x1FFF_FFFF)
    }

    /// The identifier's number without its kind.
    pub const fn number(self) -> u32 {
        match self {
            Self::Standard(id) => id as u32,
            Self::Extended(id) => id,
        }
    }
}

/// Hexadecimal without 0x, three digits or eight, as candump prints it.
impl fmt::Display for CanId {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Standard(id) => write!(f, "{id:03X}"),
            Self::Extended(id) => write!(f, "{id:08X}"),
        }
    }
}

/// What kind of frame it is, as a set of bits.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct FrameFlags(pub u8);

impl FrameFlags {
    /// A remote frame: asks for data, carries none; the length is the one asked for.
    pub const REMOTE: Self = Self(1);
    /// A controller's error report; the identifier holds the SocketCAN class bits.
    pub const ERROR: Self = Self(1 << 1);
    /// A CAN FD frame.
    pub const FD: Self = Self(1 << 2);
    /// FD: bit rate switched for the data phase.
    pub const BIT_RATE_SWITCH: Self = Self(1 << 3);
    /// FD: the sender was error passive.
    pub const ERROR_STATE: Self = Self(1 << 4);
    /// The recording host sent this frame itself.
    pub const TRANSMITTED: Self = Self(1 << 5);
    /// The recording host received this frame (known, not merely unmarked).
    pub const RECEIVED: Self = Self(1 << 6);

    /// Whether all bits of `other` are set.
    pub const fn contains(self, other: Self) -> bool {
        self.0 & other.0 == other.0
    }

    /// Both sets together.
    #[must_use]
    pub const fn with(self, other: Self) -> Self {
        Self(self.0 | other.0)
    }

    /// Neither remote, error nor FD: the frame CANopen and J1939 are made of.
    pub const fn is_classic_data(self) -> bool {
        self.0 & (Self::REMOTE.0 | Self::ERROR.0 | Self::FD.0) == 0
    }
}

/// One frame. Its payload is inline, so a batch of frames is one flat block of memory.
#[derive(Clone, Copy)]
pub struct Frame {
    /// Place in its capture, from 1, counting delivered frames only.
    pub number: u64,
    /// When it was recorded; `None` where the capture has no times.
    pub time: Option<Timestamp>,
    /// Which bus of the capture.
    pub bus: BusIndex,
    /// Identifier; for error frames the SocketCAN error class bits as [`CanId::Extended`].
    pub id: CanId,
    /// Kind of frame.
    pub flags: FrameFlags,
    /// Payload length in bytes (0..=64); of a remote frame the length asked for.
    pub length: u8,
    /// The DLC as sent where it says more than the length: 9..=15 on a classic frame of eight bytes.
    pub raw_dlc: u8,
    /// Payload; only the first `length` bytes mean anything.
    pub bytes: [u8; MAX_DATA],
}

impl Frame {
    /// An empty data frame with identifier 0.
    pub const EMPTY: Self = Self {
        number: 0,
        time: None,
        bus: BusIndex(0),
        id: CanId::Standard(0),
        flags: FrameFlags(0),
        length: 0,
        raw_dlc: 0,
        bytes: [0; MAX_DATA],
    };

    /// A classic data frame; `data` beyond 64 bytes is cut.
    pub fn data_frame(id: CanId, data: &[u8]) -> Self {
        let mut frame = Self { id, ..Self::EMPTY };
        frame.set_data(data);
        frame
    }

    /// Replaces the payload; bytes beyond the 64th are cut.
    pub fn set_data(&mut self, data: &[u8]) {
        let length = data.len().min(MAX_DATA);
        if let (Some(target), Some(source)) = (self.bytes.get_mut(..length), data.get(..length)) {
            target.copy_from_slice(source);
        }
        self.length = u8::try_from(length).unwrap_or(0);
    }

    /// The DLC (ISO 11898-1 table 5): the one sent where it is known to say more than the length, else the least that
    /// holds the payload.
    #[inline]
    pub fn dlc(&self) -> u8 {
        match self.length {
            length if self.flags.contains(FrameFlags::FD) => {
                (0..15).find(|dlc| fd_length(*dlc) >= length).unwrap_or(15)
            }
            _ if self.raw_dlc > 8 => self.raw_dlc,
            length => length,
        }
    }

    /// The payload; empty for remote frames.
    #[inline]
    pub fn data(&self) -> &[u8] {
        if self.flags.contains(FrameFlags::REMOTE) {
            return &[];
        }
        self.bytes.get(..usize::from(self.length)).unwrap_or(&self.bytes)
    }
}

impl PartialEq for Frame {
    fn eq(&self, other: &Self) -> bool {
        self.number == other.number
            && self.time == other.time
            && self.bus == other.bus
            && self.id == other.id
            && self.flags == other.flags
            && self.length == other.length
            && self.raw_dlc == other.raw_dlc
            && self.data() == other.data()
    }
}

impl Eq for Frame {}

/// One line, close to candump's log form.
impl fmt::Debug for Frame {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{{{}}} ", self.number)?;
        if let Some(time) = self.time {
            write!(f, "({time}) ")?;
        }
        write!(f, "bus{} {}#", self.bus.0, self.id)?;
        if self.flags.contains(FrameFlags::REMOTE) {
            write!(f, "R{}", self.length)?;
        }
        for byte in self.data() {
            write!(f, "{byte:02X}")?;
        }
        write!(f, " flags={:02X} dlc={}", self.flags.0, self.raw_dlc)
    }
}

/// Payload length in bytes of a CAN FD DLC (ISO 11898-1 table 5); DLC above 15 counts as 15.
pub const fn fd_length(dlc: u8) -> u8 {
    match dlc {
        0..=8 => dlc,
        9 => 12,
        10 => 16,
        11 => 20,
        12 => 24,
        13 => 32,
        14 => 48,
        _ => 64,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_remote_frame_has_a_length_but_no_data() {
        let mut frame = Frame::data_frame(CanId::standard(0x701), &[1]);
        frame.flags = FrameFlags::REMOTE;
        assert_eq!(frame.length, 1);
        assert_eq!(frame.data(), &[] as &[u8]);
    }

    #[test]
    fn identifiers_are_cut_to_their_width_and_print_as_candump_does() {
        assert_eq!(CanId::standard(0xF81).to_string(), "781");
        assert_eq!(CanId::extended(0xFFFF_FFFF).to_string(), "1FFFFFFF");
    }

    #[test]
    fn negative_times_keep_their_sign() {
        assert_eq!(Timestamp(-1_500_000_000).to_string(), "-1.500000000");
        assert_eq!(Timestamp(1_700_000_000_000_000_001).to_string(), "1700000000.000000001");
    }

    #[test]
    fn a_dlc_is_the_one_sent_or_the_least_that_holds_the_payload() {
        let frame = Frame::data_frame(CanId::standard(1), &[0; 8]);
        assert_eq!((frame.dlc(), Frame { raw_dlc: 13, ..frame }.dlc()), (8, 13));
        let of = |length| Frame { length, flags: FrameFlags::FD, ..Frame::EMPTY }.dlc();
        assert_eq!([0, 8, 9, 12, 13, 48, 49, 64].map(of), [0, 8, 9, 9, 10, 14, 15, 15]);
    }

    #[test]
    fn data_longer_than_fd_allows_is_cut() {
        let frame = Frame::data_frame(CanId::standard(1), &[7; 80]);
        assert_eq!(frame.data().len(), 64);
    }
}
