//! All SDO channels of a bus.

use super::channel::{Channel, Finished};
use super::transfer::{Stage, Transfer};
use crate::event::{Direction, Outcome};
use crate::frame::{CanId, Frame};
use crate::session::{CHANNEL_LIMIT, OPEN_DATA_LIMIT};
use crate::wire::canopen::sdo::{Phase, Sdo, Side};

/// What a timer entry of a channel comes to.
pub(super) enum Due {
    /// Nothing is open.
    Nothing,
    /// The deadline moved.
    Later(i64),
    /// The transfer got no answer until its deadline.
    Over(Box<Transfer>, i64),
}

/// All channels of a bus.
#[derive(Debug, Clone, Default)]
#[expect(clippy::struct_field_names, reason = "the channels are what it is about")]
pub(in crate::session) struct Channels {
    channels: Vec<Channel>,
    /// Bytes all open transfers hold.
    open_bytes: usize,
    overflowed: bool,
    refused: bool,
}

impl Channels {
    /// The channel every node has (0x600 and 0x580 + node-ID).
    pub(in crate::session) fn default_channel(&mut self, node: u8) -> Option<u16> {
        let id = |base: u16| CanId::standard(base + u16::from(node));
        self.add(node, 0x1200, id(0x600), id(0x580), None)
    }

    /// A channel from a server parameter; its identifiers are replaced if it exists.
    pub(in crate::session) fn add(
        &mut self,
        server: u8,
        parameter: u16,
        request: CanId,
        response: CanId,
        client: Option<u8>,
    ) -> Option<u16> {
        let known = self
            .channels
            .iter()
            .position(|channel| (channel.server, channel.parameter) == (server, parameter));
        let index = match known {
            Some(index) => index,
            None if self.channels.len() < CHANNEL_LIMIT => {
                self.channels.push(Channel {
                    request,
                    response,
                    server,
                    client,
                    parameter,
                    transfer: None,
                    deadline: None,
                    queued: false,
                });
                self.channels.len() - 1
            }
            None => {
                self.refused = true;
                return None;
            }
        };
        let channel = self.channels.get_mut(index)?;
        (channel.request, channel.response, channel.client) = (request, response, client);
        u16::try_from(index).ok()
    }

    /// The channel a client's parameter describes: the server's own where the identifiers are equal.
    pub(in crate::session) fn of_client(
        &mut self,
        server: u8,
        parameter: u16,
        request: CanId,
        response: CanId,
        client: u8,
    ) -> Option<u16> {
        let same = |channel: &Channel| (channel.request, channel.response) == (request, response);
        if let Some(index) = self.channels.iter().position(same) {
            self.channels.get_mut(index)?.client = Some(client);
            return u16::try_from(index).ok();
        }
        self.add(server, parameter, request, response, Some(client))
    }

    fn get(&self, channel: u16) -> Option<&Channel> {
        self.channels.get(usize::from(channel))
    }

    fn get_mut(&mut self, channel: u16) -> Option<&mut Channel> {
        self.channels.get_mut(usize::from(channel))
    }

    /// Node-ID of the server.
    pub(in crate::session) fn server(&self, channel: u16) -> Option<u8> {
        self.get(channel).map(|channel| channel.server)
    }

    /// Node-ID of the client, if configured.
    pub(super) fn client(&self, channel: u16) -> Option<u8> {
        self.get(channel)?.client
    }

    /// Identifiers of requests and responses.
    pub(in crate::session) fn ids(&self, channel: u16) -> Option<(CanId, CanId)> {
        self.get(channel).map(|channel| (channel.request, channel.response))
    }

    /// Whether a transfer is open on the channel in which both sides took part.
    pub(super) fn is_answered(&self, channel: u16) -> bool {
        let transfer = self.get(channel).and_then(|channel| channel.transfer.as_ref());
        transfer.is_some_and(|transfer| !transfer.cut_start || transfer.is_answered())
    }

    /// In which phase a side of the channel is.
    pub(super) fn phase(&self, channel: u16, side: Side) -> Option<Phase> {
        let transfer = self.get(channel)?.transfer.as_deref();
        let sender =
            transfer.filter(|transfer| transfer.stage == Stage::BlockSegments).and_then(|t| t.direction);
        Some(match (sender, side) {
            (Some(Direction::Download), Side::Client) | (Some(Direction::Upload), Side::Server) => {
                Phase::BlockSegments
            }
            _ => Phase::Commands,
        })
    }

    /// Sets the deadline of an open transfer; `true` if it must go into the timer queue.
    pub(super) fn arm(&mut self, channel: u16, deadline: i64) -> bool {
        let Some(channel) = self.get_mut(channel) else { return false };
        if channel.transfer.is_none() {
            channel.deadline = None;
            return false;
        }
        channel.deadline = Some(deadline);
        !std::mem::replace(&mut channel.queued, true)
    }

    /// What to do when the timer entry of a channel comes due.
    pub(super) fn due(&mut self, channel: u16, now: i64) -> Due {
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

    /// Takes out all open transfers, with their servers, in the order they began.
    pub(super) fn drain(&mut self) -> Vec<(u8, Box<Transfer>)> {
        self.open_bytes = 0;
        let open =
            self.channels.iter_mut().filter_map(|channel| Some((channel.server, channel.transfer.take()?)));
        let mut open: Vec<_> = open.collect();
        for (_, transfer) in &mut open {
            transfer.end(Outcome::Unfinished);
        }
        open.sort_by_key(|(_, transfer)| transfer.frames.first);
        open
    }

    /// Whether data had to be dropped since the last question.
    pub(super) fn take_overflow(&mut self) -> bool {
        std::mem::take(&mut self.overflowed)
    }

    /// Whether a channel found no room since the last question.
    pub(in crate::session) fn take_refused(&mut self) -> bool {
        std::mem::take(&mut self.refused)
    }

    /// Bytes held.
    pub(in crate::session) fn footprint(&self) -> usize {
        let open = self.channels.iter().filter_map(|channel| channel.transfer.as_ref());
        self.channels.capacity() * size_of::<Channel>()
            + open.map(|transfer| transfer.footprint()).sum::<usize>()
    }

    /// A command byte nobody knows; it may be a segment of a block whose beginning was not seen.
    pub(super) fn saw_unknown(&mut self, channel: u16, side: Side, command: u8) {
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
    pub(super) fn take(
        &mut self,
        index: u16,
        side: Side,
        message: Sdo<'_>,
        command: u8,
        frame: &Frame,
        elsewhere: usize,
    ) -> Finished {
        let Some(channel) = self.channels.get_mut(usize::from(index)) else { return [None, None] };
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
