//! Objects of a capture, converted to frames and notices.

use super::error;
use super::frame::{self, FrameObject};
use super::object::ObjectHeader;
use crate::capture::bus_error::{self, Counters, Violation};
use crate::capture::byte_order::ByteOrder::Little;
use crate::capture::local_time::{LocalClock, TimeOrigin};
use crate::capture::notice::CAN_XL;
use crate::capture::{Batch, BusNames, CapturePlace, MAX_BUSES, Notice};
use crate::frame::{BusIndex, Frame, Timestamp};
use crate::words::count_noun;

const CAN_MESSAGE: u32 = 1;
const CAN_ERROR: u32 = 2;
const CAN_OVERLOAD: u32 = 3;
/// Type of objects that contain other objects.
pub(super) const LOG_CONTAINER: u32 = 10;
const CAN_DRIVER_ERROR: u32 = 31;
const CAN_ERROR_EXT: u32 = 73;
const CAN_DRIVER_ERROR_EXT: u32 = 74;
const CAN_MESSAGE2: u32 = 86;
const OVERRUN_ERROR: u32 = 91;
const CAN_FD_MESSAGE: u32 = 100;
const CAN_FD_MESSAGE_64: u32 = 101;
const CAN_FD_ERROR_64: u32 = 104;
const DATA_LOST_BEGIN: u32 = 125;
const DATA_LOST_END: u32 = 126;

/// Supported object types.
const READ: &[u32] = &[
    CAN_MESSAGE,
    CAN_ERROR,
    CAN_OVERLOAD,
    CAN_DRIVER_ERROR,
    CAN_ERROR_EXT,
    CAN_DRIVER_ERROR_EXT,
    CAN_MESSAGE2,
    OVERRUN_ERROR,
    CAN_FD_MESSAGE,
    CAN_FD_MESSAGE_64,
    CAN_FD_ERROR_64,
    DATA_LOST_BEGIN,
    DATA_LOST_END,
];

/// Object types with messages of other bus systems.
const OTHER_BUSES: &[(&str, &[u32])] = &[
    ("LIN", &[11, 57]),
    ("MOST", &[22, 23, 32, 33, 76, 77, 78, 84, 85]),
    ("FlexRay", &[29, 41, 50, 66]),
    ("J1708", &[55]),
    ("Ethernet", &[71, 120, 121]),
    ("WLAN", &[93]),
    ("AFDX", &[97]),
    ("ARINC 429", &[113]),
];

/// `CAN_XL_CHANNEL_FRAME`.
const CAN_XL_FRAME: u32 = 139;

/// Largest object parsed, in bytes: the largest frame has 64 bytes of data and a few other fields.
pub(super) const LARGEST_OBJECT: usize = 4_096;

/// Bus type of `OVERRUN_ERROR`.
const CAN: u32 = 1;

/// Whether objects of this type are parsed.
pub(super) fn is_read(kind: u32) -> bool {
    READ.contains(&kind)
}

/// State collected from the objects so far.
#[derive(Debug, Clone, Default)]
pub(super) struct ObjectState {
    /// Start of the capture in nanoseconds since 1970, read as UTC: the zero of the times; `None` without a date.
    pub(super) start: Option<i64>,
    clock: LocalClock,
    pub(super) buses: BusNames,
    frames: u64,
    /// Numbers of messages of other bus systems, in the order of [`OTHER_BUSES`].
    others: [u64; OTHER_BUSES.len()],
    /// Position at which the recorder began to lose frames, until it reports their number.
    losing: Option<CapturePlace>,
    /// Last error counters of each channel that reported some; at most [`MAX_BUSES`] channels.
    counters: Vec<(u16, Counters)>,
    stated_request: bool,
    stated_unit: bool,
}

impl ObjectState {
    pub(super) fn new(clock: LocalClock) -> Self {
        Self { clock, ..Self::default() }
    }

    /// Counts a skipped object; a frame of an unsupported type is reported.
    pub(super) fn pass_over(&mut self, kind: u32, place: CapturePlace, batch: &mut Batch) {
        if kind == CAN_XL_FRAME {
            batch.push_unreadable(place, format!("{CAN_XL}: not supported"));
        }
        for ((_, kinds), count) in OTHER_BUSES.iter().zip(&mut self.others) {
            *count += u64::from(kinds.contains(&kind));
        }
    }

    /// Parses one complete object.
    pub(super) fn parse_object(
        &mut self,
        head: ObjectHeader,
        object: &[u8],
        place: CapturePlace,
        batch: &mut Batch,
    ) {
        let body = object.get(head.header..).unwrap_or_default();
        if self.parse_content(head, object, body, place, batch).is_none() {
            let reason = format!("object type {}: {} bytes are too short for the type", head.kind, head.size);
            batch.push_unreadable(place, reason);
        }
    }

    fn parse_content(
        &mut self,
        head: ObjectHeader,
        object: &[u8],
        body: &[u8],
        place: CapturePlace,
        batch: &mut Batch,
    ) -> Option<()> {
        let frame = match head.kind {
            CAN_MESSAGE | CAN_MESSAGE2 => self.add_sent(frame::parse_classic(body)?, batch),
            CAN_FD_MESSAGE => self.add_sent(frame::parse_fd(body)?, batch),
            CAN_FD_MESSAGE_64 => self.add_sent(frame::fd_64(body, head.header)?, batch),
            CAN_ERROR => Some(error::bare_violation(Violation::Other)),
            CAN_OVERLOAD => Some(error::bare_violation(Violation::Overload)),
            CAN_ERROR_EXT => Some(error::parse_extended(body)?),
            CAN_FD_ERROR_64 => Some(error::parse_fd(body)?),
            CAN_DRIVER_ERROR | CAN_DRIVER_ERROR_EXT => self.parse_counters(body)?,
            _ => {
                self.parse_loss(head.kind, body, place, batch)?;
                None
            }
        };
        let Some(frame) = frame else { return Some(()) };
        let channel = match head.kind {
            CAN_FD_MESSAGE_64 | CAN_FD_ERROR_64 => u16::from(*body.first()?),
            _ => Little.u16(body, 0)?,
        };
        let time = self.parse_time(object, batch)?;
        let Some(bus) = self.bus_of_channel(channel) else {
            batch.push_unreadable(place, format!("channel {channel}: more than {MAX_BUSES} channels"));
            return Some(());
        };
        self.frames += 1;
        let origin = self.start.map_or(TimeOrigin::Universal, TimeOrigin::LocalStart);
        let time = self.clock.convert_time(time.0, origin, self.buses.name_of(bus), batch);
        batch.push(Frame { number: self.frames, time: Some(Timestamp(time)), bus, ..frame });
        Some(())
    }

    /// State of a controller: its error counters. Recorders repeat them, so only a change is returned.
    #[expect(clippy::option_option, reason = "a body that is too short, and a report without news")]
    fn parse_counters(&mut self, body: &[u8]) -> Option<Option<Frame>> {
        let (channel, counters) = (Little.u16(body, 0)?, error::parse_counters(body)?);
        let has_room = self.counters.len() < MAX_BUSES;
        match self.counters.iter_mut().find(|(known, _)| *known == channel) {
            Some((_, last)) if *last == counters => return Some(None),
            Some((_, last)) => *last = counters,
            None if has_room => self.counters.push((channel, counters)),
            None => {}
        }
        Some(Some(bus_error::counter_frame(counters)))
    }

    fn add_sent(&mut self, content: FrameObject, batch: &mut Batch) -> Option<Frame> {
        match content {
            FrameObject::Frame(frame) => Some(frame),
            FrameObject::Request => {
                if !std::mem::replace(&mut self.stated_request, true) {
                    let text = "requests to send (TxRq) ignored";
                    batch.add_notice(Notice::Assumption(text.into()));
                }
                None
            }
        }
    }

    fn bus_of_channel(&mut self, channel: u16) -> Option<BusIndex> {
        self.buses.index_of(channel.to_string().as_bytes())
    }

    fn parse_time(&mut self, object: &[u8], batch: &mut Batch) -> Option<Timestamp> {
        let (unit, stamp) = (Little.u32(object, 16)?, Little.u64(object, 24)?);
        let stamp = i64::try_from(stamp).unwrap_or(i64::MAX);
        let elapsed = if unit == 1 { stamp.saturating_mul(10_000) } else { stamp };
        if !matches!(unit, 1 | 2) && !std::mem::replace(&mut self.stated_unit, true) {
            let text = format!("unknown time unit {unit}: times read as nanoseconds");
            batch.add_notice(Notice::Assumption(text));
        }
        Some(Timestamp(self.start.unwrap_or(0)).plus(elapsed))
    }

    /// Handles objects about lost frames.
    fn parse_loss(&mut self, kind: u32, body: &[u8], place: CapturePlace, batch: &mut Batch) -> Option<()> {
        let (bus, count) = match kind {
            OVERRUN_ERROR if Little.u32(body, 0)? == CAN => (self.bus_of_channel(Little.u16(body, 4)?), None),
            DATA_LOST_END => {
                self.losing = None;
                (None, Some(u64::from(Little.u32(body, 12)?)))
            }
            DATA_LOST_BEGIN => {
                self.losing = Some(place);
                return Some(());
            }
            _ => return Some(()),
        };
        batch.add_notice(Notice::LostFrames { place, bus: bus.unwrap_or_default(), count });
        Some(())
    }

    /// Handles the end of the capture.
    pub(super) fn end_capture(&mut self, batch: &mut Batch) {
        if let Some(place) = self.losing.take() {
            batch.add_notice(Notice::LostFrames { place, bus: BusIndex(0), count: None });
        }
        for ((system, _), count) in OTHER_BUSES.iter().zip(self.others).filter(|(_, count)| *count > 0) {
            let text = format!("{} of {system} skipped", count_noun(count, "message"));
            batch.add_notice(Notice::Assumption(text));
        }
    }
}
