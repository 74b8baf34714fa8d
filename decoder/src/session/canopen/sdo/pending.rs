//! Requests of a client that sends the next one without waiting for the response.
//!
//! ```text
//! Channel::transfer   the transfer that the next message without object belongs to
//! Channel::queue      further requests, in the order in which they were sent
//! ```
//!
//! A response that contains an object belongs to the first request for it. A repeated request after the client's
//! time-out is a retry: it is part of the exchange that it repeats.

use super::channel::{Channel, EndedTransfers, first_bytes};
use super::transfer::{Stage, Transfer};
use crate::event::{Direction, Outcome};
use crate::frame::Frame;
use crate::wire::canopen::ObjectAddress;
use crate::wire::canopen::sdo::{Sdo, Side};

/// Max requests of one channel without response.
const PENDING_LIMIT: usize = 16;

/// Time in ns after which the client no longer waits for a response: it repeats the request or starts another
/// transfer. No client has a shorter time-out.
const TIME_OUT: i64 = 50_000_000;

/// Max retries that are combined to one exchange.
const RETRY_LIMIT: u32 = 3;

impl Channel {
    /// Handles a request that starts a transfer while others have no response yet; `false` if it does not.
    pub(super) fn queue_request(
        &mut self,
        message: &Sdo<'_>,
        frame: &Frame,
        ended: &mut EndedTransfers,
    ) -> bool {
        if !message.begins() || !self.transfer.as_ref().is_some_and(|open| open.awaits_server()) {
            return false;
        }
        // The server responded to something else: the client takes this as its response.
        if std::mem::take(&mut self.has_stray) {
            return false;
        }
        let request = first_bytes(frame);
        let time = frame.time.map(|time| time.0);
        let has_given_up = |open: &Transfer| {
            let elapsed = time.zip(open.last_time).map(|(now, then)| now.saturating_sub(then));
            open.opened_by.is_some_and(|(known, _)| known != request)
                && elapsed.is_some_and(|elapsed| elapsed >= TIME_OUT)
        };
        for place in (0..self.queue.len()).rev() {
            if self.queue.get(place).is_some_and(|open| has_given_up(open)) {
                ended.extend(self.queue.remove(place).and_then(|open| close(open, Outcome::Superseded)));
            }
        }
        if self.transfer.as_ref().is_some_and(|open| has_given_up(open)) {
            let open = self.transfer.take();
            ended.extend(open.and_then(|open| close(open, Outcome::Superseded)));
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
            ended.extend(oldest.and_then(|open| self.retire(open, Outcome::Superseded)));
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
    pub(super) fn select(&mut self, message: &Sdo<'_>) {
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
    pub(super) fn next_request(&mut self, ended: &mut Transfer) {
        let is_retry = |open: &Transfer| {
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
    pub(super) fn end_interleaved(&mut self) -> Option<Box<Transfer>> {
        let is_open = self.transfer.as_ref().is_some_and(|open| open.stage != Stage::Initiate);
        let place = self.queue.iter().position(|open| open.stage != Stage::Initiate).filter(|_| is_open)?;
        let mut earlier = self.queue.remove(place)?;
        earlier.is_ambiguous = true;
        earlier.end(Outcome::Superseded);
        if let Some(open) = &mut self.transfer {
            open.is_ambiguous = true;
        }
        Some(earlier)
    }

    /// Earliest deadline of the requests of the channel.
    pub(super) fn deadline(&self) -> Option<i64> {
        self.transfer.iter().chain(&self.queue).filter_map(|open| open.deadline).min()
    }

    /// Ends the transfer with the earliest deadline, which has passed; `None` if it is part of another
    /// exchange.
    pub(super) fn expire(&mut self) -> Option<Box<Transfer>> {
        let deadline = self.deadline();
        let open = match self.queue.iter().position(|open| open.deadline == deadline) {
            Some(place) if self.transfer.as_ref().is_none_or(|open| open.deadline != deadline) => {
                self.queue.remove(place)
            }
            _ => self.transfer.take(),
        }?;
        if self.transfer.is_none() {
            self.transfer = self.queue.pop_front();
        }
        self.retire(open, Outcome::Timeout)
    }

    /// Ends a request without response. If the client repeated it, the repetition continues the exchange.
    fn retire(&mut self, open: Box<Transfer>, outcome: Outcome) -> Option<Box<Transfer>> {
        let repetition = self
            .transfer
            .iter_mut()
            .chain(&mut self.queue)
            .find(|later| !later.is_absorbed && later.is_repeat_of(&open) && open.overlap.is_none());
        if let Some(later) = repetition.filter(|_| !open.is_absorbed && open.retries < RETRY_LIMIT) {
            later.continue_exchange(&open);
            return None;
        }
        close(open, outcome)
    }

    /// Ends all open transfers at the end of the capture, in the order of their start.
    pub(super) fn drain(&mut self) -> EndedTransfers {
        let mut ended = Vec::new();
        while let Some(open) = self.transfer.take() {
            self.transfer = self.queue.pop_front();
            ended.extend(self.retire(open, Outcome::Unfinished));
        }
        ended
    }
}

/// Ends a transfer; `None` for a request that is part of another exchange. A request that the client did not wait
/// for is superseded by the next one.
fn close(mut open: Box<Transfer>, outcome: Outcome) -> Option<Box<Transfer>> {
    let is_overtaken = open.overlap.is_some() && open.stage == Stage::Initiate;
    let outcome = if is_overtaken { Outcome::Superseded } else { outcome };
    open.end(outcome);
    Some(open).filter(|open| !open.is_absorbed)
}

impl Transfer {
    /// Whether the next message must come from the server.
    fn awaits_server(&self) -> bool {
        self.last_side == Some(Side::Client) && matches!(self.stage, Stage::Initiate | Stage::Segments)
    }

    /// Whether this is a request without response for an object; `upload` is `None` for an abort.
    pub(super) fn is_request_for(&self, object: ObjectAddress, upload: Option<bool>) -> bool {
        let own = self.direction.map(|direction| direction == Direction::Upload);
        self.stage == Stage::Initiate && self.object == Some(object) && (upload.is_none() || own == upload)
    }

    /// Whether both are the same request, both without response.
    fn is_repeat_of(&self, earlier: &Self) -> bool {
        let is_same = self.opened_by.is_some() && self.opened_by == earlier.opened_by;
        is_same && self.stage == Stage::Initiate && self.frames.first > earlier.frames.first
    }

    /// Makes this request a retry of an earlier one.
    fn continue_exchange(&mut self, earlier: &Self) {
        self.retries = earlier.retries + 1;
        self.frames.first = earlier.frames.first;
        self.frame_count += earlier.frame_count;
        self.first_time = earlier.first_time;
    }
}
