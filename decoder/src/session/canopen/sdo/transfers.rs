//! Open SDO transfers of a bus, one per channel.

use super::channel::{ChannelState, EndedTransfers, first_bytes};
use super::transfer::SdoTransferState;
use crate::frame::Frame;
use crate::session::limits::OPEN_DATA_LIMIT;
use crate::wire::canopen::sdo::{SdoMessage, SdoSide, TransferPhase};

/// Objects whose write the server confirms after it has stored or restored parameters (CiA 301 §7.5.2.13, §7.5.2.14).
const STORE: u16 = 0x1010;
const RESTORE: u16 = 0x1011;

/// Time-outs of other transfers that such a server has.
const STORE_SILENCES: i64 = 5;

/// Result of a timer entry of a channel.
pub(in crate::session) enum ChannelTimeout {
    /// No open transfer.
    Nothing,
    /// The deadline moved to this time.
    Later(i64),
    /// Transfer without response until this deadline.
    Over(Box<SdoTransferState>, i64),
}

/// Transfers of all channels of a bus.
#[derive(Debug, Clone, Default)]
pub(in crate::session) struct SdoTransfers {
    /// Channels by number.
    channels: Vec<ChannelState>,
    /// Data bytes held by all open transfers.
    open_bytes: usize,
    overflowed: bool,
}

impl SdoTransfers {
    fn get(&self, channel: u16) -> Option<&ChannelState> {
        self.channels.get(usize::from(channel))
    }

    fn get_mut(&mut self, channel: u16) -> Option<&mut ChannelState> {
        self.channels.get_mut(usize::from(channel))
    }

    /// Whether the open transfer of the channel was seen from its start, or has frames of client and server.
    pub(in crate::session) fn is_answered(&self, channel: u16) -> bool {
        let transfer = self.get(channel).and_then(|channel| channel.transfer.as_ref());
        transfer.is_some_and(|transfer| !transfer.cut_start || transfer.is_answered())
    }

    /// Phase of the client or the server on a channel, in which `data` is to be read.
    pub(in crate::session) fn phase_of(&self, channel: u16, side: SdoSide, data: &[u8]) -> TransferPhase {
        self.get(channel).map_or(TransferPhase::Commands, |channel| channel.phase_of(side, data))
    }

    /// Sets the deadline of the transfers that the last frame concerns: `silence` ns after `now`, for store and restore
    /// commands later. `true` if the time `silence` ns after `now` must go into the timer queue.
    pub(in crate::session) fn set_deadline(&mut self, channel: u16, now: i64, silence: i64) -> bool {
        let Some(channel) = self.get_mut(channel) else { return false };
        for open in channel.transfer.iter_mut().chain(&mut channel.queue) {
            if std::mem::take(&mut open.is_touched) {
                let is_store = open.object.is_some_and(|object| matches!(object.index, STORE | RESTORE));
                let factor = if is_store { STORE_SILENCES } else { 1 };
                open.deadline = Some(now.saturating_add(silence.saturating_mul(factor)));
            }
        }
        channel.transfer.is_some() && !std::mem::replace(&mut channel.queued, true)
    }

    /// Evaluates the timer entry of a channel that is due.
    pub(in crate::session) fn evaluate_timer(&mut self, channel: u16, now: i64) -> ChannelTimeout {
        let Some(channel) = self.channels.get_mut(usize::from(channel)) else {
            return ChannelTimeout::Nothing;
        };
        channel.queued = false;
        while let Some(deadline) = channel.earliest_deadline() {
            if deadline >= now {
                channel.queued = true;
                return ChannelTimeout::Later(deadline);
            }
            let before = channel.open_bytes();
            let expired = channel.expire_transfer();
            self.open_bytes = self.open_bytes.saturating_sub(before) + channel.open_bytes();
            if let Some(transfer) = expired {
                return ChannelTimeout::Over(transfer, deadline);
            }
        }
        ChannelTimeout::Nothing
    }

    /// Postpones all deadlines by `delay` ns.
    pub(in crate::session) fn postpone_deadlines(&mut self, delay: i64) {
        let open = self
            .channels
            .iter_mut()
            .flat_map(|channel| channel.transfer.iter_mut().chain(&mut channel.queue));
        for transfer in open {
            transfer.deadline = transfer.deadline.map(|deadline| deadline.saturating_add(delay));
        }
    }

    /// Removes and returns all open transfers in the order of their start.
    pub(in crate::session) fn drain_transfers(
        &mut self,
    ) -> impl Iterator<Item = Box<SdoTransferState>> + use<> {
        self.open_bytes = 0;
        let mut open: Vec<_> = self.channels.iter_mut().flat_map(ChannelState::drain_transfers).collect();
        open.sort_by_key(|transfer| transfer.frames.first);
        open.into_iter()
    }

    /// Whether data was dropped since the last call.
    pub(in crate::session) fn take_overflow(&mut self) -> bool {
        std::mem::take(&mut self.overflowed)
    }

    /// Bytes held by all channels.
    pub(in crate::session) fn footprint(&self) -> usize {
        let open = self.channels.iter().flat_map(|channel| channel.transfer.iter().chain(&channel.queue));
        self.channels.capacity() * size_of::<ChannelState>()
            + self.channels.iter().map(|channel| channel.strays.footprint()).sum::<usize>()
            + open.map(|transfer| transfer.footprint()).sum::<usize>()
    }

    /// Notes a response on the identifier of the requests of a channel; `false` if the frame is not one.
    pub(in crate::session) fn take_own_response(&mut self, channel: u16, frame: &Frame) -> bool {
        self.get_mut(channel).is_some_and(|channel| channel.take_own_response(frame))
    }

    /// Whether a response without a request of its own is that to the only open request for its object, of another
    /// channel; the request is marked.
    pub(in crate::session) fn link_misplaced(
        &mut self,
        channel: u16,
        response: &SdoTransferState,
        frame: &Frame,
    ) -> bool {
        let is_response = response.cut_start && response.frame_count == 1 && !response.sides.0;
        let (Some(object), Some(direction), true) = (response.object, response.direction, is_response) else {
            return false;
        };
        let others = self.channels.iter_mut().enumerate().filter(|(place, _)| *place != usize::from(channel));
        let mut awaiting = others.filter_map(|(_, other)| {
            Some(other).filter(|other| other.is_awaiting(object, direction, frame.time))
        });
        let (Some(request), None) = (awaiting.next(), awaiting.next()) else { return false };
        request.note_misplaced(frame.id, frame.number);
        true
    }

    /// Stores a frame with an undefined command; it may be a segment of a block whose start is missing.
    pub(in crate::session) fn note_unknown_command(&mut self, channel: u16, side: SdoSide, frame: &Frame) {
        if let Some(transfer) = self.get_mut(channel).and_then(|channel| channel.transfer.as_mut())
            && transfer.frame_count == 1
        {
            transfer.opened_by = Some((first_bytes(frame), side == SdoSide::Client));
        }
    }

    /// Data bytes held by all open transfers.
    pub(in crate::session) fn open_bytes(&self) -> usize {
        self.open_bytes
    }

    /// Applies a message; returns the transfers that it ended. `elsewhere`: bytes held by open transfers of
    /// other protocols.
    pub(in crate::session) fn take_message(
        &mut self,
        index: u16,
        side: SdoSide,
        message: SdoMessage<'_>,
        frame: &Frame,
        elsewhere: usize,
    ) -> EndedTransfers {
        let place = usize::from(index);
        if place >= self.channels.len() {
            self.channels.resize_with(place.saturating_add(1), ChannelState::default);
        }
        let Some(channel) = self.channels.get_mut(place) else { return Vec::new() };
        let before = channel.open_bytes();
        let finished = channel.take_message(index, side, message, frame);
        let now = channel.open_bytes();
        self.open_bytes = self.open_bytes.saturating_sub(before) + now;
        if self.open_bytes + elsewhere > OPEN_DATA_LIMIT
            && now > 0
            && let Some(transfer) = &mut channel.transfer
        {
            transfer.give_up_data();
            self.open_bytes -= now;
            self.overflowed = true;
        }
        finished
    }
}
