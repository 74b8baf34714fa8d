//! EMCY: errors raised and cleared.

use super::boot::{boot_cause, on_restart};
use super::nmt::presume_state;
use crate::event::{ByteOrderSource, EmcyAction, Emergency, EventKind, EvictedState, StateCause};
use crate::frame::Frame;
use crate::profile::device::{BootSign, ClearMeaning, ErrorCodeOrder, NmtName};
use crate::profile::{DeviceProfile, emcy_codes};
use crate::session::bus::{DetectedByteOrder, Node};
use crate::session::context::MachineContext;
use crate::session::detection::ProtocolStatus;
use crate::session::device::on_emcy_code;
use crate::session::machine::ProtocolMachine;
use crate::session::presence::mark_alive;
use crate::wire::canopen::emcy::{self, EmcyByteOrder, EmcyMessage as Message};
use crate::wire::canopen::{NmtState, ObjectAddress};
use crate::wire::{MalformedPayload, NodeId};

/// Life guard or heartbeat error (CiA 301 §7.2.7.1, table 26), for devices without a code of their own.
const LIFE_GUARD_ERROR: u16 = 0x8130;

/// Frames on identifiers of EMCY that are held until CANopen is proven.
const HELD_FRAMES: usize = 16;

/// Time in ns after which such a frame is not held any more: several heartbeats.
const HELD_TIME: i64 = 10_000_000_000;

/// EMCY messages of all nodes; active errors and the detected byte order are in the node.
#[derive(Debug, Clone, Default)]
pub(in crate::session) struct EmcyMachine {
    /// Frames that may be EMCY and were emitted undecoded, because nothing proved CANopen yet; oldest first.
    held: Option<Box<HeldEmergencies>>,
}

/// Frames with their nodes, oldest first; apart from the machine, because few buses have some.
#[derive(Debug, Clone, Default)]
struct HeldEmergencies(Vec<(NodeId, Frame)>);

impl EmcyMachine {
    /// Whether frames wait for the proof of CANopen.
    #[inline]
    pub(in crate::session) fn holds_frames(&self) -> bool {
        self.held.is_some()
    }

    /// Decodes the held frames in their order, once, if CANopen is proven, by `frame` (`is_proof`) or before; as if the proof
    /// had preceded them.
    #[cold]
    pub(in crate::session) fn on_proof(
        &mut self,
        is_proof: bool,
        frame: &Frame,
        cx: &mut MachineContext<'_>,
    ) {
        if is_proof && !cx.bus.protocols.canopen.is_confirmed() {
            cx.bus.protocols.canopen.add_evidence();
        }
        if !cx.bus.protocols.canopen.is_confirmed() {
            return;
        }
        for (id, held) in self.held.take().map_or_else(Vec::new, |held| held.0) {
            let elapsed = frame.time.zip(held.time).map_or(0, |(now, then)| now.since(then));
            if elapsed <= HELD_TIME {
                let (count, _) = &mut cx.bus.protocols.undecoded;
                *count = count.saturating_sub(1);
                self.on_frame(id, &held, cx);
            }
        }
    }

    /// Holds a frame of the length of an EMCY.
    fn hold_frame(&mut self, id: NodeId, frame: &Frame, cx: &MachineContext<'_>) {
        if frame.length == EMCY_LENGTH
            && cx.described_message(frame).is_none()
            && cx.bus.protocols.canopen.protocol_status() == ProtocolStatus::Presumed
        {
            let held = &mut self.held.get_or_insert_default().0;
            if held.len() >= HELD_FRAMES {
                held.remove(0);
            }
            held.push((id, *frame));
        }
    }
}

/// Bytes of an EMCY (CiA 301 §7.2.7.2).
const EMCY_LENGTH: u8 = 8;

impl ProtocolMachine for EmcyMachine {
    type Route<'a> = NodeId;
    type Product = ();

    fn on_frame(&mut self, id: NodeId, frame: &Frame, cx: &mut MachineContext<'_>) {
        if !is_admitted(id, frame, cx) {
            return self.hold_frame(id, frame, cx);
        }
        if frame.length == 1 {
            cx.emit_contradicted_name(id, frame, "EMCY of 8 bytes");
        }
        let Some(node) = cx.bus.nodes.node_mut(id) else { return };
        let (byte_order, byte_order_by) = byte_order(node, frame.data());
        let contradicted = node.contradicted.take();
        let message = match emcy::parse(frame.data(), byte_order) {
            Ok(message) => message,
            Err(error) => return cx.emit_malformed(frame, id, error, "an error code has two bytes"),
        };
        // The boot sign of a device without boot-up message is an EMCY.
        let starts = node.device.nmt.boot == BootSign::ReadyTelegram
            && (message == Message::Ready || node.reset_frame.is_some());
        let boot = starts.then(|| boot_cause(&mut cx.bus, id));
        mark_alive(id, frame, cx);
        let Some(node) = cx.bus.nodes.node_mut(id) else { return };
        if starts {
            node.errors.clear_all();
            node.guarding.restart_series();
            node.heartbeat.restart_series();
        }
        let ((code, register, vendor, vendor_length), action, fits) = apply_message(message, node);
        let alternative = code.and_then(|code| swapped_code(&node.device, code));
        let active = u16::try_from(node.active_errors().len()).unwrap_or(u16::MAX);
        let emergency = Emergency {
            cob_id: frame.id,
            code,
            register,
            vendor,
            vendor_length,
            action,
            active,
            byte_order,
            byte_order_by,
            alternative,
            boot,
        };
        cx.emit_event(frame, id, false, EventKind::Emcy(emergency));
        emit_short(id, frame, cx);
        if !fits {
            cx.emit_event(frame, id, false, EventKind::Evicted { what: EvictedState::ActiveError, count: 1 });
        }
        emit_contradiction(id, contradicted, frame, cx);
        if let Some(cause) = boot {
            on_restart(id, cause, frame, cx);
        }
        if let Some(code) = code {
            apply_emcy_to_nmt(id, code, frame, cx);
            on_emcy_code(id, code, frame, cx);
        }
    }
}

/// Reports an EMCY that lacks bytes of CiA 301 §7.2.7.2, after its event; a device without boot-up message follows version
/// 3, which has shorter ones.
fn emit_short(id: NodeId, frame: &Frame, cx: &mut MachineContext<'_>) {
    let is_early = cx.bus.node(id).is_some_and(|node| node.device.nmt.boot == BootSign::ReadyTelegram);
    if !is_early && (1..EMCY_LENGTH).contains(&frame.length) {
        let error =
            MalformedPayload { layer: "emcy", offset: 0, needed: EMCY_LENGTH, available: frame.length };
        cx.emit_malformed(frame, id, error, "an EMCY has eight bytes");
    }
}

/// Whether a frame is decoded as EMCY; otherwise it is emitted undecoded.
fn is_admitted(id: NodeId, frame: &Frame, cx: &mut MachineContext<'_>) -> bool {
    if !cx.is_settled(Some(id)) {
        let now = cx.bus.clock.now();
        cx.bus.protocols.canopen.count_unsupported(id.number(), now);
        let active = cx.bus.node(id).map_or(&[][..], Node::active_errors);
        if !is_plausible(active, frame) {
            cx.emit_undecoded(frame, None);
            return false;
        }
    }
    cx.is_decoded(Some(id), frame)
}

/// Code, register, vendor-specific bytes and their number.
type Content = (Option<u16>, Option<u8>, [u8; 5], u8);

/// Stores a message in its node; returns its content, its effect, and `false` if the table of active errors is full.
fn apply_message(message: Message, node: &mut Node) -> (Content, EmcyAction, bool) {
    match message {
        Message::Ready => {
            node.signs.is_ready_sent = true;
            ((None, None, [0; 5], 0), EmcyAction::Ready, true)
        }
        Message::Error { code, register, vendor, vendor_length } => {
            node.signs.note_emcy(code);
            let action = if code == 0 { end_of_error(node, register) } else { EmcyAction::Raised };
            let fits = action != EmcyAction::Raised || node.errors.raise_error(code);
            ((Some(code), register, vendor, vendor_length), action, fits)
        }
    }
}

/// Whether a frame may be an EMCY although nothing shows that the bus uses CANopen: the identifiers 081 to 0FF are
/// common in cars. An EMCY reports a defined error once, with the generic bit of the register set, and its end
/// (CiA 301 §7.2.7.1); it has eight bytes, or none in version 3.
fn is_plausible(active: &[u16], frame: &Frame) -> bool {
    let [low, high, register, ..] = frame.data() else { return frame.length == 0 };
    let is_new = |code: u16| {
        let is_defined = code != 0 && emcy_codes().find_code(u32::from(code)).is_some();
        // Bit 6 of the error register is reserved (CiA 301 §7.5.2.2).
        is_defined && register & 0x41 == 1 && !active.contains(&code)
    };
    let codes = [u16::from_le_bytes([*low, *high]), u16::from_be_bytes([*low, *high])];
    let ends = codes == [0, 0] && !active.is_empty();
    frame.length == 8 && (ends || codes.into_iter().any(is_new))
}

fn emit_contradiction(id: NodeId, object: Option<ObjectAddress>, frame: &Frame, cx: &mut MachineContext<'_>) {
    if let Some(object) = object {
        let text =
            format!("node {id}: EMCY codes contradict the value of {object} presumed since the restart");
        cx.emit_note(frame, text);
    }
}

/// A node leaves operational if guarding stops (CiA 301 §7.2.8.3.2.2, object 1029), or after errors for
/// which its manual states this.
fn apply_emcy_to_nmt(id: NodeId, code: u16, frame: &Frame, cx: &mut MachineContext<'_>) {
    let Some(node) = cx.bus.node(id) else { return };
    let is_life_guard = code == node.device.monitoring.life_guard_emcy.unwrap_or(LIFE_GUARD_ERROR);
    let to = match node.device.error_entry(code) {
        Some(error) => error.nmt.map(NmtName::state),
        None => is_life_guard.then_some(NmtState::PreOperational),
    };
    let operational = node.nmt.is_some_and(|nmt| nmt.state == NmtState::Operational);
    let cause = if is_life_guard { StateCause::LifeGuard } else { StateCause::Emcy };
    if let Some(to) = to.filter(|_| operational) {
        presume_state(id, to, cause, frame, cx);
    }
}

/// Meaning of code 0000.
fn end_of_error(node: &mut Node, register: Option<u8>) -> EmcyAction {
    let just_booted = std::mem::replace(&mut node.just_booted, false);
    if just_booted && node.active_errors().is_empty() {
        return EmcyAction::NoErrorAtBoot;
    }
    // Code 0000 does not identify the cleared error. The register shows whether errors remain
    // (CiA 301 §7.2.7.1), unless the device sends 0000 only when no error remains.
    let all_gone =
        node.device.emcy.cleared == ClearMeaning::AllGone || register.is_none_or(|register| register == 0);
    if all_gone {
        node.errors.clear_all();
        EmcyAction::AllCleared
    } else {
        EmcyAction::Cleared
    }
}

/// Byte order of the node's EMCY codes, and its source.
///
/// A confirmed value of the object that sets the byte order has precedence. If the value is unknown, or
/// doubtful after a restart, the order is taken from the first code that the profile knows in one order only.
fn byte_order(node: &mut Node, data: &[u8]) -> (EmcyByteOrder, ByteOrderSource) {
    let Some(order) = &node.device.emcy.byte_order else {
        return (EmcyByteOrder::LsbFirst, ByteOrderSource::Standard);
    };
    let ErrorCodeOrder::ByObject { object, .. } = order else {
        return (order.order_for(None), ByteOrderSource::Profile);
    };
    let known = node.store.get(object.object);
    let value = node.store.number(object.object).and_then(|value| i64::try_from(value).ok());
    let stated = order.order_for(value);
    if known.is_some_and(|entry| !entry.stale) {
        return (stated, ByteOrderSource::Wire);
    }
    if let Some(DetectedByteOrder(learnt)) = node.emcy_order {
        return (learnt, ByteOrderSource::Learnt);
    }
    let other = opposite_order(stated);
    let (object, was_known) = (object.object, known.is_some());
    let origin = if was_known { ByteOrderSource::Presumed } else { ByteOrderSource::Profile };
    if !is_code(&node.device, data, stated) && is_code(&node.device, data, other) {
        node.emcy_order = Some(DetectedByteOrder(other));
        node.contradicted = was_known.then_some(object);
        return (other, ByteOrderSource::Learnt);
    }
    if is_code(&node.device, data, stated) {
        node.emcy_order = Some(DetectedByteOrder(stated));
    }
    (stated, origin)
}

const fn opposite_order(order: EmcyByteOrder) -> EmcyByteOrder {
    match order {
        EmcyByteOrder::LsbFirst => EmcyByteOrder::MsbFirst,
        EmcyByteOrder::MsbFirst => EmcyByteOrder::LsbFirst,
    }
}

/// Whether a message, decoded in this byte order, has a code of the profile other than 0000.
fn is_code(device: &DeviceProfile, data: &[u8], order: EmcyByteOrder) -> bool {
    match emcy::parse(data, order) {
        Ok(Message::Error { code, .. }) => code != 0 && device.error_entry(code).is_some(),
        _ => false,
    }
}

/// Code in the other byte order, if the profile has this code and not the decoded one.
fn swapped_code(device: &DeviceProfile, code: u16) -> Option<u16> {
    let other = code.swap_bytes();
    let only_other = device.error_entry(code).is_none() && device.error_entry(other).is_some() && code != 0;
    only_other.then_some(other)
}
