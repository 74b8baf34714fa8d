//! TPDOs of transmission types 1 to 240 (cyclic synchronous).

use super::pdo_parameter::{LookedUp, PdoParameter};
use crate::event::{DecodedPdo, Event, EventKind, Kind};
use crate::finding::FindingSubject;
use crate::frame::CanId;
use crate::rules::general::facts::cob_identifier;
use crate::rules::rule::declare_rule;
use crate::rules::{BySlot, FrameNeed, PdoSlot, PdoSubset, Rule, RuleContext, RulePolicy, TransferSubset};
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
struct SyncWatch {
    generation: u32,
    from: u64,
    count: u64,
}

struct PdoSyncCyclic {
    kind: PdoParameter,
    watches: BySlot<SyncWatch>,
}

fn new(_policy: &RulePolicy) -> PdoSyncCyclic {
    PdoSyncCyclic { kind: PdoParameter::new(2), watches: BySlot::default() }
}

impl PdoSyncCyclic {
    #[inline]
    fn on_pdo(&mut self, event: &Event, pdo: &DecodedPdo, context: &mut RuleContext<'_>) {
        let Some(slot) = context.traffic.current_slot() else { return };
        let Some(kind @ 1..=240) = self.kind.value_for(event, pdo, slot, context) else { return };
        let syncs = context.traffic.sync_count();
        let generation = self.kind.generation();
        let Some(watch) = self.watches.entry_of(slot) else { return };
        if watch.generation != generation {
            *watch = SyncWatch { generation, from: syncs, count: 0 };
            return;
        }
        watch.count += 1;
        if watch.count < COUNT {
            return;
        }
        let elapsed = syncs.saturating_sub(watch.from);
        *watch = SyncWatch { generation, from: syncs, count: 0 };
        context.ask_again();
        // A TPDO may be one SYNC late.
        if elapsed.abs_diff(COUNT * kind) <= 1 {
            return context.count_pass();
        }
        if has_several_syncs(context.bus) {
            return;
        }
        let name = pdo.name;
        let alarm = context.start_finding(event).with_subject(FindingSubject::Id(pdo.cob_id));
        alarm.report_finding(|| {
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
            let entry = node.device().dictionary.find_object(SYNC)?.entry?;
            u64::try_from(entry.default_number(Some(node.id().number()))?).ok()
        };
        let cob_id = node.store().number(SYNC).or_else(default);
        cob_id.is_some_and(|cob_id| cob_identifier(cob_id & !(3 << 30)) != Some(CanId::from_standard(0x80)))
    })
}

impl Rule for PdoSyncCyclic {
    fn wants_pdos(&self) -> bool {
        self.kind.may_be_known()
    }

    fn frame_need(&self, _event: &Event, context: &RuleContext<'_>) -> FrameNeed {
        let Some(slot) = context.traffic.current_slot() else { return FrameNeed::EACH };
        match (self.kind.looked_up(slot), self.watches.get(slot.place)) {
            (LookedUp::Value(1..=240), Some(watch)) if watch.generation == self.kind.generation() => {
                let frames = u32::try_from(COUNT.saturating_sub(watch.count)).unwrap_or(0);
                FrameNeed { frames, ..FrameNeed::NOTHING }.with_count()
            }
            (LookedUp::NotYet | LookedUp::Value(1..=240), _) => FrameNeed::EACH,
            (LookedUp::Unknown | LookedUp::Value(_), _) => FrameNeed::NOTHING,
        }
    }

    fn on_skipped(&mut self, slot: &PdoSlot, count: u32, _context: &mut RuleContext<'_>) {
        if let Some(watch) = self.watches.entry_of(slot) {
            watch.count = watch.count.saturating_add(u64::from(count));
        }
    }

    #[inline]
    fn on_event(&mut self, event: &Event, context: &mut RuleContext<'_>) {
        if let EventKind::Pdo(pdo) = &event.kind {
            self.on_pdo(event, pdo, context);
        } else if self.kind.on_event(event) {
            context.ask_again();
        }
    }
}
