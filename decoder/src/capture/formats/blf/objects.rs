//! Objects of a capture, converted to frames and notices.

use super::error;
use super::frame::{self, FrameObject};
use super::object::ObjectHeader;
use crate::capture::bus_error::{self, Counters, Violation};
use crate::capture::byte_order::ByteOrder::Little;
use crate::capture::{Batch, BusNames, CapturePlace, MAX_BUSES, Notice};
use crate::frame::{BusIndex, Frame, Timestamp};

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

/// Object types of other bus systems: LIN, MOST, FlexRay, J1708, Ethernet, WLAN, AFDX, ARINC 429.
const OTHER_BUSES: &[u32] =
    &[11, 22, 23, 29, 32, 33, 41, 50, 55, 57, 66, 71, 76, 77, 78, 84, 85, 93, 97, 113, 120, 121];

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
    /// Start of the capture in nanoseconds since 1970: the zero of the times.
    pub(super) start: i64,
    pub(super) buses: BusNames,
    frames: u64,
    /// Number of messages of other bus systems.
    others: u64,
    /// Position at which the recorder began to lose frames, until it reports their number.
    losing: Option<CapturePlace>,
    /// Last error counters of each channel that reported some; at most [`MAX_BUSES`] channels.
    counters: Vec<(u16, Counters)>,
    stated_request: bool,
    stated_unit: bool,
}

impl ObjectState {
    /// Counts a skipped object.
    pub(super) fn pass_over(&mut self, kind: u32) {
        self.others += u64::from(OTHER_BUSES.contains(&kind));
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
        batch.push(Frame { number: self.frames, time: Some(time), bus, ..frame });
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
        Some(Timestamp(self.start).plus(elapsed))
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
        if self.others > 0 {
            let text = format!("messages of bus systems other than CAN skipped ({})", self.others);
            batch.add_notice(Notice::Assumption(text));
        }
    }
}
