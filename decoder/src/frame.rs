//! One CAN frame of a capture or a live bus.
//!
//! All later stages work on [`Frame`]: 11-bit and 29-bit identifiers (ISO 11898-1), classic and
//! FD payloads, remote frames, and the error frames that SocketCAN creates from controller reports.

use std::fmt;

/// Maximum payload of a frame in bytes: CAN FD. CAN XL is not supported.
pub const MAX_DATA: usize = 64;

/// Nanoseconds since the zero of the clock, which depends on the capture (Unix epoch or its first frame).
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Default)]
pub struct Timestamp(pub i64);

impl Timestamp {
    /// Nanoseconds from `earlier` to `self`, saturating.
    pub const fn since(self, earlier: Self) -> i64 {
        self.0.saturating_sub(earlier.0)
    }

    /// Whether the time counts from 1970. Times of less than three years count from the start of a capture.
    pub const fn has_date(self) -> bool {
        self.0 >= 100_000_000 * 1_000_000_000
    }

    /// This time plus `nanoseconds`, saturating.
    #[must_use]
    pub const fn plus(self, nanoseconds: i64) -> Self {
        Self(self.0.saturating_add(nanoseconds))
    }
}

/// Seconds with nine decimals, as in the JSON output.
impl fmt::Display for Timestamp {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let sign = if self.0 < 0 { "-" } else { "" };
        let nanoseconds = self.0.unsigned_abs();
        write!(f, "{sign}{}.{:09}", nanoseconds / 1_000_000_000, nanoseconds % 1_000_000_000)
    }
}

/// Index of a bus within one capture; the reader has its name.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Default)]
pub struct BusIndex(pub u8);

/// State of the link to a bus.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum LinkState {
    /// Connected: frames are received.
    Up,
    /// The interface is switched off, or its controller is bus off.
    Down,
    /// The interface, adapter or server no longer exists.
    Gone,
}

impl LinkState {
    /// All states.
    pub const ALL: [Self; 3] = [Self::Up, Self::Down, Self::Gone];

    /// Name of the state: `up`, `down` or `gone`.
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
    /// A base identifier; bits above the eleventh are dropped.
    pub const fn from_standard(id: u16) -> Self {
        Self::Standard(id & 0x7FF)
    }

    /// An extended identifier; bits above the 29th are dropped.
    pub const fn from_extended(id: u32) -> Self {
        Self::Extended(id & 0x1FFF_FFFF)
    }

    /// Value of the identifier, of either type.
    pub const fn number(self) -> u32 {
        match self {
            Self::Standard(id) => id as u32,
            Self::Extended(id) => id,
        }
    }
}

/// Hexadecimal without 0x, three or eight digits, as in candump.
impl fmt::Display for CanId {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Standard(id) => write!(f, "{id:03X}"),
            Self::Extended(id) => write!(f, "{id:08X}"),
        }
    }
}

/// Set of flags that describe the type of a frame.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct FrameFlags(pub u8);

impl FrameFlags {
    /// A remote frame: requests data and contains none; its length is the number of bytes requested.
    pub const REMOTE: Self = Self(1);
    /// An error report of a controller; the identifier contains the SocketCAN error class bits.
    pub const ERROR: Self = Self(1 << 1);
    /// A CAN FD frame.
    pub const FD: Self = Self(1 << 2);
    /// FD: bit rate switched for the data phase.
    pub const BIT_RATE_SWITCH: Self = Self(1 << 3);
    /// FD: the transmitter was error passive.
    pub const ERROR_STATE: Self = Self(1 << 4);
    /// The host that recorded the capture transmitted this frame.
    pub const TRANSMITTED: Self = Self(1 << 5);
    /// The host that recorded the capture received this frame; only set if the capture states it.
    pub const RECEIVED: Self = Self(1 << 6);

    /// Whether all bits of `other` are set.
    pub const fn contains(self, other: Self) -> bool {
        self.0 & other.0 == other.0
    }

    /// Union of both sets.
    #[must_use]
    pub const fn with(self, other: Self) -> Self {
        Self(self.0 | other.0)
    }

    /// Whether the frame is neither remote, error nor FD: a data frame as used by CANopen and J1939.
    pub const fn is_classic_data(self) -> bool {
        self.0 & (Self::REMOTE.0 | Self::ERROR.0 | Self::FD.0) == 0
    }
}

/// The lowest `count` bits of a word; all from 64 on.
#[inline]
pub(crate) const fn low_bits(count: u32) -> u64 {
    if count >= u64::BITS { u64::MAX } else { (1 << count) - 1 }
}

/// One frame. Its payload is stored inline, so that a batch of frames is one contiguous block of memory.
#[derive(Clone, Copy)]
pub struct Frame {
    /// Number of the frame in its capture, from 1; unreadable frames are not counted.
    pub number: u64,
    /// Time of recording; `None` if the capture has no times.
    pub time: Option<Timestamp>,
    /// Bus of the frame.
    pub bus: BusIndex,
    /// Identifier; for error frames the SocketCAN error class bits as [`CanId::Extended`].
    pub id: CanId,
    /// Type of the frame.
    pub flags: FrameFlags,
    /// Payload length in bytes (0..=64); of a remote frame the number of bytes requested.
    pub length: u8,
    /// The DLC as transmitted if above the length: 9..=15 on a classic frame of eight bytes; otherwise 0.
    pub raw_dlc: u8,
    /// Payload; only the first `length` bytes are valid.
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

    /// A classic data frame; bytes of `data` beyond the 64th are dropped.
    pub fn data_frame(id: CanId, data: &[u8]) -> Self {
        let mut frame = Self { id, ..Self::EMPTY };
        frame.set_data(data);
        frame
    }

    /// Replaces the payload; bytes beyond the 64th are dropped.
    pub fn set_data(&mut self, data: &[u8]) {
        let length = data.len().min(MAX_DATA);
        if let (Some(target), Some(source)) = (self.bytes.get_mut(..length), data.get(..length)) {
            target.copy_from_slice(source);
        }
        self.length = u8::try_from(length).unwrap_or(0);
    }

    /// The DLC (ISO 11898-1 table 5): `raw_dlc` if it is set, otherwise the smallest DLC for the payload.
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

/// Bits of a classic frame with an 11-bit identifier and no data, with intermission and without stuff bits
/// (ISO 11898-1 §10.4): 1 SOF, 14 identifier, RTR, IDE and r0, 4 DLC, 15 CRC, 10 up to the end of frame, 3 intermission.
const SHORTEST_FRAME: i64 = 47;

/// Further bits of a 29-bit identifier: 18 identifier, SRR and r1.
const EXTENDED_BITS: i64 = 20;

/// Time of a bit in ns at 1 Mbit/s, the fastest classic bus.
const CLASSIC_BIT: i64 = 1_000;

/// Time of a bit in ns at 8 Mbit/s, the fastest data phase of CAN FD.
const FD_BIT: i64 = 125;

/// Class of reports that contain only error counters (linux/can/error.h, `CAN_ERR_CNT`).
const COUNTERS_ONLY: u32 = 0x200;

impl Frame {
    /// Whether this is an error frame. New error counters alone are a state of the controller, not an error on the bus.
    pub fn reports_error(&self) -> bool {
        self.flags.contains(FrameFlags::ERROR) && self.id.number() != COUNTERS_ONLY
    }

    /// Shortest time on a bus in ns: at 1 Mbit/s, or 8 Mbit/s for an FD frame, without stuff bits. 0 for an error frame.
    pub fn shortest_time(&self) -> i64 {
        if self.flags.contains(FrameFlags::ERROR) {
            return 0;
        }
        let extended = if matches!(self.id, CanId::Extended(_)) { EXTENDED_BITS } else { 0 };
        let bits = SHORTEST_FRAME + extended + 8 * i64::try_from(self.data().len()).unwrap_or(0);
        bits * if self.flags.contains(FrameFlags::FD) { FD_BIT } else { CLASSIC_BIT }
    }
}

/// Times of the frames of one bus, compared with the fastest bus that exists.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct FrameRate {
    frames: u64,
    earliest: i64,
    latest: i64,
    /// Sum of the shortest times of all frames but the first, in ns.
    shortest: i64,
    has_fd: bool,
}

impl FrameRate {
    /// Minimum number of frames whose rate is judged: adapters pass a few frames at once, with one time.
    const JUDGED: u64 = 20;

    /// The rate of a bus after its first frame at `time`.
    pub fn new(time: Timestamp) -> Self {
        Self { frames: 1, earliest: time.0, latest: time.0, shortest: 0, has_fd: false }
    }

    /// Adds a further frame.
    pub fn add_frame(&mut self, time: Timestamp, frame: &Frame) {
        self.frames = self.frames.saturating_add(1);
        (self.earliest, self.latest) = (self.earliest.min(time.0), self.latest.max(time.0));
        self.shortest = self.shortest.saturating_add(frame.shortest_time());
        self.has_fd |= frame.flags.contains(FrameFlags::FD);
    }

    /// Whether a bus can carry the frames if each nanosecond of their times stands for `scale` of them. Fewer than 20
    /// frames are not judged.
    pub fn is_possible(&self, scale: i64) -> bool {
        let span = self.latest.saturating_sub(self.earliest).saturating_mul(scale);
        self.frames < Self::JUDGED || span >= self.shortest
    }

    /// Frames per second by the times, and the most that the fastest bus carries; `None` if the times are all equal.
    pub fn frames_per_second(&self) -> Option<(u64, u64)> {
        let rate = |time: i64| {
            let nanoseconds = u64::try_from(time).ok()?;
            self.frames.saturating_sub(1).saturating_mul(1_000_000_000).checked_div(nanoseconds)
        };
        Some((rate(self.latest.saturating_sub(self.earliest))?, rate(self.shortest)?))
    }

    /// Bit rate of the fastest bus for these frames, as text.
    pub const fn fastest_bus(&self) -> &'static str {
        if self.has_fd { "CAN FD with 8 Mbit/s" } else { "CAN with 1 Mbit/s" }
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

/// One line, similar to candump's log form.
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

/// Payload length in bytes of a CAN FD DLC (ISO 11898-1 table 5); a DLC above 15 is treated as 15.
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

/// Whether a CAN FD frame can have this length in bytes.
pub const fn is_fd_length(length: u8) -> bool {
    matches!(length, 0..=8 | 12 | 16 | 20 | 24 | 32 | 48 | 64)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_shortest_frame_has_47_bits() {
        // ISO 11898-1: 44 bits up to the end of frame, and 3 of intermission; 64 with 29 bits.
        let base = Frame::data_frame(CanId::from_standard(1), &[]);
        let extended = Frame::data_frame(CanId::from_extended(1), &[0; 8]);
        let fd = Frame { flags: FrameFlags::FD, ..extended };
        let remote = Frame { flags: FrameFlags::REMOTE, length: 8, ..base };
        let times = [base, extended, fd, remote].map(|frame| frame.shortest_time());
        assert_eq!(times, [47_000, 131_000, 16_375, 47_000]);
    }

    #[test]
    fn a_rate_above_every_bus_is_impossible_from_20_frames_on() {
        let frame = Frame::data_frame(CanId::from_standard(1), &[]);
        for (count, step, is_possible) in
            [(20, 47_000, true), (20, 46_999, false), (19, 1, true), (20, 0, false)]
        {
            let mut rate = FrameRate::new(Timestamp(5));
            (1..count).for_each(|index| rate.add_frame(Timestamp(5 + index * step), &frame));
            assert_eq!(rate.is_possible(1), is_possible, "{count} frames, {step} ns apart");
            assert_eq!(rate.is_possible(1_000), step > 0 || is_possible);
        }
        let mut rate = FrameRate::new(Timestamp(0));
        rate.add_frame(Timestamp(1_000), &frame);
        assert_eq!(rate.frames_per_second(), Some((1_000_000, 21_276)));
    }

    #[test]
    fn a_remote_frame_has_a_length_but_no_data() {
        let mut frame = Frame::data_frame(CanId::from_standard(0x701), &[1]);
        frame.flags = FrameFlags::REMOTE;
        assert_eq!(frame.length, 1);
        assert_eq!(frame.data(), &[] as &[u8]);
    }

    #[test]
    fn identifiers_are_cut_to_their_width_and_print_as_candump_does() {
        assert_eq!(CanId::from_standard(0xF81).to_string(), "781");
        assert_eq!(CanId::from_extended(0xFFFF_FFFF).to_string(), "1FFFFFFF");
    }

    #[test]
    fn negative_times_keep_their_sign() {
        assert_eq!(Timestamp(-1_500_000_000).to_string(), "-1.500000000");
        assert_eq!(Timestamp(1_700_000_000_000_000_001).to_string(), "1700000000.000000001");
    }

    #[test]
    fn a_dlc_is_the_one_sent_or_the_least_that_holds_the_payload() {
        let frame = Frame::data_frame(CanId::from_standard(1), &[0; 8]);
        assert_eq!((frame.dlc(), Frame { raw_dlc: 13, ..frame }.dlc()), (8, 13));
        let of = |length| Frame { length, flags: FrameFlags::FD, ..Frame::EMPTY }.dlc();
        assert_eq!([0, 8, 9, 12, 13, 48, 49, 64].map(of), [0, 8, 9, 9, 10, 14, 15, 15]);
    }

    #[test]
    fn data_longer_than_fd_allows_is_cut() {
        let frame = Frame::data_frame(CanId::from_standard(1), &[7; 80]);
        assert_eq!(frame.data().len(), 64);
    }
}
