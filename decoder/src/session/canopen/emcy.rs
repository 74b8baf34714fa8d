//! EMCY: errors that come and go.

use crate::event::{EmcyAction, Emergency, EventKind, StateCause};
use crate::frame::Frame;
use crate::session::{Bus, Observer};
use crate::wire::canopen::NmtState;
use crate::wire::canopen::emcy::{self, ByteOrder, Emcy};

/// Life guard or heartbeat error: by default (object 1029) the device falls back to pre-operational.
const LIFE_GUARD_ERROR: u16 = 0x8130;

impl Bus {
    pub(in crate::session) fn on_emcy(&mut self, id: u8, frame: &Frame, out: &mut dyn Observer) {
        self.belief.saw_unsupported(id, self.clock.now());
        if !self.is_decoded(frame, out) {
            return;
        }
        let byte_order = ByteOrder::LsbFirst;
        let message = match emcy::parse(frame.data(), byte_order) {
            Ok(message) => message,
            Err(error) => return self.malformed(frame, id, error, "an error code has two bytes", out),
        };
        self.heard(id, frame, out);
        let Some(node) = self.node_mut(id) else { return };
        let just_booted = std::mem::replace(&mut node.just_booted, false);
        let mut fits = true;
        let (code, register, vendor, vendor_length, action) = match message {
            Emcy::Ready => (None, None, [0; 5], 0, EmcyAction::Ready),
            Emcy::Error { code, register, vendor, vendor_length } => {
                let action = if code != 0 {
                    fits = node.raise(code);
                    EmcyAction::Raised
                } else if just_booted && node.active_errors.is_empty() {
                    EmcyAction::NoErrorAtBoot
                } else {
                    // Which of several errors went the message does not say; the register says whether
                    // any is left (CiA 301 §7.2.7.1).
                    let left = register.is_some_and(|register| register != 0);
                    if !left {
                        node.active_errors.clear();
                    }
                    if left { EmcyAction::Cleared } else { EmcyAction::AllCleared }
                };
                (Some(code), register, vendor, vendor_length, action)
            }
        };
        let active = u16::try_from(node.active_errors.len()).unwrap_or(u16::MAX);
        let emergency = Emergency { code, register, vendor, vendor_length, action, active, byte_order };
        self.emit(frame, id, false, EventKind::Emcy(emergency), out);
        if !fits {
            self.emit(frame, id, false, EventKind::Evicted { what: "active error", count: 1 }, out);
        }
        if code == Some(LIFE_GUARD_ERROR) {
            self.fall_back(id, frame, out);
        }
    }

    /// A communication error takes an operational node to pre-operational, presumably.
    fn fall_back(&mut self, id: u8, frame: &Frame, out: &mut dyn Observer) {
        let operational =
            self.node(id).and_then(|node| node.nmt).is_some_and(|nmt| nmt.state == NmtState::Operational);
        if operational {
            self.presume_state(id, NmtState::PreOperational, StateCause::LifeGuard, frame, out);
        }
    }
}
