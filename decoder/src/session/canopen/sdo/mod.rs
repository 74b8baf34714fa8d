//! SDO: many messages become one transfer.
//!
//! ```text
//! Sdo::on_frame ─▶ wire::sdo::parse(side, phase) ─▶ Transfers, Channel ─▶ Transfer (block.rs: its blocks) ─▶ event
//! ```

mod block;
mod channel;
mod transfer;
mod transfers;

use std::sync::Arc;

use transfer::Transfer;
use transfers::{Due, Transfers};

use crate::bus_file::encode;
use crate::event::{Direction, EventKind, Outcome, SdoTransfer};
use crate::frame::{Frame, Timestamp};
use crate::profile::{Effect, Entry};
use crate::session::bus::{Bus, OriginKind};
use crate::session::context::Context;
use crate::session::machine::{Machine, Timed};
use crate::session::objects::ObjectTransfer;
use crate::session::presence::mark_alive;
use crate::session::timers::Subject;
use crate::wire::canopen::ObjectAddress;
use crate::wire::canopen::sdo::{self, Sdo as Message, Side};
use crate::wire::{Malformed, NodeId};

/// SDO transfers of all channels.
#[derive(Debug, Clone, Default)]
pub(in crate::session) struct Sdo {
    transfers: Transfers,
}

impl Machine for Sdo {
    /// Who sends the identifier, and the number of the channel.
    type Route<'a> = (Side, u16);
    /// The value of an object, where the frame completes its transfer.
    type Product = Option<ObjectTransfer>;

    fn on_frame(
        &mut self,
        (side, channel): (Side, u16),
        frame: &Frame,
        cx: &mut Context<'_>,
    ) -> Self::Product {
        let server = cx.bus.channels.server(channel)?;
        let node = NodeId::Canopen(server);
        match side {
            Side::Client => cx.bus.canopen.note_request(server, frame.data()),
            Side::Server => cx.bus.canopen.note_response(server, frame.data()),
        }
        if !cx.is_followed(frame) {
            return None;
        }
        if side == Side::Server {
            mark_alive(node, frame, cx);
        }
        let (message, command) = self.parse(node, (side, channel), frame, cx)?;
        let now = cx.bus.clock.now();
        if !cx.bus.canopen.is_confirmed() && !message.begins() && !self.transfers.is_answered(channel) {
            // Without a sign of CANopen a message without its beginning is followed, but not decoded as SDO before the
            // other side joins in. One that begins a transfer may well be a master looking for nodes that are not there.
            cx.bus.canopen.count_unsupported(server, now);
            cx.emit_undecoded(frame, None);
        }
        let elsewhere = cx.open_data.isotp + cx.open_data.uds;
        let finished = self.transfers.take(channel, side, message, command, frame, elsewhere);
        cx.open_data.sdo = self.transfers.open_bytes();
        let mut value = None;
        for transfer in finished.into_iter().flatten() {
            value = emit_transfer(node, transfer, frame, cx);
        }
        if self.transfers.take_overflow() {
            let kind = EventKind::Evicted { what: "data of open SDO transfers", count: 1 };
            cx.emit(frame, node, false, kind);
        }
        if cx.bus.clock.runs() {
            let deadline = now.saturating_add(cx.bus.options.sdo_silence);
            if self.transfers.arm(channel, deadline) {
                cx.timers.add(deadline, Subject::SdoChannel(channel));
            }
        }
        value
    }

    fn on_silence(&mut self, delay: i64, _: &mut Bus) {
        self.transfers.postpone(delay);
    }

    /// Open transfers are unfinished.
    fn on_end(&mut self, cx: &mut Context<'_>) {
        let frame = cx.last_frame();
        for transfer in self.transfers.drain() {
            if let Some(server) = cx.bus.channels.server(transfer.channel) {
                emit_transfer(NodeId::Canopen(server), transfer, &frame, cx);
            }
        }
    }

    fn footprint(&self) -> usize {
        self.transfers.footprint()
    }
}

impl Timed for Sdo {
    /// Number of a channel.
    type Deadline = u16;

    fn on_deadline(&mut self, channel: u16, now: i64, cx: &mut Context<'_>) -> Self::Product {
        match self.transfers.due(channel, now) {
            Due::Nothing => {}
            Due::Later(deadline) => cx.timers.add(deadline, Subject::SdoChannel(channel)),
            Due::Over(transfer, deadline) => {
                cx.open_data.sdo = self.transfers.open_bytes();
                let server = cx.bus.channels.server(channel)?;
                let mut frame = Frame { number: transfer.frames.last, ..Frame::EMPTY };
                frame.time = cx.bus.clock.stamp_of(deadline);
                return emit_transfer(NodeId::Canopen(server), transfer, &frame, cx);
            }
        }
        None
    }
}

impl Sdo {
    /// The message of a frame and its command byte; reports one that cannot be understood.
    fn parse<'f>(
        &mut self,
        node: NodeId,
        (side, channel): (Side, u16),
        frame: &'f Frame,
        cx: &mut Context<'_>,
    ) -> Option<(Message<'f>, u8)> {
        let phase = self.transfers.phase(channel, side);
        let message = match sdo::parse(frame.data(), side, phase) {
            Ok(message) => message,
            Err(error) => {
                cx.emit_malformed(frame, node, error, "too short for its SDO command");
                return None;
            }
        };
        if let Message::Unknown { command } = message {
            self.transfers.note_unknown_command(channel, side, command);
            let error = Malformed { layer: "sdo", offset: 0, needed: 0, available: frame.length };
            cx.emit_malformed(frame, node, error, "unknown SDO command specifier");
            return None;
        }
        Some((message, frame.data().first().copied().unwrap_or(0)))
    }
}

/// Emits a transfer; its value where all of it was transferred. `frame` is the one that ended it.
fn emit_transfer(
    server: NodeId,
    mut transfer: Box<Transfer>,
    frame: &Frame,
    cx: &mut Context<'_>,
) -> Option<ObjectTransfer> {
    if !cx.bus.canopen.is_confirmed() && transfer.cut_start && !transfer.is_answered() {
        return None;
    }
    let described = describe(&cx.bus, server, &mut transfer, frame.time);
    let mut event = cx.event(frame, EventKind::SdoTransfer(Box::new(described)));
    event.node = Some(server);
    event.frames = transfer.frames;
    cx.send(&event);
    let EventKind::SdoTransfer(described) = event.kind else { return None };
    let is_whole = described.outcome == Outcome::Complete && !described.truncated;
    let has_value = is_whole && (!described.cut_start || transfer.value_is_whole());
    let kind = match described.direction? {
        Direction::Upload => OriginKind::Upload,
        Direction::Download => OriginKind::Download,
    };
    let object = described.object.filter(|_| has_value)?;
    Some(ObjectTransfer { node: server, object, value: described.data, kind })
}

/// The value before a transfer: seen, or as delivered.
fn previous(bus: &Bus, server: NodeId, object: Option<ObjectAddress>) -> (Option<Vec<u8>>, bool) {
    let (Some(node), Some(object)) = (bus.node(server), object) else { return (None, false) };
    if let Some(entry) = node.store().get(object) {
        return (Some(entry.value.clone()), entry.stale);
    }
    let entry = node.device().dictionary.find(object).and_then(|found| found.entry);
    let number =
        entry.and_then(|entry| Some((entry.default_number(Some(server.number()))?, entry.data_type)));
    (number.and_then(|(number, data_type)| encode(number, data_type).ok()), true)
}

/// When a write acts and whether it stays, where the device's profile tells.
fn consequence(bus: &Bus, server: NodeId, transfer: &Transfer) -> (Option<Effect>, Option<&'static str>) {
    let is_write = transfer.direction == Some(Direction::Download) && transfer.outcome == Outcome::Complete;
    let object = transfer.object.filter(|_| is_write);
    let entry = object.and_then(|object| bus.node(server)?.device().dictionary.find(object)?.entry);
    entry.map_or((None, None), Entry::consequence)
}

/// The transfer as an event; its data moves there.
fn describe(bus: &Bus, server: NodeId, transfer: &mut Transfer, end: Option<Timestamp>) -> SdoTransfer {
    let (request, response) = bus.channel_ids(transfer.channel).unwrap_or((Frame::EMPTY.id, Frame::EMPTY.id));
    let (previous, previous_assumed) = previous(bus, server, transfer.object);
    let (effect, persists) = consequence(bus, server, transfer);
    SdoTransfer {
        meaning: transfer.object.and_then(|object| bus.meaning(server, object)).map(Arc::new),
        effect,
        persists,
        request,
        response,
        client: bus.channels.client(transfer.channel),
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
