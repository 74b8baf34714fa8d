//! Open SDO transfers of a bus, one per channel.

use super::channel::{Channel, Finished};
use super::transfer::{Stage, Transfer};
use crate::event::{Direction, Outcome};
use crate::frame::Frame;
use crate::session::limits::OPEN_DATA_LIMIT;
use crate::wire::canopen::sdo::{Phase, Sdo, Side};

/// What a timer entry of a channel comes to.
pub(in crate::session) enum Due {
    /// Nothing is open.
    Nothing,
    /// The deadline moved.
    Later(i64),
    /// The transfer got no answer until its deadline.
    Over(Box<Transfer>, i64),
}

/// Transfers of all channels of a bus.
#[derive(Debug, Clone, Default)]
pub(in crate::session) struct Transfers {
    /// By number of the channel.
    channels: Vec<Channel>,
    /// Bytes all open transfers hold.
    open_bytes: usize,
    overflowed: bool,
}

impl Transfers {
    fn get(&self, channel: u16) -> Option<&Channel> {
        self.channels.get(usize::from(channel))
    }

    fn get_mut(&mut self, channel: u16) -> Option<&mut Channel> {
        self.channels.get_mut(usize::from(channel))
    }

    /// Whether a transfer is open on the channel in which both sides took part.
    pub(in crate::session) fn is_answered(&self, channel: u16) -> bool {
        let transfer = self.get(channel).and_then(|channel| channel.transfer.as_ref());
        transfer.is_some_and(|transfer| !transfer.cut_start || transfer.is_answered())
    }

    /// In which phase a side of the channel is.
    pub(in crate::session) fn phase(&self, channel: u16, side: Side) -> Phase {
        let transfer = self.get(channel).and_then(|channel| channel.transfer.as_deref());
        let sender =
            transfer.filter(|transfer| transfer.stage == Stage::BlockSegments).and_then(|t| t.direction);
        match (sender, side) {
            (Some(Direction::Download), Side::Client) | (Some(Direction::Upload), Side::Server) => {
                Phase::BlockSegments
            }
            _ => Phase::Commands,
        }
    }

    /// Sets the deadline of an open transfer; `true` if it must go into the timer queue.
    pub(in crate::session) fn arm(&mut self, channel: u16, deadline: i64) -> bool {
        let Some(channel) = self.get_mut(channel) else { return false };
        if channel.transfer.is_none() {
            channel.deadline = None;
            return false;
        }
        channel.deadline = Some(deadline);
        !std::mem::replace(&mut channel.queued, true)
    }

    /// What to do when the timer entry of a channel comes due.
    pub(in crate::session) fn due(&mut self, channel: u16, now: i64) -> Due {
        let Some(channel) = self.channels.get_mut(usize::from(channel)) else { return Due::Nothing };
        channel.queued = false;
        match channel.deadline {
            None => Due::Nothing,
            Some(deadline) if deadline >= now => {
                channel.queued = true;
                Due::Later(deadline)
            }
            Some(deadline) => {
                channel.deadline = None;
                self.open_bytes = self.open_bytes.saturating_sub(channel.open_bytes());
                match channel.transfer.take() {
                    Some(mut transfer) => {
                        transfer.end(Outcome::Timeout);
                        Due::Over(transfer, deadline)
                    }
                    None => Due::Nothing,
                }
            }
        }
    }

    /// Moves all deadlines by `delay` nanoseconds.
    pub(in crate::session) fn postpone(&mut self, delay: i64) {
        for channel in &mut self.channels {
            channel.deadline = channel.deadline.map(|deadline| deadline.saturating_add(delay));
        }
    }

    /// Takes out all open transfers in the order they began.
    pub(in crate::session) fn drain(&mut self) -> impl Iterator<Item = Box<Transfer>> + use<> {
        self.open_bytes = 0;
        let mut open: Vec<_> =
            self.channels.iter_mut().filter_map(|channel| channel.transfer.take()).collect();
        for transfer in &mut open {
            transfer.end(Outcome::Unfinished);
        }
        open.sort_by_key(|transfer| transfer.frames.first);
        open.into_iter()
    }

    /// Whether data had to be dropped since the last question.
    pub(in crate::session) fn take_overflow(&mut self) -> bool {
        std::mem::take(&mut self.overflowed)
    }

    /// Bytes held.
    pub(in crate::session) fn footprint(&self) -> usize {
        let open = self.channels.iter().filter_map(|channel| channel.transfer.as_ref());
        self.channels.capacity() * size_of::<Channel>()
            + open.map(|transfer| transfer.footprint()).sum::<usize>()
    }

    /// A command byte nobody knows; it may be a segment of a block whose beginning was not seen.
    pub(in crate::session) fn note_unknown_command(&mut self, channel: u16, side: Side, command: u8) {
        if let Some(transfer) = self.get_mut(channel).and_then(|channel| channel.transfer.as_mut())
            && transfer.frame_count == 1
        {
            transfer.opened_by = (command, side == Side::Client);
        }
    }

    /// Data of all open transfers, in bytes.
    pub(in crate::session) fn open_bytes(&self) -> usize {
        self.open_bytes
    }

    /// Takes a message; gives the transfers it ended. `elsewhere`: bytes that open transfers of other
    /// protocols hold.
    pub(in crate::session) fn take(
        &mut self,
        index: u16,
        side: Side,
        message: Sdo<'_>,
        command: u8,
        frame: &Frame,
        elsewhere: usize,
    ) -> Finished {
        let place = usize::from(index);
        if place >= self.channels.len() {
            self.channels.resize_with(place.saturating_add(1), Channel::default);
        }
        let Some(channel) = self.channels.get_mut(place) else { return [None, None] };
        let before = channel.open_bytes();
        let finished = channel.take(index, side, message, command, frame);
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
