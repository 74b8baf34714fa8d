//! Requests of a client that sends the next one without waiting for the response.
//!
//! ```text
//! Channel::transfer   the transfer that the next message without object belongs to
//! Channel::queue      further requests, in the order in which they were sent
//! ```
//!
//! A response that contains an object belongs to the first request for it. A repeated request after the client's
//! time-out is a retry: it is part of the exchange that it repeats.

use super::channel::{ChannelState, EndedTransfers, first_bytes};
use super::transfer::{SdoTransferState, TransferStage};
use crate::event::{SdoDirection, SdoOutcome};
use crate::frame::Frame;
use crate::wire::canopen::ObjectAddress;
use crate::wire::canopen::sdo::{SdoMessage, SdoSide};

/// Max requests of one channel without response.
const PENDING_LIMIT: usize = 16;

/// Time in ns after which the client no longer waits for a response: it repeats the request or starts another
/// transfer. No client has a shorter time-out.
const TIME_OUT: i64 = 50_000_000;

/// Max retries that are combined to one exchange.
const RETRY_LIMIT: u32 = 3;

impl ChannelState {
    /// Handles a request that starts a transfer while others have no response yet; `false` if it does not.
    pub(super) fn queue_request(
        &mut self,
        message: &SdoMessage<'_>,
        frame: &Frame,
        ended: &mut EndedTransfers,
    ) -> bool {
        if !message.starts_transfer() || !self.transfer.as_ref().is_some_and(|open| open.awaits_server()) {
            return false;
        }
        // The server responded to something else: the client takes this as its response.
        if std::mem::take(&mut self.has_stray) {
            return false;
        }
        let request = first_bytes(frame);
        let time = frame.time.map(|time| time.0);
        let has_given_up = |open: &SdoTransferState| {
            let elapsed = time.zip(open.last_time).map(|(now, then)| now.saturating_sub(then));
            open.opened_by.is_some_and(|(known, _)| known != request)
                && elapsed.is_some_and(|elapsed| elapsed >= TIME_OUT)
        };
        for place in (0..self.queue.len()).rev() {
            if self.queue.get(place).is_some_and(|open| has_given_up(open)) {
                ended.extend(
                    self.queue.remove(place).and_then(|open| close_transfer(open, SdoOutcome::Superseded)),
                );
            }
        }
        if self.transfer.as_ref().is_some_and(|open| has_given_up(open)) {
            let open = self.transfer.take();
            ended.extend(open.and_then(|open| close_transfer(open, SdoOutcome::Superseded)));
            self.transfer = self.queue.pop_front();
        }
        ended.reverse();
        if self.transfer.is_none() {
            return false;
        }
        if let Some(before) = self.queue.back_mut().or(self.transfer.as_mut()) {
            let elapsed = time.zip(before.last_time).map(|(now, then)| now.saturating_sub(then).max(0));
            let is_retry = before.opened_by.is_some_and(|(known, _)| known == request);
            before.overlap = match elapsed {
                None => Some(0).filter(|_| !is_retry),
                Some(elapsed) => Some(elapsed).filter(|elapsed| *elapsed < TIME_OUT),
            };
        }
        if self.queue.len() + 1 >= PENDING_LIMIT {
            let oldest = self.transfer.take();
            self.transfer = self.queue.pop_front();
            ended.extend(oldest.and_then(|open| self.retire_request(open, SdoOutcome::Superseded)));
        }
        true
    }

    /// Drops retries of exchanges that are complete: the client continues with another request.
    pub(super) fn drop_absorbed(&mut self) {
        self.queue.retain(|open| !open.is_absorbed);
        if self.transfer.as_ref().is_some_and(|open| open.is_absorbed) {
            self.transfer = self.queue.pop_front();
        }
    }

    /// Makes the request that a response with an object belongs to the open transfer.
    pub(super) fn select_request(&mut self, message: &SdoMessage<'_>) {
        if self.queue.is_empty() {
            return;
        }
        let (Some(object), upload) = (message.object(), message.is_upload()) else { return };
        if self.transfer.as_ref().is_some_and(|open| open.is_request_for(object, upload)) {
            return;
        }
        let Some(place) = self.queue.iter().position(|open| open.is_request_for(object, upload)) else {
            return;
        };
        let wanted = self.queue.remove(place);
        if let Some(open) = std::mem::replace(&mut self.transfer, wanted) {
            self.queue.push_front(open);
        }
    }

    /// Takes the next request after the open transfer ended. Equal requests that the client repeated after its
    /// time-out are retries of the transfer that ended.
    pub(super) fn next_request(&mut self, ended: &mut SdoTransferState) {
        let is_retry = |open: &SdoTransferState| {
            let elapsed = open.first_time.zip(ended.last_request).map(|(now, then)| now.saturating_sub(then));
            open.is_repeat_of(ended) && elapsed.is_none_or(|elapsed| elapsed >= TIME_OUT)
        };
        let mut retries = 0;
        for open in &mut self.queue {
            if !open.is_absorbed && is_retry(open) {
                open.is_absorbed = true;
                retries += 1;
            }
        }
        ended.retries += retries;
        self.transfer = self.queue.pop_front();
    }

    /// After a response that opens a transfer of several segments: an earlier transfer that is not complete ends
    /// here. Its segments contain no object, so those that follow may belong to either of both.
    pub(super) fn end_interleaved(&mut self) -> Option<Box<SdoTransferState>> {
        let is_open = self.transfer.as_ref().is_some_and(|open| open.stage != TransferStage::Initiate);
        let place =
            self.queue.iter().position(|open| open.stage != TransferStage::Initiate).filter(|_| is_open)?;
        let mut earlier = self.queue.remove(place)?;
        earlier.is_ambiguous = true;
        earlier.end_with(SdoOutcome::Superseded);
        if let Some(open) = &mut self.transfer {
            open.is_ambiguous = true;
        }
        Some(earlier)
    }

    /// Earliest deadline of the requests of the channel.
    pub(super) fn earliest_deadline(&self) -> Option<i64> {
        self.transfer.iter().chain(&self.queue).filter_map(|open| open.deadline).min()
    }

    /// Ends the transfer with the earliest deadline, which has passed; `None` if it is part of another
    /// exchange.
    pub(super) fn expire_transfer(&mut self) -> Option<Box<SdoTransferState>> {
        let deadline = self.earliest_deadline();
        let open = match self.queue.iter().position(|open| open.deadline == deadline) {
            Some(place) if self.transfer.as_ref().is_none_or(|open| open.deadline != deadline) => {
                self.queue.remove(place)
            }
            _ => self.transfer.take(),
        }?;
        if self.transfer.is_none() {
            self.transfer = self.queue.pop_front();
        }
        self.retire_request(open, SdoOutcome::Timeout)
    }

    /// Ends a request without response. If the client repeated it, the repetition continues the exchange.
    fn retire_request(
        &mut self,
        open: Box<SdoTransferState>,
        outcome: SdoOutcome,
    ) -> Option<Box<SdoTransferState>> {
        let repetition = self
            .transfer
            .iter_mut()
            .chain(&mut self.queue)
            .find(|later| !later.is_absorbed && later.is_repeat_of(&open) && open.overlap.is_none());
        if let Some(later) = repetition.filter(|_| !open.is_absorbed && open.retries < RETRY_LIMIT) {
            later.continue_exchange(&open);
            return None;
        }
        close_transfer(open, outcome)
    }

    /// Ends all open transfers at the end of the capture, in the order of their start.
    pub(super) fn drain_transfers(&mut self) -> EndedTransfers {
        let mut ended = Vec::new();
        while let Some(open) = self.transfer.take() {
            self.transfer = self.queue.pop_front();
            ended.extend(self.retire_request(open, SdoOutcome::Unfinished));
        }
        ended
    }
}

/// Ends a transfer; `None` for a request that is part of another exchange. A request that the client did not wait
/// for is superseded by the next one.
fn close_transfer(mut open: Box<SdoTransferState>, outcome: SdoOutcome) -> Option<Box<SdoTransferState>> {
    let is_overtaken = open.overlap.is_some() && open.stage == TransferStage::Initiate;
    let outcome = if is_overtaken { SdoOutcome::Superseded } else { outcome };
    open.end_with(outcome);
    Some(open).filter(|open| !open.is_absorbed)
}

impl SdoTransferState {
    /// Whether the next message must come from the server.
    fn awaits_server(&self) -> bool {
        self.last_side == Some(SdoSide::Client)
            && matches!(self.stage, TransferStage::Initiate | TransferStage::Segments)
    }

    /// Whether this is a request without response for an object; `upload` is `None` for an abort.
    pub(super) fn is_request_for(&self, object: ObjectAddress, upload: Option<bool>) -> bool {
        let own = self.direction.map(|direction| direction == SdoDirection::Upload);
        self.stage == TransferStage::Initiate
            && self.object == Some(object)
            && (upload.is_none() || own == upload)
    }

    /// Whether both are the same request, both without response.
    fn is_repeat_of(&self, earlier: &Self) -> bool {
        let is_same = self.opened_by.is_some() && self.opened_by == earlier.opened_by;
        is_same && self.stage == TransferStage::Initiate && self.frames.first > earlier.frames.first
    }

    /// Makes this request a retry of an earlier one.
    fn continue_exchange(&mut self, earlier: &Self) {
        self.retries = earlier.retries + 1;
        self.frames.first = earlier.frames.first;
        self.frame_count += earlier.frame_count;
        self.first_time = earlier.first_time;
    }
}
