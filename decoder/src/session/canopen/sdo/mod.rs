//! SDO: combines messages to transfers.
//!
//! ```text
//! Sdo::on_frame ─▶ wire::sdo::parse(side, phase) ─▶ Transfers, Channel ─▶ Transfer, Blocks ─▶ event
//! ```

mod block;
mod channel;
mod pending;
mod segmented;
mod segments;
mod transfer;
mod transfers;

use std::sync::Arc;

use transfer::Transfer;
use transfers::{Due, Transfers};

use crate::bus_file::encode;
use crate::event::{Direction, EventKind, EvictedState, Outcome, SdoTransfer};
use crate::frame::{Frame, FrameFlags, Timestamp};
use crate::profile::{Effect, Entry, Meaning, Persistence};
use crate::session::bus::{Bus, OriginKind};
use crate::session::context::Context;
use crate::session::machine::{Machine, Timed};
use crate::session::objects::{ObjectTransfer, mark_value_stale};
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
    /// Sender of the identifier, and number of the channel.
    type Route<'a> = (Side, u16);
    /// Object value, if the frame completes its transfer.
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
        if !cx.is_followed(Some(node), frame) {
            return None;
        }
        if side == Side::Server {
            mark_alive(node, frame, cx);
        }
        // CiA 301 §7.2.4.3: every SDO message has eight bytes.
        if frame.length != 8 && !frame.flags.contains(FrameFlags::REMOTE) {
            cx.emit_contradicted_name(node, frame, "SDO of 8 bytes");
        }
        let message = self.parse(node, (side, channel), frame, cx)?;
        let now = cx.bus.clock.now();
        if !cx.is_settled(Some(node)) && !message.begins() && !self.transfers.is_answered(channel) {
            // Without evidence of CANopen, a transfer without start is decoded only after a frame of the
            // other side. A message that starts a transfer may come from a master that scans for nodes.
            cx.bus.canopen.count_unsupported(server, now);
            cx.emit_undecoded(frame, None);
        }
        let elsewhere = cx.open_data.isotp + cx.open_data.uds;
        let finished = self.transfers.take(channel, side, message, frame, elsewhere);
        cx.open_data.sdo = self.transfers.open_bytes();
        let mut value = None;
        for transfer in finished {
            value = emit_transfer(node, transfer, frame, cx);
        }
        if self.transfers.take_overflow() {
            let kind = EventKind::Evicted { what: EvictedState::SdoData, count: 1 };
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

    /// Ends open transfers as unfinished.
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
    /// Channel number.
    type Deadline = u16;

    fn on_deadline(&mut self, channel: u16, now: i64, cx: &mut Context<'_>) -> Self::Product {
        loop {
            match self.transfers.due(channel, now) {
                Due::Nothing => return None,
                Due::Later(deadline) => {
                    cx.timers.add(deadline, Subject::SdoChannel(channel));
                    return None;
                }
                Due::Over(transfer, deadline) => {
                    cx.open_data.sdo = self.transfers.open_bytes();
                    let server = cx.bus.channels.server(channel)?;
                    let mut frame = Frame { number: transfer.frames.last, ..Frame::EMPTY };
                    frame.time = cx.bus.clock.stamp_of(deadline);
                    emit_transfer(NodeId::Canopen(server), transfer, &frame, cx);
                }
            }
        }
    }
}

impl Sdo {
    /// Message of a frame; a malformed message is reported.
    fn parse<'f>(
        &mut self,
        node: NodeId,
        (side, channel): (Side, u16),
        frame: &'f Frame,
        cx: &mut Context<'_>,
    ) -> Option<Message<'f>> {
        let phase = self.transfers.phase(channel, side, frame.data());
        let message = match sdo::parse(frame.data(), side, phase) {
            Ok(message) => message,
            Err(error) => {
                cx.emit_malformed(frame, node, error, "too short for its SDO command");
                return None;
            }
        };
        if let Message::Unknown { .. } = message {
            self.transfers.note_unknown_command(channel, side, frame);
            let error = Malformed { layer: "sdo", offset: 0, needed: 0, available: frame.length };
            cx.emit_malformed(frame, node, error, "unknown SDO command specifier");
            return None;
        }
        Some(message)
    }
}

/// Emits a transfer; returns its value if complete. `frame` is the last one of the transfer.
fn emit_transfer(
    server: NodeId,
    mut transfer: Box<Transfer>,
    frame: &Frame,
    cx: &mut Context<'_>,
) -> Option<ObjectTransfer> {
    if !cx.bus.is_settled(Some(server)) && transfer.cut_start && !transfer.is_answered() {
        return None;
    }
    let described = describe(&cx.bus, server, &mut transfer, frame.time);
    let mut event = cx.event(frame, EventKind::SdoTransfer(Box::new(described)));
    event.node = Some(server);
    event.presumed = !cx.bus.is_settled(Some(server));
    event.frames = transfer.frames;
    cx.send(&event);
    let EventKind::SdoTransfer(described) = event.kind else { return None };
    let is_whole = described.outcome == Outcome::Complete && !described.truncated && !described.is_ambiguous;
    let has_value = is_whole && (!described.cut_start || transfer.value_is_whole());
    let kind = match described.direction? {
        Direction::Upload => OriginKind::Upload,
        Direction::Download => OriginKind::Download,
    };
    let object = described.object?;
    if !has_value {
        if kind == OriginKind::Download && described.outcome != Outcome::Aborted {
            // The server may have accepted a value that the capture does not contain.
            mark_value_stale(&mut cx.bus, server, object);
        }
        return None;
    }
    Some(ObjectTransfer { node: server, object, value: described.data, kind })
}

/// Value before a transfer, from the store or as delivered; `true` if it is assumed.
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

/// Effect and persistence of a write, from the device's profile.
fn consequence(bus: &Bus, server: NodeId, transfer: &Transfer) -> (Option<Effect>, Option<Persistence>) {
    let is_write = transfer.direction == Some(Direction::Download) && transfer.outcome == Outcome::Complete;
    let object = transfer.object.filter(|_| is_write);
    let entry = object.and_then(|object| bus.node(server)?.device().dictionary.find(object)?.entry);
    entry.map_or((None, None), Entry::consequence)
}

/// Meaning of the transferred data.
fn meaning(bus: &Bus, server: NodeId, transfer: &Transfer) -> Option<Meaning> {
    let meaning = bus.meaning(server, transfer.object?)?;
    Some(if transfer.direction == Some(Direction::Download) { meaning.for_write() } else { meaning })
}

/// Event of a transfer; the data moves to the event.
fn describe(bus: &Bus, server: NodeId, transfer: &mut Transfer, end: Option<Timestamp>) -> SdoTransfer {
    let (request, response) = bus.channel_ids(transfer.channel).unwrap_or((Frame::EMPTY.id, Frame::EMPTY.id));
    let (previous, previous_assumed) = previous(bus, server, transfer.object);
    let (effect, persists) = consequence(bus, server, transfer);
    let (missing_segments, losses, first_loss) = transfer.losses();
    SdoTransfer {
        meaning: meaning(bus, server, transfer).map(Arc::new),
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
        later_data: std::mem::take(&mut transfer.later_data),
        unseen: transfer.unseen,
        missing_segments,
        losses,
        first_loss: first_loss.map(|loss| (loss.sequence, loss.frame)),
        truncated: transfer.truncated,
        previous,
        previous_assumed,
        duration: transfer.duration(),
        waited: transfer.waited(end.map(|end| end.0)),
        outcome: transfer.outcome,
        abort: transfer.abort,
        crc: transfer.crc(),
        irregularity: transfer.irregularity,
        overlap: transfer.overlap,
        retries: transfer.retries,
        is_ambiguous: transfer.is_ambiguous,
        is_unrequested: transfer.is_unrequested,
        awaits_client: transfer.last_side == Some(Side::Server),
        cut_start: transfer.cut_start,
        cut_end: transfer.outcome == Outcome::Unfinished,
        frame_count: transfer.frame_count,
    }
}
