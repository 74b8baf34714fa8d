//! Error history (1003) against the EMCY messages of a node.

use std::collections::VecDeque;

use crate::event::{EmcyAction, Emergency, Event, EventKind, Kind, SdoDirection};
use crate::finding::FindingSubject;
use crate::profile::device::ClearMeaning;
use crate::rules::general::facts::transfer_number;
use crate::rules::rule::declare_rule;
use crate::rules::{Rule, RuleContext, RulePolicy, TransferSubset};
use crate::wire::canopen::ObjectAddress;
use crate::wire::{NodeId, NodeMap};

/// Error history.
const HISTORY: u16 = 0x1003;

declare_rule! {
    /// # What it checks
    /// The newest entry of the error history (1003:01) must contain the code of the last EMCY with an error, and
    /// each further entry that of the EMCY before. Both byte orders are accepted. Further entries are judged
    /// since the last EMCY 0000, and only while no code was sent twice. If the device does not report the end of
    /// each error, ended errors may be missing.
    ///
    /// # Why it matters
    /// Service tools read the error history when no capture of the bus exists.
    ///
    /// # Source
    /// CiA 301 §7.5.2.4 (1003: the newest at sub-index 1)
    ///
    /// # What to look at first
    /// Check whether the device enters each error, the newest in 1003:01. An EMCY may also have been inhibited
    /// (1015).
    ///
    /// # Mutation
    /// change the value in the response to an upload of 1003:01
    "emcy-history", Note, "error history differs from the EMCY sent",
    kinds: [Kind::Emcy, Kind::SdoTransfer, Kind::BootUp],
    transfers: TransferSubset::Communication,
    needs: "an EMCY with an error, then a read of 1003:01",
    cases: &["5.3", "5.6"],
    shows: &["5.6"],
    word: "EMCY",
}

/// Maximum number of entries in 1003 (CiA 301 §7.5.2.4).
const ENTRY_LIMIT: usize = 254;

/// Errors that a node reported.
#[derive(Default)]
struct ReportedErrors {
    /// Code and frame of the EMCY with an error, newest first.
    errors: VecDeque<(u16, u64)>,
    /// Number of errors since the last EMCY 0000.
    fresh: usize,
    /// A code was sent twice since the last EMCY 0000; the device may have entered it once.
    is_ambiguous: bool,
    /// No earlier error can be in the history: since a boot, or since the history was cleared.
    is_complete: bool,
}

#[derive(Default)]
struct EmcyHistory {
    nodes: NodeMap<ReportedErrors>,
}

fn new(_policy: &RulePolicy) -> EmcyHistory {
    EmcyHistory::default()
}

impl ReportedErrors {
    fn cleared_errors() -> Self {
        Self { is_complete: true, ..Self::default() }
    }

    fn add_error(&mut self, emergency: &Emergency, frame: u64) {
        let Some(code) = emergency.code.filter(|_| emergency.action == EmcyAction::Raised) else {
            (self.fresh, self.is_ambiguous) = (0, false);
            return;
        };
        self.is_ambiguous |= self.errors.iter().take(self.fresh).any(|(known, _)| *known == code);
        self.errors.push_front((code, frame));
        self.errors.truncate(ENTRY_LIMIT);
        self.fresh = (self.fresh + 1).min(ENTRY_LIMIT);
    }

    /// Error that belongs into entry `sub`, and whether the code that was read fits; `None` without a verdict.
    fn judge_entry(&self, sub: u8, read: u16, reports_end: bool) -> Option<(u16, u64, bool)> {
        let is_code = |code: u16| read == code || read == code.swap_bytes();
        let place = usize::from(sub).checked_sub(1)?;
        let (code, frame) = self.errors.get(place).copied().filter(|(code, _)| *code != 0)?;
        if place == 0 || is_code(code) {
            return Some((code, frame, is_code(code)));
        }
        if place >= self.fresh || self.is_ambiguous {
            return None;
        }
        if reports_end {
            return Some((code, frame, false));
        }
        // An error that ended without notice has left the history.
        let mut older = self.errors.iter().take(self.fresh).skip(place);
        let may_be = read == 0 || !self.is_complete || older.any(|(code, _)| is_code(*code));
        (!may_be).then_some((code, frame, false))
    }
}

impl EmcyHistory {
    fn on_read(&self, event: &Event, node: NodeId, (sub, value): (u8, u64), context: &mut RuleContext<'_>) {
        let reports_end =
            context.event_node(event).is_none_or(|node| node.device().emcy.cleared == ClearMeaning::Each);
        let read = u16::try_from(value & 0xFFFF).unwrap_or(0);
        let reported = self.nodes.get(node);
        let Some((code, frame, is_right)) = reported.and_then(|it| it.judge_entry(sub, read, reports_end))
        else {
            return;
        };
        if is_right {
            return context.count_pass();
        }
        let alarm = context
            .start_finding(event)
            .with_subject(FindingSubject::Object(ObjectAddress::new(HISTORY, sub)));
        alarm.report_finding(|| match sub {
            1 => format!("newest entry {read:04X} differs from the last EMCY {code:04X} {{{frame}}}"),
            _ => format!("entry {sub} is {read:04X}, but EMCY {code:04X} {{{frame}}} was sent"),
        });
    }
}

impl Rule for EmcyHistory {
    fn on_event(&mut self, event: &Event, context: &mut RuleContext<'_>) {
        let Some(node) = event.node else { return };
        match &event.kind {
            EventKind::Emcy(emergency) => {
                let Some(reported) = self.nodes.entry(node) else { return };
                if emergency.boot.is_some() {
                    *reported = ReportedErrors::cleared_errors();
                }
                reported.add_error(emergency, event.frames.last);
            }
            EventKind::BootUp { .. } => {
                if let Some(reported) = self.nodes.entry(node) {
                    *reported = ReportedErrors::cleared_errors();
                }
            }
            EventKind::SdoTransfer(transfer) => {
                let (Some(object), Some(value)) = (transfer.object, transfer_number(transfer)) else {
                    return;
                };
                match (object.index, object.sub, transfer.direction) {
                    (HISTORY, 0, Some(SdoDirection::Download)) => {
                        if let Some(reported) = self.nodes.entry(node) {
                            *reported = ReportedErrors::cleared_errors();
                        }
                    }
                    (HISTORY, sub @ 1.., Some(SdoDirection::Upload)) => {
                        self.on_read(event, node, (sub, value), context);
                    }
                    _ => {}
                }
            }
            _ => {}
        }
    }
}
