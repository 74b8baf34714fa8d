//! TPDOs of transmission type 0 (acyclic synchronous).

use super::pdo_parameter::{LookedUp, PdoParameter};
use crate::event::{Event, EventKind, Kind};
use crate::finding::About;
use crate::rules::rule::declare_rule;
use crate::rules::{Context, Need, PdoSubset, Policy, Rule, TransferSubset};

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

fn new(_policy: &Policy) -> PdoSyncAcyclic {
    PdoSyncAcyclic { kind: PdoParameter::new(2) }
}

impl Rule for PdoSyncAcyclic {
    fn wants_pdos(&self) -> bool {
        self.kind.may_be_known()
    }

    fn need(&self, _event: &Event, context: &Context<'_>) -> Need {
        match context.traffic.current().map(|slot| self.kind.looked_up(slot)) {
            None | Some(LookedUp::NotYet | LookedUp::Value(0)) => Need::EACH,
            Some(LookedUp::Unknown | LookedUp::Value(_)) => Need::NOTHING,
        }
    }

    #[inline]
    fn event(&mut self, event: &Event, context: &mut Context<'_>) {
        match &event.kind {
            EventKind::Pdo(pdo) => {
                let Some(slot) = context.traffic.current() else { return };
                if self.kind.of(event, pdo, slot, context) != Some(0) {
                    return;
                }
                let count = slot.since_sync;
                if count < 3 {
                    return context.pass();
                }
                let name = pdo.name;
                let alarm = context.fail(event).about(About::Id(pdo.cob_id)).measure(f64::from(count));
                alarm.report(|| {
                    format!("{count} {name} in one SYNC interval (max 1 with transmission type 0)")
                });
            }
            _ => {
                if self.kind.changes(event) {
                    context.ask_again();
                }
            }
        }
    }
}
