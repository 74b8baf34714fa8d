//! TPDOs of transmission type 0 (acyclic synchronous).

use super::pdo_parameter::{LookedUp, PdoParameter};
use crate::event::{Event, EventKind, Kind};
use crate::finding::FindingSubject;
use crate::rules::rule::declare_rule;
use crate::rules::{FrameNeed, PdoSubset, Rule, RuleContext, RulePolicy, TransferSubset};

declare_rule! {
    /// # What it checks
    /// A TPDO of transmission type 0 (18xx:02 written or read) is sent three times between two SYNCs. It may
    /// be sent once after a SYNC, or not at all.
    ///
    /// # Why it matters
    /// The values were not sampled at the SYNC, unlike those of other TPDOs.
    ///
    /// # Source
    /// CiA 301 §7.2.2.2, §7.5.2.37 (transmission type 0)
    ///
    /// # What to look at first
    /// Check whether the transmission type needs a restart to take effect.
    ///
    /// # Mutation
    /// duplicate PDOs of an acyclic TPDO
    "pdo-sync-acyclic", Warning, "acyclic TPDO without a SYNC",
    kinds: [
        Kind::Pdo, Kind::SdoTransfer, Kind::BootUp, Kind::NmtState, Kind::LostFrames, Kind::Link,
        Kind::BusSilent,
    ],
    pdos: PdoSubset::Transmitted,
    transfers: TransferSubset::Communication,
    needs: "SYNC, and a TPDO with 18xx:02 = 0",
    cases: &["3.7"],
    shows: &["3.7"],
    word: "SYNC",
}

struct PdoSyncAcyclic {
    kind: PdoParameter,
}

fn new(_policy: &RulePolicy) -> PdoSyncAcyclic {
    PdoSyncAcyclic { kind: PdoParameter::new(2) }
}

impl Rule for PdoSyncAcyclic {
    fn wants_pdos(&self) -> bool {
        self.kind.may_be_known()
    }

    fn frame_need(&self, _event: &Event, context: &RuleContext<'_>) -> FrameNeed {
        match context.traffic.current_slot().map(|slot| self.kind.looked_up(slot)) {
            None | Some(LookedUp::NotYet | LookedUp::Value(0)) => FrameNeed::EACH,
            Some(LookedUp::Unknown | LookedUp::Value(_)) => FrameNeed::NOTHING,
        }
    }

    #[inline]
    fn on_event(&mut self, event: &Event, context: &mut RuleContext<'_>) {
        match &event.kind {
            EventKind::Pdo(pdo) => {
                let Some(slot) = context.traffic.current_slot() else { return };
                if self.kind.value_for(event, pdo, slot, context) != Some(0) {
                    return;
                }
                let count = slot.since_sync;
                if count < 3 {
                    return context.count_pass();
                }
                let name = pdo.name;
                let alarm = context
                    .start_finding(event)
                    .with_subject(FindingSubject::Id(pdo.cob_id))
                    .with_measure(f64::from(count));
                alarm.report_finding(|| {
                    format!("{count} {name} in one SYNC interval (max 1 with transmission type 0)")
                });
            }
            _ => {
                if self.kind.on_event(event) {
                    context.ask_again();
                }
            }
        }
    }
}
