//! Frames before J1939 is confirmed, and who sends them.

use crate::frame::{Frame, FrameFlags};
use crate::session::bus::Bus;
use crate::session::context::Context;
use crate::wire::NodeId;
use crate::wire::j1939::{J1939Id, NO_ADDRESS};

/// Without a sign of J1939 yet: whether the frame is read as such, marked as presumed.
#[cold]
pub(in crate::session) fn is_followed(id: J1939Id, frame: &Frame, cx: &mut Context<'_>) -> bool {
    let is_plain = !frame.flags.contains(FrameFlags::REMOTE) && !frame.flags.contains(FrameFlags::FD);
    cx.bus.j1939.weigh(id, frame.data(), is_plain);
    if !is_plain || cx.bus.j1939.is_rejected() {
        emit_rejection(frame, cx);
        cx.emit_undecoded(frame, None);
        return false;
    }
    true
}

fn emit_rejection(frame: &Frame, cx: &mut Context<'_>) {
    if let Some(reason) = cx.bus.j1939.take_reason() {
        let text = format!("29-bit frames are not taken for J1939: {reason}; --protocol j1939 decodes them");
        cx.emit_note(frame, text);
    }
}

/// The device at an address sent a frame.
#[inline]
pub(in crate::session) fn mark_sender_alive(bus: &mut Bus, source: u8, frame: &Frame) {
    if source >= NO_ADDRESS {
        return;
    }
    let now = bus.clock.now();
    let Some(node) = bus.node_mut(NodeId::J1939(source)) else { return };
    if node.first_frame == 0 {
        node.first_frame = frame.number;
    }
    node.last_frame = frame.number;
    node.last_seen = frame.time;
    node.last_heard = now;
}
