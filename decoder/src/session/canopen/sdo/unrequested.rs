//! Responses of a server that its client did not request, or that arrive on another identifier.
//!
//! A server responds and never starts a transfer, so its responses alone neither replace an open transfer nor open one
//! that is reported as the client's. A response that contradicts the open transfer is held until the next message of
//! the client shows to which transfer it belongs:
//!
//! ```text
//! client continues the open transfer, or aborts it     the server sent the held responses without a request
//! client continues a transfer of the other direction   its start is missing in the capture: they are decoded after all
//! ```

use super::channel::{ChannelState, EndedTransfers};
use super::strays::SegmentCheckpoint;
use super::transfer::{SdoTransferState, TransferStage};
use crate::event::{MisplacedResponse, SdoDirection, SdoMode};
use crate::frame::{CanId, Frame, Timestamp};
use crate::wire::canopen::ObjectAddress;
use crate::wire::canopen::sdo::{self, SdoMessage, SdoSide, TransferPhase};

/// Max responses to consecutive segments of the client that are missing in the capture, before the server is presumed to
/// send them without a request.
const MISSING_IN_ROW: u32 = 2;

/// Time in ns within which a response on another identifier belongs to a request.
const MISPLACED_TIME: i64 = 50_000_000;

/// Frames after which responses without any message of the client are not a transfer.
const FLOOD_FRAMES: u64 = 3;

impl ChannelState {
    /// Evaluates a message of the server without a request in the capture; `true` if it is not applied to a transfer.
    pub(super) fn takes_stray(&mut self, message: &SdoMessage<'_>, frame: &Frame) -> bool {
        let Some(open) = &mut self.transfer else { return false };
        let is_contrary = open.is_contradicted_by(message);
        if open.cut_start {
            let is_flood = is_contrary && open.is_only_responses();
            if is_flood {
                open.add_frame(frame);
                open.mode = Some(SdoMode::Segmented);
            }
            return is_flood;
        }
        if is_contrary {
            open.discard_unrequested(open.responses_in_row.saturating_sub(1));
            open.unrequested_responses = open.unrequested_responses.saturating_add(1);
            self.has_stray |= open.stage == TransferStage::Initiate;
            self.strays.hold_response(frame);
            return true;
        }
        open.responses_in_row = open.responses_in_row.saturating_add(1);
        let is_segmented = open.mode == Some(SdoMode::Segmented) && open.stage == TransferStage::Segments;
        let unasked = open.responses_in_row.saturating_sub(1);
        if !is_segmented || unasked == 0 {
            return false;
        }
        if unasked == 1 {
            open.checkpoint = Some(checkpoint_of(open));
        }
        let is_flood = unasked > MISSING_IN_ROW || self.strays.count > 0;
        if is_flood {
            open.discard_unrequested(unasked.saturating_sub(1));
            open.unrequested_responses = open.unrequested_responses.saturating_add(1);
        }
        is_flood
    }

    /// Decides with a message of the client to which transfer the held responses belong.
    pub(super) fn settle_strays(&mut self, index: u16, message: &SdoMessage<'_>, ended: &mut EndedTransfers) {
        let strays = std::mem::take(&mut self.strays);
        let Some(open) = &mut self.transfer else { return };
        (open.checkpoint, open.responses_in_row) = (None, 0);
        let is_upload = open.direction.map(|direction| direction == SdoDirection::Upload);
        let is_other = matches!((is_upload, message.is_upload()), (Some(open), Some(this)) if open != this);
        let is_whole = strays.count == strays.held.len() as u64;
        if strays.held.is_empty() || !is_other || message.starts_transfer() || !is_whole {
            return;
        }
        open.unrequested_responses = open.unrequested_responses.saturating_sub(strays.count);
        for frame in &strays.held {
            if let Ok(message) = sdo::parse(frame.data(), SdoSide::Server, TransferPhase::Commands) {
                ended.extend(self.superseded_by(&message));
                self.apply_message(index, SdoSide::Server, message, frame, ended);
            }
        }
    }

    /// Notes a response that the server sent on the identifier of the requests; `false` if the frame is not one.
    pub(super) fn take_own_response(&mut self, frame: &Frame) -> bool {
        let Some(open) = self.latest_request() else { return false };
        let is_response = open.is_awaiting(frame.time) && open.is_answered_on_request(frame);
        if is_response {
            open.misplaced = Some(MisplacedResponse { id: frame.id, frame: frame.number });
        }
        is_response
    }

    /// Whether the latest request is for an object and awaits its response.
    pub(super) fn is_awaiting(
        &self,
        object: ObjectAddress,
        direction: SdoDirection,
        time: Option<Timestamp>,
    ) -> bool {
        self.queue.back().or(self.transfer.as_ref()).is_some_and(|open| {
            (open.object, open.direction) == (Some(object), Some(direction)) && open.is_awaiting(time)
        })
    }

    /// Notes the response of another server to the latest request.
    pub(super) fn note_misplaced(&mut self, id: CanId, frame: u64) {
        if let Some(open) = self.latest_request() {
            open.misplaced = Some(MisplacedResponse { id, frame });
        }
    }

    fn latest_request(&mut self) -> Option<&mut SdoTransferState> {
        self.queue.back_mut().or(self.transfer.as_mut()).map(|open| &mut **open)
    }
}

impl SdoTransferState {
    /// Whether a message belongs to a transfer of the other direction or of another object.
    fn is_contradicted_by(&self, message: &SdoMessage<'_>) -> bool {
        let upload = self.direction.map(|direction| direction == SdoDirection::Upload);
        let is_other_way = matches!((upload, message.is_upload()), (Some(open), Some(this)) if open != this);
        let is_other_object =
            matches!((self.object, message.object()), (Some(open), Some(this)) if open != this);
        is_other_way || is_other_object
    }

    /// Whether a transfer without start has no message of the client, although the capture has others of it.
    fn is_only_responses(&self) -> bool {
        self.is_client_captured && !self.sides.0 && self.mode != Some(SdoMode::Block)
    }

    /// Whether the frames are responses without any request.
    pub(super) fn is_flood(&self) -> bool {
        self.cut_start && self.is_only_responses() && self.frame_count >= FLOOD_FRAMES
    }

    /// Whether the request awaits its response.
    fn is_awaiting(&self, time: Option<Timestamp>) -> bool {
        let elapsed = time.zip(self.last_request).map(|(now, then)| now.0.saturating_sub(then));
        !self.cut_start
            && self.stage == TransferStage::Initiate
            && self.last_side == Some(SdoSide::Client)
            && elapsed.is_none_or(|elapsed| (0..MISPLACED_TIME).contains(&elapsed))
    }

    /// Whether a frame on the identifier of the requests is a response to this one: it repeats the object, and it is not
    /// a valid request (CiA 301 §7.2.4.3.3, §7.2.4.3.6: reserved bits and bytes of a request are 0).
    fn is_answered_on_request(&self, frame: &Frame) -> bool {
        let Some((([asked, asked_object @ .., _, _, _, _], _), true)) = self.opened_by else { return false };
        let [command, object @ .., a, b, c, d] = frame.data() else { return false };
        let has_data = [*a, *b, *c, *d] != [0; 4];
        let is_plain = self.opened_by.is_some_and(|(([.., a, b, c, d], _), _)| [a, b, c, d] == [0; 4]);
        object == asked_object
            && match (self.direction, self.mode) {
                (Some(SdoDirection::Upload), None) => {
                    let is_value = matches!(command, 0x41..=0x43 | 0x47 | 0x4B | 0x4F);
                    asked == 0x40 && (is_value || *command == 0x40 && is_plain && has_data)
                }
                (Some(SdoDirection::Download), _) => *command == 0x60 && !has_data,
                _ => false,
            }
    }

    /// Restores the state before `applied` responses without a segment or request of the client, and counts them.
    fn discard_unrequested(&mut self, applied: u32) {
        let Some(before) = self.checkpoint.take() else { return };
        self.unrequested_responses = self.unrequested_responses.saturating_add(applied.into());
        self.data.truncate(before.data);
        self.later_data.truncate(before.ranges);
        if let Some(range) = self.later_data.last_mut() {
            range.data.truncate(before.last_range);
        }
        self.later_bytes = self.later_data.iter().map(|range| range.data.len()).sum();
        (self.size, self.unseen) = (before.size, before.unseen);
        (self.truncated, self.last_seen) = (before.truncated, before.last_seen);
        self.segments = before.segments;
    }
}

/// State of a segmented transfer now.
fn checkpoint_of(transfer: &SdoTransferState) -> SegmentCheckpoint {
    SegmentCheckpoint {
        size: transfer.size,
        unseen: transfer.unseen,
        data: transfer.data.len(),
        ranges: transfer.later_data.len(),
        last_range: transfer.later_data.last().map_or(0, |range| range.data.len()),
        truncated: transfer.truncated,
        last_seen: transfer.last_seen,
        segments: transfer.segments.clone(),
    }
}
