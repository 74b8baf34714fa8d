//! Error history (1003) against the EMCY messages of a node.

use crate::event::{Direction, EmcyAction, Event, EventKind};
use crate::finding::About;
use crate::rules::general::facts::number;
use crate::rules::rule::declare_rule;
use crate::rules::{Context, NodeMap, Policy, Rule};
use crate::wire::canopen::ObjectAddress;

declare_rule! {
    /// # What it checks
    /// The newest entry of the error history (1003:01) must contain the code of the last EMCY with an error.
    /// Both byte orders are accepted.
    ///
    /// # Why it matters
    /// Service tools read the error history when no capture of the bus exists.
    ///
    /// # Source
    /// CiA 301 §7.5.2.4 (1003: the newest at sub-index 1)
    ///
    /// # What to look at first
    /// Check whether the device stores the newest error in 1003:01. An EMCY may also have been inhibited
    /// (1015).
    ///
    /// # Mutation
    /// change the value in the response to an upload of 1003:01
    "emcy-history", Note, "error history without the last EMCY",
    kinds: ["emcy", "sdo-transfer", "boot-up"],
    needs: "an EMCY with an error, then a read of 1003:01",
    cases: &["5.3", "5.6"],
    shows: &["5.6"],
    word: "EMCY",
}

#[derive(Default)]
struct EmcyHistory {
    /// Code and frame of the last EMCY with an error.
    last: NodeMap<(u16, u64)>,
}

fn new(_policy: &Policy) -> EmcyHistory {
    EmcyHistory::default()
}

impl Rule for EmcyHistory {
    fn event(&mut self, event: &Event, context: &mut Context<'_>) {
        let Some(node) = event.node else { return };
        match &event.kind {
            EventKind::Emcy(emergency) => {
                let code = emergency.code.filter(|_| emergency.action == EmcyAction::Raised);
                if let Some((last, code)) = self.last.entry(node).zip(code) {
                    *last = (code, event.frames.last);
                }
            }
            EventKind::BootUp { .. } => {
                self.last.remove(node);
            }
            EventKind::SdoTransfer(transfer) => {
                let (Some(object), Some(value)) = (transfer.object, number(transfer)) else { return };
                match (object.index, object.sub, transfer.direction) {
                    (0x1003, 0, Some(Direction::Download)) => {
                        self.last.remove(node);
                    }
                    (0x1003, 1, Some(Direction::Upload)) => {
                        let Some((code, frame)) = self.last.get(node).copied().filter(|(code, _)| *code != 0)
                        else {
                            return;
                        };
                        let read = u16::try_from(value & 0xFFFF).unwrap_or(0);
                        if read == code || read == code.swap_bytes() {
                            return context.pass();
                        }
                        let alarm = context.fail(event).about(About::Object(ObjectAddress::new(0x1003, 1)));
                        alarm.report(|| {
                            format!(
                                "newest entry {read:04X} differs from the last EMCY {code:04X} {{{frame}}}"
                            )
                        });
                    }
                    _ => {}
                }
            }
            _ => {}
        }
    }
}
