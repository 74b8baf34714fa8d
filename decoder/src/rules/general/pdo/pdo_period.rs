//! Period of a TPDO, and its silence.

use super::pdo_sync_cyclic::has_several_syncs;
use crate::profile::PdoName;
use crate::rules::general::facts::confirmed_number;
use crate::rules::{PdoSlot, RuleContext};
use crate::wire::NodeId;
use crate::wire::canopen::NmtState;

/// Minimum number of PDOs before a configured period applies.
const SEEN: u64 = 3;

/// Number of consecutive PDOs that are missing before a PDO counts as lost.
pub(super) const MISSING: u64 = 3;

/// Source of a period.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum PeriodSource {
    /// Event timer (18xx:05), in ns.
    Timer(i64),
    /// Usual interval of unchanged PDOs, in ns.
    Usual(i64),
    /// Transmission type 1 to 240: number of SYNCs.
    Syncs(u64),
}

impl PeriodSource {
    /// Time without a PDO after which it is lost, in ns; for a number of SYNCs only the minimum.
    pub(super) fn loss_limit(self, times: f64, least: i64) -> i64 {
        let (Self::Timer(time) | Self::Usual(time)) = self else { return least };
        #[expect(clippy::cast_possible_truncation, clippy::cast_precision_loss, reason = "a time to compare")]
        let limit = (time as f64 * times) as i64;
        limit.max(least)
    }

    /// Period of a TPDO with observed PDOs; `None` for one that is sent on change, on request or with type 0
    /// (CiA 301 §7.2.2.2, §7.5.2.37).
    #[cold]
    pub(super) fn period_of(
        (name, node): (PdoName, NodeId),
        slot: &PdoSlot,
        changed: i64,
        context: &RuleContext<'_>,
    ) -> Option<Self> {
        if slot.is_requested || slot.count < SEEN {
            return None;
        }
        let node = context.bus.node(node)?;
        let parameter = |sub| confirmed_number(node, name.communication_index(), sub);
        match parameter(2) {
            Some(syncs @ 1..=240) => {
                let fits = slot.sync_step == syncs && !has_several_syncs(context.bus);
                return fits.then_some(Self::Syncs(syncs));
            }
            Some(0 | 241..=253) => return None,
            _ => {}
        }
        let timer = parameter(5).and_then(|timer| i64::try_from(timer).ok()).filter(|timer| *timer > 0);
        match timer.map(|timer| timer.saturating_mul(1_000_000)) {
            Some(timer) => {
                let fits = slot.interval().is_some_and(|interval| interval <= timer.saturating_mul(2));
                fits.then_some(Self::Timer(timer))
            }
            None => slot.period_since(changed).map(Self::Usual),
        }
    }
}

/// Silence of a TPDO that is due, in ns. `None` before the limit, and if another reason than the node is
/// possible: its SYNC or the RPDOs that it answers ended with it.
pub(super) fn tpdo_silence(
    period: PeriodSource,
    node: NodeId,
    slot: &PdoSlot,
    limit: i64,
    context: &RuleContext<'_>,
) -> Option<i64> {
    let entered = context.bus.node(node)?.nmt().map_or(i64::MIN, |nmt| nmt.changed_at());
    // The clock of rules excludes the silences of the bus.
    let since = slot.last.max(entered.saturating_sub(context.silence));
    let silence = context.now.saturating_sub(since);
    match period {
        PeriodSource::Syncs(syncs) => {
            // The TPDO of the last SYNC may still follow.
            let is_due = context.traffic.syncs_since(slot) > MISSING * syncs && since == slot.last;
            is_due.then_some(silence)
        }
        PeriodSource::Timer(_) => (silence >= limit).then_some(silence),
        PeriodSource::Usual(_) => {
            (silence >= limit && !ended_with_trigger(node, slot, context)).then_some(silence)
        }
    }
}

/// Whether SYNC, or all RPDOs to the node, ended before the next TPDO was due.
fn ended_with_trigger(node: NodeId, slot: &PdoSlot, context: &RuleContext<'_>) -> bool {
    let traffic = context.traffic;
    let by_sync = slot.since_sync == 1 && traffic.sync_count() > SEEN && traffic.syncs_since(slot) == 0;
    let received = traffic.slots().iter().filter(|other| {
        let pdo = context.bus.identifiers().pdo_on(other.id);
        other.count > SEEN && pdo.is_some_and(|(name, of)| of == node && !name.is_sent())
    });
    by_sync || received.map(|other| other.last).max().is_some_and(|last| last <= slot.last)
}

/// Whether the silence of a TPDO is the only loss: its node is operational and not lost.
pub(super) fn is_operational(node: NodeId, context: &RuleContext<'_>) -> bool {
    let node = context.bus.node(node);
    node.is_some_and(|node| {
        !node.is_lost() && node.nmt().is_some_and(|nmt| nmt.state == NmtState::Operational)
    })
}
