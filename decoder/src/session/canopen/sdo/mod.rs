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
mod strays;
#[cfg(test)]
mod tests;
mod transfer;
mod transfers;
mod unrequested;

use std::sync::Arc;

use transfer::SdoTransferState;
use transfers::{ChannelTimeout, SdoTransfers};

use crate::bus_file::encode_number;
use crate::event::{EventKind, EvictedState, SdoDirection, SdoOutcome, SdoTransfer};
use crate::frame::{Frame, FrameFlags, Timestamp};
use crate::profile::{ObjectMeaning, Persistence, SubEntry, WriteEffect};
use crate::session::bus::{Bus, OriginKind};
use crate::session::context::MachineContext;
use crate::session::machine::{ProtocolMachine, TimedMachine};
use crate::session::objects::{ObjectTransfer, mark_value_stale};
use crate::session::presence::mark_alive;
use crate::session::timers::DeadlineSubject;
use crate::wire::canopen::ObjectAddress;
use crate::wire::canopen::sdo::{self, SdoMessage as Message, SdoSide};
use crate::wire::{MalformedPayload, NodeId};

/// SDO transfers of all channels.
#[derive(Debug, Clone, Default)]
pub(in crate::session) struct SdoMachine {
    transfers: SdoTransfers,
}

impl ProtocolMachine for SdoMachine {
    /// Sender of the identifier, and number of the channel.
    type Route<'a> = (SdoSide, u16);
    /// Object value, if the frame completes its transfer.
    type Product = Option<ObjectTransfer>;

    fn on_frame(
        &mut self,
        (side, channel): (SdoSide, u16),
        frame: &Frame,
        cx: &mut MachineContext<'_>,
    ) -> Self::Product {
        let server = cx.bus.channels.server_node(channel)?;
        let node = NodeId::Canopen(server);
        match side {
            SdoSide::Client => cx.bus.protocols.canopen.note_request(server, frame.data()),
            SdoSide::Server => cx.bus.protocols.canopen.note_response(server, frame.data()),
        }
        if !cx.is_followed(Some(node), frame) {
            return None;
        }
        if side == SdoSide::Server {
            mark_alive(node, frame, cx);
        }
        // CiA 301 §7.2.4.3: every SDO message has eight bytes.
        if frame.length != 8 && !frame.flags.contains(FrameFlags::REMOTE) {
            cx.emit_contradicted_name(node, frame, "SDO of 8 bytes");
        }
        if !cx.is_settled(Some(node)) && !sdo::has_valid_command(frame.data(), side) {
            cx.bus.protocols.canopen.add_foreign_sdo();
        }
        if side == SdoSide::Client && self.transfers.take_own_response(channel, frame) {
            return None;
        }
        let message = self.parse_frame(node, (side, channel), frame, cx)?;
        let now = cx.bus.clock.now();
        if !cx.is_settled(Some(node)) && !message.starts_transfer() && !self.transfers.is_answered(channel) {
            // Without evidence of CANopen, a transfer without start is decoded only after a frame of the
            // other side. A message that starts a transfer may come from a master that scans for nodes.
            cx.bus.protocols.canopen.count_unsupported(server, now);
            cx.emit_undecoded(frame, None);
        }
        let elsewhere = cx.open_data.isotp + cx.open_data.uds;
        let finished = self.transfers.take_message(channel, side, message, frame, elsewhere);
        cx.open_data.sdo = self.transfers.open_bytes();
        let mut value = None;
        for mut transfer in finished {
            transfer.is_unrequested |= self.transfers.link_misplaced(channel, &transfer, frame);
            value = emit_transfer(node, transfer, frame, cx);
        }
        if self.transfers.take_overflow() {
            let kind = EventKind::Evicted { what: EvictedState::SdoData, count: 1 };
            cx.emit_event(frame, node, false, kind);
        }
        if cx.bus.clock.has_timestamps() {
            let silence = cx.bus.options.sdo_silence;
            if self.transfers.set_deadline(channel, now, silence) {
                let deadline = now.saturating_add(silence);
                cx.timers.add_deadline(deadline, DeadlineSubject::SdoChannel(channel));
            }
        }
        value
    }

    fn on_silence(&mut self, delay: i64, _: &mut Bus) {
        self.transfers.postpone_deadlines(delay);
    }

    /// Ends open transfers as unfinished.
    fn on_end(&mut self, cx: &mut MachineContext<'_>) {
        let frame = cx.last_frame();
        for transfer in self.transfers.drain_transfers() {
            if let Some(server) = cx.bus.channels.server_node(transfer.channel) {
                emit_transfer(NodeId::Canopen(server), transfer, &frame, cx);
            }
        }
    }

    fn memory_size(&self) -> usize {
        self.transfers.footprint()
    }
}

impl TimedMachine for SdoMachine {
    /// Channel number.
    type Deadline = u16;

    fn on_deadline(&mut self, channel: u16, now: i64, cx: &mut MachineContext<'_>) -> Self::Product {
        loop {
            match self.transfers.evaluate_timer(channel, now) {
                ChannelTimeout::Nothing => return None,
                ChannelTimeout::Later(deadline) => {
                    cx.timers.add_deadline(deadline, DeadlineSubject::SdoChannel(channel));
                    return None;
                }
                ChannelTimeout::Over(transfer, deadline) => {
                    cx.open_data.sdo = self.transfers.open_bytes();
                    let server = cx.bus.channels.server_node(channel)?;
                    let mut frame = Frame { number: transfer.frames.last, ..Frame::EMPTY };
                    frame.time = cx.bus.clock.stamp_of(deadline);
                    emit_transfer(NodeId::Canopen(server), transfer, &frame, cx);
                }
            }
        }
    }
}

impl SdoMachine {
    /// Message of a frame; a malformed message is reported.
    fn parse_frame<'f>(
        &mut self,
        node: NodeId,
        (side, channel): (SdoSide, u16),
        frame: &'f Frame,
        cx: &mut MachineContext<'_>,
    ) -> Option<Message<'f>> {
        let phase = self.transfers.phase_of(channel, side, frame.data());
        let message = match sdo::parse(frame.data(), side, phase) {
            Ok(message) => message,
            Err(error) => {
                cx.emit_malformed(frame, node, error, "too short for its SDO command");
                return None;
            }
        };
        if let Message::Unknown { .. } = message {
            self.transfers.note_unknown_command(channel, side, frame);
            if !cx.is_settled(Some(node)) {
                cx.emit_undecoded(frame, None);
                return None;
            }
            let error = MalformedPayload { layer: "sdo", offset: 0, needed: 0, available: frame.length };
            cx.emit_malformed(frame, node, error, "unknown SDO command specifier");
            return None;
        }
        Some(message)
    }
}

/// Emits a transfer; returns its value if complete. `frame` is the last one of the transfer.
fn emit_transfer(
    server: NodeId,
    mut transfer: Box<SdoTransferState>,
    frame: &Frame,
    cx: &mut MachineContext<'_>,
) -> Option<ObjectTransfer> {
    let is_settled = cx.bus.protocols.is_settled(Some(server));
    let is_foreign = cx.bus.protocols.is_canopen_rejected() || transfer.cut_start;
    if !is_settled && is_foreign && !transfer.is_answered() {
        return None;
    }
    let described = transfer_event(&cx.bus, server, &mut transfer, frame.time);
    let mut event = cx.canopen_event(frame, EventKind::SdoTransfer(Box::new(described)));
    event.node = Some(server);
    event.presumed = !cx.bus.protocols.is_settled(Some(server));
    event.frames = transfer.frames;
    cx.send_event(&event);
    let EventKind::SdoTransfer(described) = event.kind else { return None };
    // A response without a request may be that of another device with the same node-ID.
    let is_whole = described.outcome == SdoOutcome::Complete
        && !described.truncated
        && !described.is_ambiguous
        && !described.is_unrequested;
    let has_value = is_whole && (!described.cut_start || transfer.value_is_whole());
    let kind = match described.direction? {
        SdoDirection::Upload => OriginKind::Upload,
        SdoDirection::Download => OriginKind::Download,
    };
    let object = described.object?;
    if !has_value {
        if kind == OriginKind::Download && described.outcome != SdoOutcome::Aborted {
            // The server may have accepted a value that the capture does not contain.
            mark_value_stale(&mut cx.bus, server, object);
        }
        return None;
    }
    Some(ObjectTransfer { node: server, object, value: described.data, kind })
}

/// Value before a transfer, from the store or as delivered; `true` if it is assumed.
fn previous_value(bus: &Bus, server: NodeId, object: Option<ObjectAddress>) -> (Option<Vec<u8>>, bool) {
    let (Some(node), Some(object)) = (bus.node(server), object) else { return (None, false) };
    if let Some(entry) = node.store().get(object) {
        return (Some(entry.value.clone()), entry.stale);
    }
    let entry = node.device().dictionary.find_object(object).and_then(|found| found.entry);
    let number =
        entry.and_then(|entry| Some((entry.default_number(Some(server.number()))?, entry.data_type)));
    (number.and_then(|(number, data_type)| encode_number(number, data_type).ok()), true)
}

/// Effect and persistence of a write, from the device's profile.
fn write_consequence(
    bus: &Bus,
    server: NodeId,
    transfer: &SdoTransferState,
) -> (Option<WriteEffect>, Option<Persistence>) {
    let is_write =
        transfer.direction == Some(SdoDirection::Download) && transfer.outcome == SdoOutcome::Complete;
    let object = transfer.object.filter(|_| is_write);
    let entry = object.and_then(|object| bus.node(server)?.device().dictionary.find_object(object)?.entry);
    entry.map_or((None, None), SubEntry::write_consequence)
}

/// Meaning of the transferred data.
fn data_meaning(bus: &Bus, server: NodeId, transfer: &SdoTransferState) -> Option<ObjectMeaning> {
    let meaning = bus.nodes.meaning(server, transfer.object?)?;
    Some(if transfer.direction == Some(SdoDirection::Download) { meaning.for_write() } else { meaning })
}

/// Event of a transfer; the data moves to the event.
fn transfer_event(
    bus: &Bus,
    server: NodeId,
    transfer: &mut SdoTransferState,
    end: Option<Timestamp>,
) -> SdoTransfer {
    let (request, response) =
        bus.channels.channel_ids(transfer.channel).unwrap_or((Frame::EMPTY.id, Frame::EMPTY.id));
    let (previous, previous_assumed) = previous_value(bus, server, transfer.object);
    let (effect, persists) = write_consequence(bus, server, transfer);
    let (missing_segments, losses, first_loss) = transfer.count_losses();
    if transfer.is_flood() {
        (transfer.size, transfer.unseen) = (0, 0);
        (transfer.data, transfer.later_data) = (Vec::new(), Vec::new());
    }
    SdoTransfer {
        meaning: data_meaning(bus, server, transfer).map(Arc::new),
        effect,
        persists,
        request,
        response,
        client: bus.channels.client_node(transfer.channel),
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
        waited: transfer.waiting_time(end.map(|end| end.0)),
        outcome: transfer.outcome,
        abort: transfer.abort,
        crc: transfer.crc_verdict(),
        irregularity: transfer.irregularity,
        overlap: transfer.overlap,
        retries: transfer.retries,
        is_ambiguous: transfer.is_ambiguous,
        is_unrequested: transfer.is_unrequested || transfer.is_flood(),
        unrequested_responses: transfer.unrequested_responses,
        misplaced: transfer.misplaced,
        awaits_client: transfer.last_side == Some(SdoSide::Server),
        cut_start: transfer.cut_start,
        cut_end: transfer.outcome == SdoOutcome::Unfinished,
        frame_count: transfer.frame_count,
    }
}
