//! Frames before J1939 is confirmed, and the presence of senders.

use crate::frame::{Frame, FrameFlags};
use crate::session::bus::Bus;
use crate::session::context::MachineContext;
use crate::session::options::ProtocolChoice;
use crate::wire::NodeId;
use crate::wire::j1939::{J1939Id, NO_ADDRESS};

/// Whether to decode a frame before J1939 is confirmed; its events are marked as presumed.
#[cold]
pub(in crate::session) fn is_followed(id: J1939Id, frame: &Frame, cx: &mut MachineContext<'_>) -> bool {
    let is_plain = !frame.flags.contains(FrameFlags::REMOTE) && !frame.flags.contains(FrameFlags::FD);
    cx.bus.protocols.j1939.weigh_frame(id, frame.data(), is_plain);
    if !is_plain || cx.bus.protocols.choice == ProtocolChoice::None {
        return is_believed(frame, is_plain, cx);
    }
    // The user's database describes the group: its sender uses J1939.
    if cx.bus.database.is_j1939() && cx.bus.database.message_by_pgn(id.pgn).is_some() {
        cx.bus.protocols.named.add_node(NodeId::J1939(id.source), false);
    }
    cx.bus.protocols.named.hear_message(id) || is_believed(frame, is_plain, cx)
}

/// Whether to decode a frame of an address that nobody named.
fn is_believed(frame: &Frame, is_plain: bool, cx: &mut MachineContext<'_>) -> bool {
    if !is_plain || cx.bus.protocols.j1939.is_rejected() {
        cx.bus.protocols.omissions.j1939 +=
            u64::from(is_plain && cx.bus.protocols.choice != ProtocolChoice::None);
        emit_rejection(frame, cx);
        cx.emit_undecoded(frame, None);
        return false;
    }
    true
}

fn emit_rejection(frame: &Frame, cx: &mut MachineContext<'_>) {
    if let Some(reason) = cx.bus.protocols.j1939.take_reason() {
        let text = format!("29-bit frames not detected as J1939: {reason} (--protocol j1939 decodes them)");
        cx.emit_note(frame, text);
    }
}

/// Registers a frame of the device at an address.
#[inline]
pub(in crate::session) fn mark_sender_alive(bus: &mut Bus, source: u8, frame: &Frame) {
    if source >= NO_ADDRESS {
        return;
    }
    let now = bus.clock.now();
    let Some(node) = bus.nodes.node_mut(NodeId::J1939(source)) else { return };
    if node.first_frame == 0 {
        node.first_frame = frame.number;
    }
    node.last_frame = frame.number;
    node.last_seen = frame.time;
    node.last_received = now;
}
