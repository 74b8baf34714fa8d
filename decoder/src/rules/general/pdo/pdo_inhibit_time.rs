//! TPDOs against their inhibit time.

use super::pdo_parameter::{LookedUp, PdoParameter};
use crate::event::{DecodedPdo, Event, EventKind, Kind};
use crate::finding::FindingSubject;
use crate::rules::rule::{declare_rule, define_tolerance};
use crate::rules::{BySlot, FrameNeed, PdoSubset, Rule, RuleContext, RulePolicy, TransferSubset};

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
    tolerances: &[define_tolerance("warning-percent", 80.0, "%", "of the inhibit time, minus 1 ms")],
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

fn new(policy: &RulePolicy) -> PdoInhibitTime {
    #[expect(clippy::cast_possible_truncation, reason = "saturates")]
    let percent = policy.tolerance_value(&DECLARATION, "warning-percent") as i64;
    PdoInhibitTime {
        percent,
        inhibit: PdoParameter::new(3),
        kind: PdoParameter::new(2),
        short: BySlot::default(),
    }
}

fn positive_time(time: u64) -> Option<i64> {
    i64::try_from(time).ok().filter(|time| *time > 0)
}

/// Shortest permitted interval in ns, with an inhibit time above 0.
const fn shortest_interval(inhibit: i64, percent: i64) -> i64 {
    inhibit.saturating_mul(STEP) / 100 * percent - DIGIT
}

impl PdoInhibitTime {
    #[inline]
    fn on_pdo(&mut self, event: &Event, pdo: &DecodedPdo, context: &mut RuleContext<'_>) {
        let Some(slot) = context.traffic.current_slot() else { return };
        let inhibit = self.inhibit.value_for(event, pdo, slot, context).and_then(positive_time);
        let Some(inhibit) = inhibit else { return };
        let Some(254 | 255) = self.kind.value_for(event, pdo, slot, context) else { return };
        let (Some(short), Some(interval)) = (self.short.entry_of(slot), slot.interval()) else { return };
        let shortest = shortest_interval(inhibit, self.percent);
        if interval >= shortest {
            if std::mem::take(short) > 0 {
                context.ask_again();
            }
            return context.count_pass();
        }
        *short += 1;
        context.ask_again();
        if *short < TIMES {
            return;
        }
        *short = 0;
        let (name, after, limit) = (pdo.name, interval / STEP, shortest / STEP);
        let alarm = context
            .start_finding(event)
            .with_subject(FindingSubject::Id(pdo.cob_id))
            .with_frames(slot.frames_between());
        alarm.report_finding(|| {
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

    fn frame_need(&self, _event: &Event, context: &RuleContext<'_>) -> FrameNeed {
        let Some(slot) = context.traffic.current_slot() else { return FrameNeed::EACH };
        let inhibit = match self.inhibit.looked_up(slot) {
            LookedUp::NotYet => return FrameNeed::EACH,
            LookedUp::Unknown => None,
            LookedUp::Value(time) => positive_time(time),
        };
        let Some(inhibit) = inhibit else { return FrameNeed::NOTHING };
        match (self.kind.looked_up(slot), self.short.get(slot.place)) {
            (LookedUp::Value(254 | 255), Some(0)) => {
                FrameNeed { shortest: shortest_interval(inhibit, self.percent), ..FrameNeed::PASSED }
            }
            (LookedUp::NotYet | LookedUp::Value(254 | 255), _) => FrameNeed::EACH,
            (LookedUp::Unknown | LookedUp::Value(_), _) => FrameNeed::NOTHING,
        }
    }

    #[inline]
    fn on_event(&mut self, event: &Event, context: &mut RuleContext<'_>) {
        if let EventKind::Pdo(pdo) = &event.kind {
            return self.on_pdo(event, pdo, context);
        }
        let is_other = self.inhibit.on_event(event);
        if self.kind.on_event(event) {
            self.short.clear();
        }
        if is_other {
            context.ask_again();
        }
    }
}
