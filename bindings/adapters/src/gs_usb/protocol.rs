//! Requests, structures and frames of the gs_usb protocol; all values are little-endian.
//!
//! Source: Linux, drivers/net/can/usb/gs_usb.c; candleLight_fw, include/gs_usb.h. Identifiers and error frames have the
//! layout of linux/can.h and linux/can/error.h.

use crate::{AdapterErrorFrame, ErrorCounters, FaultConfinement, ReceivedFrame, ReceivedItem};

/// Features and modes (`GS_CAN_FEATURE_…`, `GS_CAN_MODE_…`), the same bits in both.
const LISTEN_ONLY: u32 = 1 << 0;
const TIMESTAMPS: u32 = 1 << 4;
const BUS_ERRORS: u32 = 1 << 12;
/// Feature only: the error counters can be read.
const STATE: u32 = 1 << 13;

/// Value of `mode` in a mode request: off the bus, and on the bus.
const RESET: u32 = 0;
const START: u32 = 1;

/// Byte order of this protocol; devices that know no other one ignore the request.
const BYTE_ORDER: u32 = 0x0000_BEEF;

/// Number of a received frame; others are echoes of transmitted frames.
const RECEIVED: u32 = u32::MAX;

/// Flags of a frame (`GS_CAN_FLAG_…`).
const OVERFLOW: u8 = 1 << 0;
const FD: u8 = 1 << 1;

/// Bits of an identifier (linux/can.h).
const EXTENDED: u32 = 0x8000_0000;
const REMOTE: u32 = 0x4000_0000;
const ERROR: u32 = 0x2000_0000;
const ID: u32 = 0x1FFF_FFFF;

/// Classes of error frames, and causes in data byte 1 of a controller error (linux/can/error.h).
const CONTROLLER: u32 = 0x4;
const BUS_OFF: u32 = 0x40;
const RESTARTED: u32 = 0x100;
const WARNING: u8 = 0x04 | 0x08;
const PASSIVE: u8 = 0x10 | 0x20;
const ACTIVE: u8 = 0x40;

/// Bytes of a classic frame without and with its timestamp.
const FRAME: usize = 20;
const STAMPED_FRAME: usize = 24;

/// A command to the adapter. None of them transmits a frame.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum AdapterCommand {
    /// States the byte order of this protocol.
    ByteOrder,
    /// Takes the channel off the bus.
    Reset,
    /// Sets the bit timing of the channel.
    Timing(BitTiming),
    /// Joins the bus in listen-only mode.
    Listen {
        /// Frames have timestamps of the adapter.
        has_stamps: bool,
        /// The adapter reports bus errors.
        has_bus_errors: bool,
    },
}

/// A question to the adapter.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum AdapterQuestion {
    /// Number of channels and versions.
    Device,
    /// Features of the channel, and limits of its bit timing.
    Constants,
    /// State of the controller of the channel, with its error counters.
    State,
}

impl AdapterCommand {
    /// Number of the request (`GS_USB_BREQ_…`).
    pub(super) const fn request(self) -> u8 {
        match self {
            Self::ByteOrder => 0,
            Self::Timing(_) => 1,
            Self::Reset | Self::Listen { .. } => 2,
        }
    }

    /// Whether it concerns the device instead of a channel.
    pub(super) const fn is_of_device(self) -> bool {
        matches!(self, Self::ByteOrder)
    }

    /// Data of the request.
    pub(super) fn data(self) -> Vec<u8> {
        let words = match self {
            Self::ByteOrder => vec![BYTE_ORDER],
            Self::Reset => vec![RESET, 0],
            Self::Timing(timing) => {
                vec![timing.propagation, timing.phase_1, timing.phase_2, timing.jump_width, timing.prescaler]
            }
            Self::Listen { has_stamps, has_bus_errors } => {
                let stamps = if has_stamps { TIMESTAMPS } else { 0 };
                let errors = if has_bus_errors { BUS_ERRORS } else { 0 };
                vec![START, LISTEN_ONLY | stamps | errors]
            }
        };
        words.into_iter().flat_map(u32::to_le_bytes).collect()
    }
}

impl AdapterQuestion {
    /// Number of the request (`GS_USB_BREQ_…`).
    pub(super) const fn request(self) -> u8 {
        match self {
            Self::Constants => 4,
            Self::Device => 5,
            Self::State => 14,
        }
    }

    /// Whether it concerns the device instead of a channel.
    pub(super) const fn is_of_device(self) -> bool {
        matches!(self, Self::Device)
    }

    /// Length of the answer in bytes.
    pub(super) const fn length(self) -> u16 {
        match self {
            Self::Constants => 40,
            Self::Device | Self::State => 12,
        }
    }
}

/// A bit timing in time quanta, `gs_device_bittiming`.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct BitTiming {
    /// Propagation segment.
    pub(super) propagation: u32,
    /// Phase segment 1.
    pub(super) phase_1: u32,
    /// Phase segment 2.
    pub(super) phase_2: u32,
    /// Synchronization jump width.
    pub(super) jump_width: u32,
    /// Periods of the clock per time quantum.
    pub(super) prescaler: u32,
}

/// Features of a channel, and limits of its bit timing, `gs_device_bt_const`.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct ChannelConstants {
    features: u32,
    /// Clock of the CAN controller in Hz.
    pub(super) clock: u32,
    /// Propagation segment and phase segment 1 together, min and max.
    pub(super) segment_1: (u32, u32),
    /// Phase segment 2, min and max.
    pub(super) segment_2: (u32, u32),
    /// Max synchronization jump width.
    pub(super) max_jump_width: u32,
    /// Prescaler, min and max.
    pub(super) prescaler: (u32, u32),
    /// Difference between two prescalers.
    pub(super) prescaler_step: u32,
}

impl ChannelConstants {
    /// The constants in an answer; `None` if it is too short.
    pub(super) fn parse(answer: &[u8]) -> Option<Self> {
        let word = |index: usize| read_word(answer, index);
        Some(Self {
            features: word(0)?,
            clock: word(1)?,
            segment_1: (word(2)?, word(3)?),
            segment_2: (word(4)?, word(5)?),
            max_jump_width: word(6)?,
            prescaler: (word(7)?, word(8)?),
            prescaler_step: word(9)?,
        })
    }

    /// Whether the adapter has listen-only mode.
    pub(super) const fn has_listen_only(&self) -> bool {
        self.features & LISTEN_ONLY != 0
    }

    /// Whether frames can have timestamps of the adapter.
    pub(super) const fn has_stamps(&self) -> bool {
        self.features & TIMESTAMPS != 0
    }

    /// Whether the adapter can report bus errors.
    pub(super) const fn has_bus_errors(&self) -> bool {
        self.features & BUS_ERRORS != 0
    }

    /// Whether the error counters can be read.
    pub(super) const fn has_state(&self) -> bool {
        self.features & STATE != 0
    }
}

/// Number of channels, `icount` + 1 of `gs_device_config`; `None` if the answer is too short.
pub(super) fn channel_count(answer: &[u8]) -> Option<u16> {
    answer.get(3).map(|last| u16::from(*last) + 1)
}

/// Error counters of the controller, in `gs_device_state`; `None` if the answer is too short.
pub(super) fn parse_counters(answer: &[u8]) -> Option<ErrorCounters> {
    let counter = |index| Some(u8::try_from(read_word(answer, index)?).unwrap_or(u8::MAX));
    Some(ErrorCounters { receive: counter(1)?, transmit: counter(2)? })
}

fn read_word(bytes: &[u8], index: usize) -> Option<u32> {
    let (words, _) = bytes.as_chunks::<4>();
    words.get(index).map(|word| u32::from_le_bytes(*word))
}

/// Appends what a transfer contains. `arrival` is the timestamp in µs if the adapter gives none.
pub(super) fn read_transfer(
    bytes: &[u8],
    channel: u8,
    has_stamps: bool,
    arrival: u32,
    readings: &mut Vec<ReceivedItem>,
) {
    let expected = if has_stamps { STAMPED_FRAME } else { FRAME };
    if bytes.is_empty() {
        return;
    }
    let header = (read_word(bytes, 0), read_word(bytes, 1), bytes.get(8..12), bytes.get(12..FRAME));
    let (Some(number), Some(id), Some(&[length, of, flags, _]), Some(data)) = header else {
        return readings.push(too_short(bytes.len(), expected));
    };
    if of != channel {
        return;
    }
    if number != RECEIVED {
        readings.push(ReceivedItem::Invalid(format!(
            "echo {number} of a transmitted frame from the adapter; expected only received frames"
        )));
        return;
    }
    if flags & FD != 0 {
        readings
            .push(ReceivedItem::Invalid("CAN FD frame from the adapter; expected a classic frame".into()));
    } else {
        let stamp = if has_stamps { read_word(bytes, 5) } else { Some(arrival) };
        let Some(stamp) = stamp else { return readings.push(too_short(bytes.len(), expected)) };
        let mut content = [0; 8];
        content.iter_mut().zip(data).for_each(|(to, from)| *to = *from);
        readings.push(parse_frame(id, length, content, stamp));
    }
    if flags & OVERFLOW != 0 {
        readings.push(ReceivedItem::Lost);
    }
}

fn too_short(length: usize, expected: usize) -> ReceivedItem {
    ReceivedItem::Invalid(format!("transfer of {length} bytes from the adapter; expected {expected}"))
}

fn parse_frame(id: u32, length: u8, data: [u8; 8], stamp: u32) -> ReceivedItem {
    if id & ERROR != 0 {
        let confinement = reported_confinement(id, data);
        return ReceivedItem::ErrorFrame(AdapterErrorFrame { class: id & ID, data, confinement, stamp });
    }
    // ISO 11898-1: a classic frame with a DLC of 9 to 15 has 8 bytes.
    let length = if length <= 15 { length.min(8) } else { length };
    let (is_extended, is_remote) = (id & EXTENDED != 0, id & REMOTE != 0);
    ReceivedFrame { id: id & ID, is_extended, is_remote, length, data, stamp }.check_frame()
}

/// The state that an error frame reports.
fn reported_confinement(id: u32, data: [u8; 8]) -> Option<FaultConfinement> {
    let [_, cause, ..] = data;
    if id & BUS_OFF != 0 {
        Some(FaultConfinement::BusOff)
    } else if id & RESTARTED != 0 {
        Some(FaultConfinement::Active)
    } else if id & CONTROLLER == 0 {
        None
    } else if cause & PASSIVE != 0 {
        Some(FaultConfinement::Passive)
    } else if cause & WARNING != 0 {
        Some(FaultConfinement::Warning)
    } else if cause & ACTIVE != 0 {
        Some(FaultConfinement::Active)
    } else {
        None
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn readings(bytes: &[u8], has_stamps: bool) -> Vec<ReceivedItem> {
        let mut readings = Vec::new();
        read_transfer(bytes, 0, has_stamps, 77, &mut readings);
        readings
    }

    /// `gs_host_frame`: echo_id, can_id, can_dlc, channel, flags, reserved, data, timestamp_us.
    const FRAME_181: [u8; 24] =
        [255, 255, 255, 255, 0x81, 1, 0, 0, 2, 0, 0, 0, 0x11, 0x22, 0, 0, 0, 0, 0, 0, 0x10, 0x27, 0, 0];

    fn with(changes: &[(usize, u8)]) -> [u8; 24] {
        let mut bytes = FRAME_181;
        for (at, value) in changes {
            bytes[*at] = *value;
        }
        bytes
    }

    #[test]
    fn frames_are_those_of_linux_can() {
        let expected = ReceivedFrame {
            id: 0x181,
            is_extended: false,
            is_remote: false,
            length: 2,
            data: [0x11, 0x22, 0, 0, 0, 0, 0, 0],
            stamp: 10_000,
        };
        assert_eq!(readings(&FRAME_181, true), [ReceivedItem::Frame(expected)]);
        // Without timestamps the time of arrival is used; adapters with FD send longer transfers.
        let arrived = ReceivedItem::Frame(ReceivedFrame { stamp: 77, ..expected });
        assert_eq!(readings(&FRAME_181[..20], false), std::slice::from_ref(&arrived));
        assert_eq!(readings(&[&FRAME_181[..], &[0; 52]].concat(), false), [arrived]);
        let extended = ReceivedFrame { id: 0x18FE_F100, is_extended: true, ..expected };
        let bytes = with(&[(4, 0x00), (5, 0xF1), (6, 0xFE), (7, 0x98)]);
        assert_eq!(readings(&bytes, true), [ReceivedItem::Frame(extended)]);
        let remote = ReceivedFrame { is_remote: true, length: 8, ..expected };
        assert_eq!(readings(&with(&[(7, 0x40), (8, 12)]), true), [ReceivedItem::Frame(remote)]);
    }

    #[test]
    fn an_overflow_follows_its_frame() {
        let found = readings(&with(&[(10, OVERFLOW)]), true);
        assert!(matches!(found[..], [ReceivedItem::Frame(_), ReceivedItem::Lost]), "{found:?}");
    }

    /// linux/can/error.h: controller problem 004 with RX error passive 10; bus off 040.
    #[test]
    fn error_frames_state_the_controller() {
        let error = |class: u32, cause: u8| {
            let [low, high, ..] = class.to_le_bytes();
            let found =
                readings(&with(&[(4, low), (5, high), (7, 0x20), (8, 8), (12, 0), (13, cause)]), true);
            let [ReceivedItem::ErrorFrame(frame)] = found[..] else { panic!("{found:?}") };
            assert_eq!((frame.class, frame.data[1], frame.stamp), (class, cause, 10_000));
            frame.confinement
        };
        assert_eq!(error(0x004, 0x10), Some(FaultConfinement::Passive));
        assert_eq!(error(0x004, 0x04), Some(FaultConfinement::Warning));
        assert_eq!(error(0x004, 0x40), Some(FaultConfinement::Active));
        assert_eq!(error(0x004, 0x01), None, "an overflow is no state");
        assert_eq!(error(0x040, 0), Some(FaultConfinement::BusOff));
        assert_eq!(error(0x100, 0), Some(FaultConfinement::Active));
        assert_eq!(error(0x088, 0x04), None, "byte 1 belongs to controller problems");
    }

    #[test]
    fn what_cannot_be_valid_is_stated() {
        let invalid = |bytes: &[u8], text: &str| {
            assert_eq!(readings(bytes, true), [ReceivedItem::Invalid(text.into())]);
        };
        invalid(&FRAME_181[..20], "transfer of 20 bytes from the adapter; expected 24");
        invalid(&FRAME_181[..3], "transfer of 3 bytes from the adapter; expected 24");
        invalid(
            &with(&[(0, 3), (1, 0), (2, 0), (3, 0)]),
            "echo 3 of a transmitted frame from the adapter; expected only received frames",
        );
        invalid(&with(&[(10, FD)]), "CAN FD frame from the adapter; expected a classic frame");
        invalid(&with(&[(8, 16)]), "length 16 from the driver; expected 0 to 8");
        invalid(&with(&[(5, 0x9)]), "identifier 981 from the driver; expected 0 to 7FF");
        assert_eq!(readings(&[], true), []);
        assert_eq!(readings(&with(&[(9, 1)]), true), [], "of another channel");
    }

    /// gs_usb.c: struct gs_device_mode, bits of `flags`; struct gs_device_bittiming.
    #[test]
    fn commands_have_their_bytes() {
        assert_eq!(AdapterCommand::ByteOrder.data(), [0xEF, 0xBE, 0, 0]);
        assert_eq!(AdapterCommand::Reset.data(), [0; 8]);
        let listen =
            |has_stamps, has_bus_errors| AdapterCommand::Listen { has_stamps, has_bus_errors }.data();
        assert_eq!(listen(false, false), [1, 0, 0, 0, 1, 0, 0, 0]);
        assert_eq!(listen(true, true), [1, 0, 0, 0, 0x11, 0x10, 0, 0]);
        let timing = BitTiming { propagation: 1, phase_1: 2, phase_2: 3, jump_width: 4, prescaler: 0x105 };
        assert_eq!(
            AdapterCommand::Timing(timing).data(),
            [1, 0, 0, 0, 2, 0, 0, 0, 3, 0, 0, 0, 4, 0, 0, 0, 5, 1, 0, 0]
        );
    }

    #[test]
    fn answers_are_parsed() {
        assert_eq!(channel_count(&[0, 0, 0, 1, 2, 0, 0, 0, 1, 0, 0, 0]), Some(2));
        assert_eq!(channel_count(&[0, 0, 0]), None);
        let state = |receive: u16| {
            let [low, high] = receive.to_le_bytes();
            parse_counters(&[2, 0, 0, 0, low, high, 0, 0, 7, 0, 0, 0])
        };
        assert_eq!(state(130), Some(ErrorCounters { receive: 130, transmit: 7 }));
        assert_eq!(state(256), Some(ErrorCounters { receive: 255, transmit: 7 }));
        assert_eq!(parse_counters(&[0; 11]), None);
        assert_eq!(ChannelConstants::parse(&[0; 39]), None);
    }
}
