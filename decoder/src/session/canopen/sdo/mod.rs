//! SDO: many messages become one transfer.
//!
//! ```text
//! Bus::on_sdo ─▶ wire::sdo::parse(side, phase) ─▶ Channels, Channel ─▶ Transfer (block.rs: its blocks) ─▶ event
//! ```

mod block;
mod channel;
mod channels;
mod transfer;

use std::sync::Arc;

pub(in crate::session) use channels::Channels;
use transfer::Transfer;

use super::super::store::OriginKind;
use crate::bus_file::encode;
use crate::event::{Direction, EventKind, Outcome, SdoTransfer};
use crate::frame::{Frame, Timestamp};
use crate::profile::{Effect, Entry};
use crate::session::timers::Subject;
use crate::session::{Bus, Observer};
use crate::wire::canopen::ObjectAddress;
use crate::wire::canopen::sdo::{self, Sdo, Side};
use crate::wire::{Malformed, NodeId};

impl Bus {
    pub(in crate::session) fn on_sdo(
        &mut self,
        side: Side,
        channel: u16,
        frame: &Frame,
        out: &mut dyn Observer,
    ) {
        let Some(server) = self.channels.server(channel) else { return };
        let node = NodeId::Canopen(server);
        match side {
            Side::Client => self.belief.saw_request(server, frame.data()),
            Side::Server => self.belief.saw_response(server, frame.data()),
        }
        if !self.is_followed(frame, out) {
            return;
        }
        let now = self.clock.now();
        if side == Side::Server {
            self.heard(node, frame, out);
        }
        let Some(phase) = self.channels.phase(channel, side) else { return };
        let message = match sdo::parse(frame.data(), side, phase) {
            Ok(message) => message,
            Err(error) => return self.malformed(frame, node, error, "too short for its SDO command", out),
        };
        if let Sdo::Unknown { command } = message {
            self.channels.saw_unknown(channel, side, command);
            let error = Malformed { layer: "sdo", offset: 0, needed: 0, available: frame.length };
            return self.malformed(frame, node, error, "unknown SDO command specifier", out);
        }
        let command = frame.data().first().copied().unwrap_or(0);
        if !self.belief.is_believed() {
            // Without a sign of CANopen a message without beginning is followed, but not taken for SDO
            // before the other side joins in. One that begins a transfer may well be a master looking for
            // nodes that are not there.
            if !message.begins() && !self.channels.is_answered(channel) {
                self.belief.saw_unsupported(server, now);
                self.undecoded(frame, None, out);
            }
        }
        let finished = self.channels.take(channel, side, message, command, frame, self.uds.open_bytes());
        for transfer in finished.into_iter().flatten() {
            self.finish_transfer(node, transfer, frame, out);
        }
        if self.channels.take_overflow() {
            let kind = EventKind::Evicted { what: "data of open SDO transfers", count: 1 };
            self.emit(frame, node, false, kind, out);
        }
        if self.clock.runs() {
            let deadline = now.saturating_add(self.options.sdo_silence);
            if self.channels.arm(channel, deadline) {
                self.timers.add(deadline, Subject::SdoChannel(channel));
            }
        }
    }

    /// A channel's entry in the timer queue came due.
    pub(in crate::session) fn sdo_deadline(&mut self, channel: u16, now: i64, out: &mut dyn Observer) {
        match self.channels.due(channel, now) {
            channels::Due::Nothing => {}
            channels::Due::Later(deadline) => self.timers.add(deadline, Subject::SdoChannel(channel)),
            channels::Due::Over(transfer, deadline) => {
                let Some(server) = self.channels.server(channel) else { return };
                let mut frame = Frame { number: transfer.frames.last, ..Frame::EMPTY };
                frame.time = self.clock.stamp_of(deadline);
                self.finish_transfer(NodeId::Canopen(server), transfer, &frame, out);
            }
        }
    }

    /// The capture ends: open transfers are unfinished.
    pub(in crate::session) fn finish_transfers(&mut self, out: &mut dyn Observer) {
        let frame = Frame { number: self.last_frame, time: self.last_time, ..Frame::EMPTY };
        for (server, transfer) in self.channels.drain() {
            self.finish_transfer(NodeId::Canopen(server), transfer, &frame, out);
        }
    }

    /// Emits a transfer and lets its value take effect. `frame` is the one that ended it.
    fn finish_transfer(
        &mut self,
        server: NodeId,
        mut transfer: Box<Transfer>,
        frame: &Frame,
        out: &mut dyn Observer,
    ) {
        if !self.belief.is_believed() && transfer.cut_start && !transfer.is_answered() {
            return;
        }
        let described = self.describe(server, &mut transfer, frame.time);
        let mut event = self.event(frame, EventKind::SdoTransfer(Box::new(described)));
        event.node = Some(server);
        event.frames = transfer.frames;
        out.event(&event, self);
        let EventKind::SdoTransfer(described) = event.kind else { return };
        let is_whole = described.outcome == Outcome::Complete && !described.truncated;
        let has_value = is_whole && (!described.cut_start || transfer.value_is_whole());
        if let (true, Some(object), Some(direction)) = (has_value, described.object, described.direction) {
            let kind = match direction {
                Direction::Upload => OriginKind::Upload,
                Direction::Download => OriginKind::Download,
            };
            self.learn_object(server, object, &described.data, kind, frame, out);
        }
    }

    /// The value before a transfer: seen, or as delivered.
    fn previous(&self, server: NodeId, object: Option<ObjectAddress>) -> (Option<Vec<u8>>, bool) {
        let (Some(node), Some(object)) = (self.node(server), object) else { return (None, false) };
        if let Some(entry) = node.store().get(object) {
            return (Some(entry.value.clone()), entry.stale);
        }
        let entry = node.device().dictionary.find(object).and_then(|found| found.entry);
        let number =
            entry.and_then(|entry| Some((entry.default_number(Some(server.number()))?, entry.data_type)));
        (number.and_then(|(number, data_type)| encode(number, data_type).ok()), true)
    }

    /// When a write acts and whether it stays, where the device's profile tells.
    fn consequence(&self, server: NodeId, transfer: &Transfer) -> (Option<Effect>, Option<&'static str>) {
        let is_write =
            transfer.direction == Some(Direction::Download) && transfer.outcome == Outcome::Complete;
        let object = transfer.object.filter(|_| is_write);
        let entry = object.and_then(|object| self.node(server)?.device().dictionary.find(object)?.entry);
        entry.map_or((None, None), Entry::consequence)
    }

    /// The transfer as an event; its data moves there.
    fn describe(&self, server: NodeId, transfer: &mut Transfer, end: Option<Timestamp>) -> SdoTransfer {
        let (request, response) =
            self.channel_ids(transfer.channel).unwrap_or((Frame::EMPTY.id, Frame::EMPTY.id));
        let (previous, previous_assumed) = self.previous(server, transfer.object);
        let (effect, persists) = self.consequence(server, transfer);
        SdoTransfer {
            meaning: transfer.object.and_then(|object| self.meaning(server, object)).map(Arc::new),
            effect,
            persists,
            request,
            response,
            client: self.channels.client(transfer.channel),
            direction: transfer.direction,
            mode: transfer.mode,
            object: transfer.object,
            size: transfer.size,
            announced: transfer.announced,
            data: std::mem::take(&mut transfer.data),
            truncated: transfer.truncated,
            previous,
            previous_assumed,
            duration: transfer.duration(),
            waited: transfer.waited(end.map(|end| end.0)),
            outcome: transfer.outcome,
            abort: transfer.abort,
            crc: transfer.crc(),
            irregularity: transfer.irregularity,
            cut_start: transfer.cut_start,
            cut_end: transfer.outcome == Outcome::Unfinished,
            frame_count: transfer.frame_count,
        }
    }
}
