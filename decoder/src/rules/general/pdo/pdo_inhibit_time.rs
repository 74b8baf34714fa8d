//! Inhibit times of TPDOs.

use super::pdo_parameter::PdoParameter;
use crate::event::{Event, EventKind, Pdo};
use crate::finding::About;
use crate::rules::rule::{declare_rule, tolerance};
use crate::rules::{BySlot, Context, Policy, Rule};

declare_rule! {
    /// # What it checks
    /// A TPDO of type 254 or 255 with an inhibit time (18xx:02 and 18xx:03 written or read) does not come again sooner,
    /// three times in a row. One that is delayed on the bus makes the next interval short.
    ///
    /// # Why it matters
    /// A value that trembles takes the bus from all identifiers behind it.
    ///
    /// # Source
    /// CiA 301 §7.2.2.2, §7.5.2.37 (inhibit time, in steps of 100 µs)
    ///
    /// # What to look at first
    /// Whether the device takes the inhibit time while the PDO is valid.
    ///
    /// # Mutation
    /// insert further PDOs of one with an inhibit time
    "pdo-inhibit-time", Warning, "a TPDO comes sooner than its inhibit time",
    kinds: ["tpdo", "sdo-transfer", "boot-up", "nmt-state", "lost-frames", "link"],
    is_timing: true,
    word: "PDO",
    tolerances: &[tolerance("warning-percent", 80.0, "%", "of the inhibit time, less 1 ms")],
}

/// A step of inhibit times, in nanoseconds.
const STEP: i64 = 100_000;

/// Times in a row.
const TIMES: u8 = 3;

/// A digit of most stamps, in nanoseconds.
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

impl PdoInhibitTime {
    #[inline]
    fn pdo(&mut self, event: &Event, pdo: &Pdo, context: &mut Context<'_>) {
        let Some(slot) = context.traffic.current() else { return };
        let inhibit = self.inhibit.of(event, pdo, slot, context);
        let Some(inhibit) = inhibit.and_then(|time| i64::try_from(time).ok()).filter(|time| *time > 0) else {
            return;
        };
        let Some(254 | 255) = self.kind.of(event, pdo, slot, context) else { return };
        let (Some(short), Some(interval)) = (self.short.of(slot), slot.interval) else { return };
        let shortest = inhibit.saturating_mul(STEP) / 100 * self.percent - DIGIT;
        if interval >= shortest {
            *short = 0;
            return context.pass();
        }
        *short += 1;
        if *short < TIMES {
            return;
        }
        *short = 0;
        let (name, after) = (pdo.name, interval / STEP);
        let alarm = context.fail(event).about(About::Id(pdo.cob_id)).frames(slot.between());
        alarm.say(|| {
            let tenths = |time: i64| format!("{}.{} ms", time / 10, time % 10);
            format!("{name} after {}; its inhibit time is {}", tenths(after), tenths(inhibit))
        });
    }
}

impl Rule for PdoInhibitTime {
    fn wants_pdos(&self) -> bool {
        self.inhibit.may_be_known()
    }

    #[inline]
    fn event(&mut self, event: &Event, context: &mut Context<'_>) {
        if let EventKind::Pdo(pdo) = &event.kind {
            return self.pdo(event, pdo, context);
        }
        self.inhibit.changes(event);
        if self.kind.changes(event) {
            self.short.clear();
        }
    }
}
