//! Missing EMCY after a short RPDO.

use crate::event::{DecodedPdo, Event, EventKind, FrameRange, Kind};
use crate::finding::FindingSubject;
use crate::rules::general::facts::mapped_bytes;
use crate::rules::rule::{declare_rule, define_tolerance};
use crate::rules::{FrameNeed, PdoSubset, Rule, RuleContext, RulePolicy};
use crate::wire::canopen::NmtState;
use crate::wire::{NodeId, NodeMap};

declare_rule! {
    /// # What it checks
    /// An operational node must report 8210 within `error-ms` after an RPDO that is shorter than its mapping.
    /// No further EMCY is required while 8210 is active.
    ///
    /// # Why it matters
    /// Without the EMCY, lost set points remain unnoticed.
    ///
    /// # Source
    /// CiA 301 §7.2.2.3, table 26 (8210)
    ///
    /// # What to look at first
    /// Check whether the device supports EMCY (1014). Check whether 8210 is active since an earlier PDO.
    ///
    /// # Mutation
    /// cut the last byte of an RPDO
    "emcy-missing", Note, "missing EMCY after a short RPDO",
    kinds: [Kind::Pdo, Kind::Emcy, Kind::BootUp],
    pdos: PdoSubset::Received,
    needs: "an RPDO shorter than its mapping, to an operational node",
    cases: &["5.4", "7.6", "7.106", "7.107"],
    is_on: false,
    word: "EMCY",
    tolerances: &[define_tolerance("error-ms", 1_000.0, "ms", "from the PDO to the EMCY")],
}

/// PDO not processed due to length error (CiA 301 table 26).
const LENGTH_ERROR: u16 = 0x8210;

#[derive(Clone, Copy, Default)]
struct RegisterWatch {
    /// Frame of the PDO, and end of the waiting time.
    waiting: Option<(u64, i64)>,
    is_reported: bool,
}

struct EmcyMissing {
    limit: i64,
    watches: NodeMap<RegisterWatch>,
}

fn new(policy: &RulePolicy) -> EmcyMissing {
    EmcyMissing { limit: policy.tolerance_ns(&DECLARATION, "error-ms"), watches: NodeMap::default() }
}

impl EmcyMissing {
    #[cold]
    fn on_short_emcy(&mut self, event: &Event, node: NodeId, context: &mut RuleContext<'_>) {
        let is_operational = context.confirmed_state(node) == Some(NmtState::Operational);
        let Some(watch) = self.watches.entry(node) else { return };
        if is_operational && !watch.is_reported && watch.waiting.is_none() {
            let due = context.now.saturating_add(self.limit);
            watch.waiting = Some((event.frames.last, due));
            context.wake_at(due, node.table_place() as u64);
        }
    }
}

fn is_short(pdo: &DecodedPdo) -> bool {
    mapped_bytes(pdo).is_some_and(|bytes| u16::from(pdo.length) < bytes)
}

impl Rule for EmcyMissing {
    fn frame_need(&self, event: &Event, _context: &RuleContext<'_>) -> FrameNeed {
        match &event.kind {
            EventKind::Pdo(pdo) if !is_short(pdo) => FrameNeed::NOTHING,
            _ => FrameNeed::EACH,
        }
    }

    fn on_event(&mut self, event: &Event, context: &mut RuleContext<'_>) {
        let Some(node) = event.node else { return };
        match &event.kind {
            EventKind::Pdo(pdo) if is_short(pdo) => self.on_short_emcy(event, node, context),
            EventKind::Emcy(emergency) => {
                let Some(watch) = self.watches.entry(node) else { return };
                let is_it = emergency.code == Some(LENGTH_ERROR);
                watch.is_reported = is_it || watch.is_reported && emergency.code != Some(0);
                if is_it && watch.waiting.take().is_some() {
                    context.count_pass();
                }
            }
            EventKind::BootUp { .. } => {
                self.watches.remove(node);
            }
            _ => {}
        }
    }

    fn on_wake(&mut self, token: u64, context: &mut RuleContext<'_>) {
        let Some(node) = NodeId::all_ids().find(|node| node.table_place() as u64 == token) else { return };
        let Some(watch) = self.watches.get_mut(node) else { return };
        let Some((frame, due)) = watch.waiting.take_if(|(_, due)| *due <= context.now) else { return };
        let limit = self.limit / 1_000_000;
        let alarm = context
            .fail_at(due, Some(node), FrameRange::one(frame))
            .with_subject(FindingSubject::Code(LENGTH_ERROR));
        alarm.report_finding(|| format!("no EMCY 8210 within {limit} ms after the short RPDO {{{frame}}}"));
    }
}
