//! EMCY: errors that come and go.

use super::boot::{boot_cause, on_restart};
use super::nmt::presume_state;
use crate::event::{EmcyAction, Emergency, EventKind, StateCause};
use crate::frame::Frame;
use crate::profile::Device;
use crate::profile::device::{Boot, Cleared, NmtName, Order};
use crate::session::bus::{LearntOrder, Node};
use crate::session::context::Context;
use crate::session::device::on_emcy_code;
use crate::session::machine::Machine;
use crate::session::presence::mark_alive;
use crate::wire::NodeId;
use crate::wire::canopen::emcy::{self, ByteOrder, Emcy as Message};
use crate::wire::canopen::{NmtState, ObjectAddress};

/// Life guard or heartbeat error (CiA 301 §7.2.7.1, table 26), where a device has no code of its own.
const LIFE_GUARD_ERROR: u16 = 0x8130;

/// EMCY messages of all nodes; active errors and the learnt byte order are in the node.
#[derive(Debug, Clone)]
pub(in crate::session) struct Emcy;

impl Machine for Emcy {
    type Route<'a> = NodeId;
    type Product = ();

    fn on_frame(&mut self, id: NodeId, frame: &Frame, cx: &mut Context<'_>) {
        let now = cx.bus.clock.now();
        cx.bus.canopen.count_unsupported(id.number(), now);
        if !cx.is_decoded(frame) {
            return;
        }
        let Some(node) = cx.bus.node_mut(id) else { return };
        let (byte_order, byte_order_by) = byte_order(node, frame.data());
        let contradicted = node.contradicted.take();
        let message = match emcy::parse(frame.data(), byte_order) {
            Ok(message) => message,
            Err(error) => return cx.emit_malformed(frame, id, error, "an error code has two bytes"),
        };
        // A node that has no boot-up message shows its start here.
        let starts = node.device.nmt.boot == Boot::ReadyTelegram
            && (message == Message::Ready || node.reset_frame.is_some());
        let boot = starts.then(|| boot_cause(&mut cx.bus, id));
        mark_alive(id, frame, cx);
        let Some(node) = cx.bus.node_mut(id) else { return };
        if starts {
            node.active_errors.clear();
        }
        let mut fits = true;
        let (code, register, vendor, vendor_length, action) = match message {
            Message::Ready => (None, None, [0; 5], 0, EmcyAction::Ready),
            Message::Error { code, register, vendor, vendor_length } => {
                let action = if code == 0 { end_of_error(node, register) } else { EmcyAction::Raised };
                if action == EmcyAction::Raised {
                    fits = node.raise(code);
                }
                (Some(code), register, vendor, vendor_length, action)
            }
        };
        let alternative = code.and_then(|code| alternative(&node.device, code));
        let active = u16::try_from(node.active_errors.len()).unwrap_or(u16::MAX);
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
        cx.emit(frame, id, false, EventKind::Emcy(emergency));
        if !fits {
            cx.emit(frame, id, false, EventKind::Evicted { what: "active error", count: 1 });
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

fn emit_contradiction(id: NodeId, object: Option<ObjectAddress>, frame: &Frame, cx: &mut Context<'_>) {
    if let Some(object) = object {
        let text =
            format!("node {id}: its EMCY codes contradict the value presumed for {object} since its restart");
        cx.emit_note(frame, text);
    }
}

/// A node whose master stopped guarding leaves operational (CiA 301 §7.2.8.3.2.2, object 1029); some
/// errors of a device do so by its manual.
fn apply_emcy_to_nmt(id: NodeId, code: u16, frame: &Frame, cx: &mut Context<'_>) {
    let Some(node) = cx.bus.node(id) else { return };
    let is_life_guard = code == node.device.monitoring.life_guard_emcy.unwrap_or(LIFE_GUARD_ERROR);
    let to = match node.device.error(code) {
        Some(error) => error.nmt.map(NmtName::state),
        None => is_life_guard.then_some(NmtState::PreOperational),
    };
    let operational = node.nmt.is_some_and(|nmt| nmt.state == NmtState::Operational);
    let cause = if is_life_guard { StateCause::LifeGuard } else { StateCause::Emcy };
    if let Some(to) = to.filter(|_| operational) {
        presume_state(id, to, cause, frame, cx);
    }
}

/// What code 0000 says.
fn end_of_error(node: &mut Node, register: Option<u8>) -> EmcyAction {
    let just_booted = std::mem::replace(&mut node.just_booted, false);
    if just_booted && node.active_errors.is_empty() {
        return EmcyAction::NoErrorAtBoot;
    }
    // Which of several errors went the message does not say; the register says whether any is left
    // (CiA 301 §7.2.7.1), unless the device sends 0000 only when all are gone.
    let all_gone =
        node.device.emcy.cleared == Cleared::AllGone || register.is_none_or(|register| register == 0);
    if all_gone {
        node.active_errors.clear();
        EmcyAction::AllCleared
    } else {
        EmcyAction::Cleared
    }
}

/// The order in which the device sends its codes, and what tells it.
///
/// An object that decides and was seen is believed. Where it was not, or may have changed at a restart,
/// the first code that only one order makes a code of the device tells.
fn byte_order(node: &mut Node, data: &[u8]) -> (ByteOrder, &'static str) {
    let Some(order) = &node.device.emcy.byte_order else { return (ByteOrder::LsbFirst, "standard") };
    let Order::ByObject { object, .. } = order else { return (order.of(None), "profile") };
    let known = node.store.get(object.object);
    let value = node.store.number(object.object).and_then(|value| i64::try_from(value).ok());
    let stated = order.of(value);
    if known.is_some_and(|entry| !entry.stale) {
        return (stated, "wire");
    }
    if let Some(LearntOrder(learnt)) = node.emcy_order {
        return (learnt, "learnt");
    }
    let other = opposite(stated);
    let (object, was_known) = (object.object, known.is_some());
    let origin = if was_known { "presumed" } else { "profile" };
    if !is_code(&node.device, data, stated) && is_code(&node.device, data, other) {
        node.emcy_order = Some(LearntOrder(other));
        node.contradicted = was_known.then_some(object);
        return (other, "learnt");
    }
    if is_code(&node.device, data, stated) {
        node.emcy_order = Some(LearntOrder(stated));
    }
    (stated, origin)
}

const fn opposite(order: ByteOrder) -> ByteOrder {
    match order {
        ByteOrder::LsbFirst => ByteOrder::MsbFirst,
        ByteOrder::MsbFirst => ByteOrder::LsbFirst,
    }
}

/// Whether a message holds a code of the device other than 0000, read in this order.
fn is_code(device: &Device, data: &[u8], order: ByteOrder) -> bool {
    match emcy::parse(data, order) {
        Ok(Message::Error { code, .. }) => code != 0 && device.error(code).is_some(),
        _ => false,
    }
}

/// The code the other byte order would give, where the device knows that one and not this.
fn alternative(device: &Device, code: u16) -> Option<u16> {
    let other = code.swap_bytes();
    let only_other = device.error(code).is_none() && device.error(other).is_some() && code != 0;
    only_other.then_some(other)
}
