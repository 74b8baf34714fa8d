//! TPDOs against their event timer.

use super::pdo_parameter::{LookedUp, PdoParameter};
use crate::event::{DecodedPdo, Event, EventKind, Kind};
use crate::finding::FindingSubject;
use crate::rules::rule::{declare_rule, define_tolerance};
use crate::rules::{BySlot, FrameNeed, PdoSubset, Rule, RuleContext, RulePolicy, TransferSubset};

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
    tolerances: &[define_tolerance("warning-percent", 150.0, "%", "of the event timer, plus 10 ms")],
}

/// General tolerance, in nanoseconds.
const SLACK: i64 = 10_000_000;

struct PdoEventTimer {
    percent: i64,
    timer: PdoParameter,
    seen: BySlot<u32>,
}

fn new(policy: &RulePolicy) -> PdoEventTimer {
    #[expect(clippy::cast_possible_truncation, reason = "saturates")]
    let percent = policy.tolerance_value(&DECLARATION, "warning-percent") as i64;
    PdoEventTimer { percent, timer: PdoParameter::new(5), seen: BySlot::default() }
}

impl PdoEventTimer {
    /// Longest interval in ns with an event timer in ms; `None` if it is switched off.
    fn longest_interval(&self, timer: u64) -> Option<i64> {
        let timer = i64::try_from(timer).ok().filter(|timer| *timer > 0)?;
        Some(timer.saturating_mul(self.percent).saturating_mul(10_000).saturating_add(SLACK))
    }

    #[inline]
    fn on_pdo(&mut self, event: &Event, pdo: &DecodedPdo, context: &mut RuleContext<'_>) {
        let Some(slot) = context.traffic.current_slot() else { return };
        let Some(timer) = self.timer.value_for(event, pdo, slot, context) else { return };
        let Some(limit) = self.longest_interval(timer) else { return };
        let Some(seen) = self.seen.entry_of(slot) else { return };
        let is_first = std::mem::replace(seen, self.timer.generation()) != self.timer.generation();
        let Some(interval) = slot.interval().filter(|_| !is_first) else { return };
        if interval <= limit {
            return context.count_pass();
        }
        let (name, [after, limit]) = (pdo.name, [interval, limit].map(|time| time / 1_000_000));
        #[expect(clippy::cast_precision_loss, reason = "a measure to compare")]
        let measure = interval as f64;
        let alarm = context
            .start_finding(event)
            .with_subject(FindingSubject::Id(pdo.cob_id))
            .with_frames(slot.frames_between())
            .with_measure(measure);
        alarm.report_finding(|| format!("{name} interval {after} ms > {limit} ms (event timer {timer} ms)"));
    }
}

impl Rule for PdoEventTimer {
    fn wants_pdos(&self) -> bool {
        self.timer.may_be_known()
    }

    fn frame_need(&self, _event: &Event, context: &RuleContext<'_>) -> FrameNeed {
        let Some(slot) = context.traffic.current_slot() else { return FrameNeed::EACH };
        let limit = match self.timer.looked_up(slot) {
            LookedUp::NotYet => return FrameNeed::EACH,
            LookedUp::Unknown => None,
            LookedUp::Value(timer) => self.longest_interval(timer),
        };
        let Some(limit) = limit else { return FrameNeed::NOTHING };
        let is_first = self.seen.get(slot.place) != Some(&self.timer.generation());
        if is_first { FrameNeed::EACH } else { FrameNeed { longest: limit, ..FrameNeed::PASSED } }
    }

    #[inline]
    fn on_event(&mut self, event: &Event, context: &mut RuleContext<'_>) {
        if let EventKind::Pdo(pdo) = &event.kind {
            self.on_pdo(event, pdo, context);
        } else if self.timer.on_event(event) {
            context.ask_again();
        }
    }
}
