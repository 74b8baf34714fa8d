//! TPDOs of transmission types 1 to 240 (cyclic synchronous).

use super::pdo_parameter::{LookedUp, PdoParameter};
use crate::event::{Event, EventKind, Kind, Pdo};
use crate::finding::About;
use crate::frame::CanId;
use crate::rules::general::facts::identifier;
use crate::rules::rule::declare_rule;
use crate::rules::{BySlot, Context, Need, PdoSlot, PdoSubset, Policy, Rule, TransferSubset};
use crate::session::Bus;
use crate::wire::canopen::ObjectAddress;

declare_rule! {
    /// # What it checks
    /// A TPDO of transmission type n, 1 to 240 (18xx:02 written or read), must be sent once per n SYNCs,
    /// counted over 20 TPDOs. Buses with several SYNC identifiers are exempt.
    ///
    /// # Why it matters
    /// Set points and actual values no longer belong to the same cycle, and controllers miss samples.
    ///
    /// # Source
    /// CiA 301 §7.2.2.2, §7.5.2.37 (transmission type)
    ///
    /// # What to look at first
    /// Check whether the cycle (1006) is too short for the node. Check the load of the bus.
    ///
    /// # Mutation
    /// drop every third PDO of a synchronous TPDO
    "pdo-sync-cyclic", Warning, "synchronous TPDO out of step with SYNC",
    kinds: [
        Kind::Pdo, Kind::SdoTransfer, Kind::BootUp, Kind::NmtState, Kind::LostFrames, Kind::Link,
        Kind::BusSilent,
    ],
    pdos: PdoSubset::Transmitted,
    transfers: TransferSubset::Communication,
    needs: "SYNC, and 20 TPDOs with 18xx:02 = 1 to 240",
    cases: &["3.6", "3.8", "6.3"],
    shows: &["3.6", "6.3"],
    word: "SYNC",
}

/// Number of TPDOs per check.
const COUNT: u64 = 20;

/// Number of SYNCs at the start of the check, and number of TPDOs since.
#[derive(Clone, Copy, Default)]
struct Watch {
    generation: u32,
    from: u64,
    count: u64,
}

struct PdoSyncCyclic {
    kind: PdoParameter,
    watches: BySlot<Watch>,
}

fn new(_policy: &Policy) -> PdoSyncCyclic {
    PdoSyncCyclic { kind: PdoParameter::new(2), watches: BySlot::default() }
}

impl PdoSyncCyclic {
    #[inline]
    fn pdo(&mut self, event: &Event, pdo: &Pdo, context: &mut Context<'_>) {
        let Some(slot) = context.traffic.current() else { return };
        let Some(kind @ 1..=240) = self.kind.of(event, pdo, slot, context) else { return };
        let syncs = context.traffic.syncs();
        let generation = self.kind.generation();
        let Some(watch) = self.watches.of(slot) else { return };
        if watch.generation != generation {
            *watch = Watch { generation, from: syncs, count: 0 };
            return;
        }
        watch.count += 1;
        if watch.count < COUNT {
            return;
        }
        let elapsed = syncs.saturating_sub(watch.from);
        *watch = Watch { generation, from: syncs, count: 0 };
        context.ask_again();
        // A TPDO may be one SYNC late.
        if elapsed.abs_diff(COUNT * kind) <= 1 {
            return context.pass();
        }
        if has_several_syncs(context.bus) {
            return;
        }
        let name = pdo.name;
        let alarm = context.fail(event).about(About::Id(pdo.cob_id));
        alarm.report(|| {
            let expected = COUNT * kind;
            format!("{COUNT} {name} in {elapsed} SYNCs (expected {expected}, transmission type {kind})")
        });
    }
}

/// Whether a node may use another SYNC identifier than 080.
pub(super) fn has_several_syncs(bus: &Bus) -> bool {
    const SYNC: ObjectAddress = ObjectAddress::new(0x1005, 0);
    bus.nodes().any(|node| {
        let default = || {
            let entry = node.device().dictionary.find(SYNC)?.entry?;
            u64::try_from(entry.default_number(Some(node.id().number()))?).ok()
        };
        let cob_id = node.store().number(SYNC).or_else(default);
        cob_id.is_some_and(|cob_id| identifier(cob_id & !(3 << 30)) != Some(CanId::standard(0x80)))
    })
}

impl Rule for PdoSyncCyclic {
    fn wants_pdos(&self) -> bool {
        self.kind.may_be_known()
    }

    fn need(&self, _event: &Event, context: &Context<'_>) -> Need {
        let Some(slot) = context.traffic.current() else { return Need::EACH };
        match (self.kind.looked_up(slot), self.watches.get(slot.place)) {
            (LookedUp::Value(1..=240), Some(watch)) if watch.generation == self.kind.generation() => {
                let frames = u32::try_from(COUNT.saturating_sub(watch.count)).unwrap_or(0);
                Need { frames, ..Need::NOTHING }.counted()
            }
            (LookedUp::NotYet | LookedUp::Value(1..=240), _) => Need::EACH,
            (LookedUp::Unknown | LookedUp::Value(_), _) => Need::NOTHING,
        }
    }

    fn skipped(&mut self, slot: &PdoSlot, count: u32, _context: &mut Context<'_>) {
        if let Some(watch) = self.watches.of(slot) {
            watch.count = watch.count.saturating_add(u64::from(count));
        }
    }

    #[inline]
    fn event(&mut self, event: &Event, context: &mut Context<'_>) {
        if let EventKind::Pdo(pdo) = &event.kind {
            self.pdo(event, pdo, context);
        } else if self.kind.changes(event) {
            context.ask_again();
        }
    }
}
