//! TPDOs against their inhibit time.

use super::pdo_parameter::{LookedUp, PdoParameter};
use crate::event::{Event, EventKind, Kind, Pdo};
use crate::finding::About;
use crate::rules::rule::{declare_rule, tolerance};
use crate::rules::{BySlot, Context, Need, PdoSubset, Policy, Rule, TransferSubset};

declare_rule! {
    /// # What it checks
    /// Three consecutive intervals of a TPDO of transmission type 254 or 255 are shorter than its inhibit
    /// time (18xx:02 and 18xx:03 written or read). Single short intervals are exempt, because they follow a
    /// delayed PDO.
    ///
    /// # Why it matters
    /// A fluctuating value occupies the bus and delays all identifiers of lower priority.
    ///
    /// # Source
    /// CiA 301 §7.2.2.2, §7.5.2.37 (inhibit time, in steps of 100 µs)
    ///
    /// # What to look at first
    /// Set the inhibit time while the PDO is invalid (bit 31). Some devices ignore it while the PDO is valid.
    ///
    /// # Mutation
    /// insert further PDOs on an identifier with an inhibit time
    "pdo-inhibit-time", Warning, "TPDO earlier than its inhibit time",
    kinds: [
        Kind::Pdo, Kind::SdoTransfer, Kind::BootUp, Kind::NmtState, Kind::LostFrames, Kind::Link,
        Kind::BusSilent,
    ],
    pdos: PdoSubset::Transmitted,
    transfers: TransferSubset::Communication,
    needs: "a TPDO of type 254 or 255 with a known inhibit time (18xx:03) above 0",
    is_timing: true,
    word: "PDO",
    tolerances: &[tolerance("warning-percent", 80.0, "%", "of the inhibit time, minus 1 ms")],
}

/// Unit of the inhibit time, in nanoseconds.
const STEP: i64 = 100_000;

/// Minimum number of consecutive short intervals.
const TIMES: u8 = 3;

/// Resolution of most timestamps, in nanoseconds.
const DIGIT: i64 = 1_000_000;

struct PdoInhibitTime {
    percent: i64,
    inhibit: PdoParameter,
    kind: PdoParameter,
    short: BySlot<u8>,
}

fn new(policy: &Policy) -> PdoInhibitTime {
    #[expect(clippy::cast_possible_truncation, reason = "saturates")]
    let percent = policy.tolerance(&DECLARATION, "warning-percent") as i64;
    PdoInhibitTime {
        percent,
        inhibit: PdoParameter::new(3),
        kind: PdoParameter::new(2),
        short: BySlot::default(),
    }
}

fn positive(time: u64) -> Option<i64> {
    i64::try_from(time).ok().filter(|time| *time > 0)
}

/// Shortest permitted interval in ns, with an inhibit time above 0.
const fn shortest(inhibit: i64, percent: i64) -> i64 {
    inhibit.saturating_mul(STEP) / 100 * percent - DIGIT
}

impl PdoInhibitTime {
    #[inline]
    fn pdo(&mut self, event: &Event, pdo: &Pdo, context: &mut Context<'_>) {
        let Some(slot) = context.traffic.current() else { return };
        let inhibit = self.inhibit.of(event, pdo, slot, context).and_then(positive);
        let Some(inhibit) = inhibit else { return };
        let Some(254 | 255) = self.kind.of(event, pdo, slot, context) else { return };
        let (Some(short), Some(interval)) = (self.short.of(slot), slot.interval()) else { return };
        let shortest = shortest(inhibit, self.percent);
        if interval >= shortest {
            if std::mem::take(short) > 0 {
                context.ask_again();
            }
            return context.pass();
        }
        *short += 1;
        context.ask_again();
        if *short < TIMES {
            return;
        }
        *short = 0;
        let (name, after, limit) = (pdo.name, interval / STEP, shortest / STEP);
        let alarm = context.fail(event).about(About::Id(pdo.cob_id)).frames(slot.between());
        alarm.report(|| {
            let tenths = |time: i64| format!("{}.{} ms", time / 10, time % 10);
            let [after, limit, inhibit] = [after, limit, inhibit].map(tenths);
            format!("{name} interval {after} < {limit} (inhibit time {inhibit})")
        });
    }
}

impl Rule for PdoInhibitTime {
    fn wants_pdos(&self) -> bool {
        self.inhibit.may_be_known()
    }

    fn need(&self, _event: &Event, context: &Context<'_>) -> Need {
        let Some(slot) = context.traffic.current() else { return Need::EACH };
        let inhibit = match self.inhibit.looked_up(slot) {
            LookedUp::NotYet => return Need::EACH,
            LookedUp::Unknown => None,
            LookedUp::Value(time) => positive(time),
        };
        let Some(inhibit) = inhibit else { return Need::NOTHING };
        match (self.kind.looked_up(slot), self.short.get(slot.place)) {
            (LookedUp::Value(254 | 255), Some(0)) => {
                Need { shortest: shortest(inhibit, self.percent), ..Need::PASSED }
            }
            (LookedUp::NotYet | LookedUp::Value(254 | 255), _) => Need::EACH,
            (LookedUp::Unknown | LookedUp::Value(_), _) => Need::NOTHING,
        }
    }

    #[inline]
    fn event(&mut self, event: &Event, context: &mut Context<'_>) {
        if let EventKind::Pdo(pdo) = &event.kind {
            return self.pdo(event, pdo, context);
        }
        let is_other = self.inhibit.changes(event);
        if self.kind.changes(event) {
            self.short.clear();
        }
        if is_other {
            context.ask_again();
        }
    }
}
