//! TPDOs against their event timer.

use super::pdo_parameter::{LookedUp, PdoParameter};
use crate::event::{Event, EventKind, Kind, Pdo};
use crate::finding::About;
use crate::rules::rule::{declare_rule, tolerance};
use crate::rules::{BySlot, Context, Need, PdoSubset, Policy, Rule, TransferSubset};

declare_rule! {
    /// # What it checks
    /// The interval of a TPDO exceeds its event timer (18xx:05 written or read) while its node is
    /// operational. Earlier PDOs, triggered by an event, are permitted.
    ///
    /// # Why it matters
    /// Consumers monitor the TPDO with this time and enter their safe state.
    ///
    /// # Source
    /// CiA 301 §7.5.2.37 (event timer)
    ///
    /// # What to look at first
    /// Check the load of the node and of the bus. Check the steps in which the device can set the time.
    ///
    /// # Mutation
    /// drop two PDOs of one with an event timer
    "pdo-event-timer", Warning, "TPDO later than its event timer",
    kinds: [
        Kind::Pdo, Kind::SdoTransfer, Kind::BootUp, Kind::NmtState, Kind::LostFrames, Kind::Link,
        Kind::BusSilent,
    ],
    pdos: PdoSubset::Transmitted,
    transfers: TransferSubset::Communication,
    needs: "a TPDO with a known event timer (18xx:05) above 0",
    cases: &["3.5"],
    shows: &["3.5"],
    is_timing: true,
    word: "PDO",
    tolerances: &[tolerance("warning-percent", 150.0, "%", "of the event timer, plus 10 ms")],
}

/// General tolerance, in nanoseconds.
const SLACK: i64 = 10_000_000;

struct PdoEventTimer {
    percent: i64,
    timer: PdoParameter,
    seen: BySlot<u32>,
}

fn new(policy: &Policy) -> PdoEventTimer {
    #[expect(clippy::cast_possible_truncation, reason = "saturates")]
    let percent = policy.tolerance(&DECLARATION, "warning-percent") as i64;
    PdoEventTimer { percent, timer: PdoParameter::new(5), seen: BySlot::default() }
}

impl PdoEventTimer {
    /// Longest interval in ns with an event timer in ms; `None` if it is switched off.
    fn limit(&self, timer: u64) -> Option<i64> {
        let timer = i64::try_from(timer).ok().filter(|timer| *timer > 0)?;
        Some(timer.saturating_mul(self.percent).saturating_mul(10_000).saturating_add(SLACK))
    }

    #[inline]
    fn pdo(&mut self, event: &Event, pdo: &Pdo, context: &mut Context<'_>) {
        let Some(slot) = context.traffic.current() else { return };
        let Some(timer) = self.timer.of(event, pdo, slot, context) else { return };
        let Some(limit) = self.limit(timer) else { return };
        let Some(seen) = self.seen.of(slot) else { return };
        let is_first = std::mem::replace(seen, self.timer.generation()) != self.timer.generation();
        let Some(interval) = slot.interval().filter(|_| !is_first) else { return };
        if interval <= limit {
            return context.pass();
        }
        let (name, [after, limit]) = (pdo.name, [interval, limit].map(|time| time / 1_000_000));
        #[expect(clippy::cast_precision_loss, reason = "a measure to compare")]
        let measure = interval as f64;
        let alarm = context.fail(event).about(About::Id(pdo.cob_id)).frames(slot.between()).measure(measure);
        alarm.report(|| format!("{name} interval {after} ms > {limit} ms (event timer {timer} ms)"));
    }
}

impl Rule for PdoEventTimer {
    fn wants_pdos(&self) -> bool {
        self.timer.may_be_known()
    }

    fn need(&self, _event: &Event, context: &Context<'_>) -> Need {
        let Some(slot) = context.traffic.current() else { return Need::EACH };
        let limit = match self.timer.looked_up(slot) {
            LookedUp::NotYet => return Need::EACH,
            LookedUp::Unknown => None,
            LookedUp::Value(timer) => self.limit(timer),
        };
        let Some(limit) = limit else { return Need::NOTHING };
        let is_first = self.seen.get(slot.place) != Some(&self.timer.generation());
        if is_first { Need::EACH } else { Need { longest: limit, ..Need::PASSED } }
    }

    #[inline]
    fn event(&mut self, event: &Event, context: &mut Context<'_>) {
        if let EventKind::Pdo(pdo) = &event.kind {
            self.pdo(event, pdo, context);
        } else if self.timer.changes(event) {
            context.ask_again();
        }
    }
}
