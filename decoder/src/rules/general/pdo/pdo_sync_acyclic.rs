//! Acyclic synchronous TPDOs.

use super::pdo_parameter::PdoParameter;
use crate::event::{Event, EventKind};
use crate::finding::About;
use crate::rules::rule::declare_rule;
use crate::rules::{Context, Policy, Rule};

declare_rule! {
    /// # What it checks
    /// A TPDO of transmission type 0 (18xx:02 written or read) comes only behind a SYNC, once: not three times between
    /// two SYNCs. That it does not come is right, too.
    ///
    /// # Why it matters
    /// Values are not those of the moment of the SYNC that the others are of.
    ///
    /// # Source
    /// CiA 301 §7.2.2.2, §7.5.2.37 (transmission type 0)
    ///
    /// # What to look at first
    /// Whether the device takes the type at once, or keeps its old one until a restart.
    ///
    /// # Mutation
    /// duplicate PDOs of an acyclic TPDO
    "pdo-sync-acyclic", Warning, "an acyclic TPDO comes without a SYNC",
    kinds: ["tpdo", "sdo-transfer", "boot-up", "nmt-state", "lost-frames", "link"],
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
                alarm.say(|| format!("{name} came {count} times since the last SYNC; its type is 0"));
            }
            _ => {
                self.kind.changes(event);
            }
        }
    }
}
