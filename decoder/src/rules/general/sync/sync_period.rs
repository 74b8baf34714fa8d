//! SYNC period against 1006 or the usual period.

use crate::event::{Event, EventKind, FrameRange, Kind, SdoTransfer};
use crate::finding::{FindingSubject, Severity};
use crate::frame::Timestamp;
use crate::rules::general::facts::{PRODUCES, confirmed_value, transfer_number};
use crate::rules::rule::{declare_rule, define_tolerance};
use crate::rules::{Rule, RuleContext, RulePolicy, TransferSubset};
use crate::session::{Bus, Node};
use crate::wire::canopen::{NmtState, ObjectAddress};

declare_rule! {
    /// # What it checks
    /// The SYNC interval deviates from the communication cycle period (1006) of the producer, or from the
    /// usual period if 1006 is unknown. Two interleaved SYNC streams, and two nodes configured as producer
    /// (bit 30 of 1005), are an error. Buses with another SYNC identifier are exempt, and so is the interval in which an
    /// NMT command ends the operation of all nodes.
    ///
    /// # Why it matters
    /// Synchronous PDOs and set points take effect at SYNC. With an irregular SYNC, axes and outputs do not
    /// act together.
    ///
    /// # Source
    /// CiA 301 §7.2.5 (SYNC), §7.5.2.5 (1005), §7.5.2.6 (1006)
    ///
    /// # What to look at first
    /// Check cycle time and load of the SYNC producer. Check the load of the bus, and bit 30 of 1005 in all
    /// nodes.
    ///
    /// # Mutation
    /// drop a SYNC; insert a second stream of SYNC
    "sync-period", Error, "SYNC period out of tolerance",
    kinds: [Kind::Sync, Kind::SdoTransfer, Kind::BootUp, Kind::NmtCommand],
    transfers: TransferSubset::Communication,
    needs: "SYNC at a steady interval",
    is_timing: true,
    word: "SYNC",
    tolerances: &[
        define_tolerance("given-percent", 10.0, "%", "deviation from 1006, a warning"),
        define_tolerance("usual-percent", 20.0, "%", "deviation from the median if 1006 is unknown, a warning"),
    ],
}

/// Communication cycle period, in µs; COB-ID SYNC with the producer bit 30.
const PERIOD: ObjectAddress = ObjectAddress::new(0x1006, 0);
const COB_ID: ObjectAddress = ObjectAddress::new(0x1005, 0);

/// Bits 0 to 28 of 1005: identifier.
const IDENTIFIER: u64 = 0x1FFF_FFFF;
const PREDEFINED: u64 = 0x80;

/// Number of intervals for the median; minimum number of them near the median for a cyclic SYNC.
const WINDOW: usize = 16;
const NEAR: usize = 12;

/// Coarsest resolution of timestamps, in nanoseconds.
const COARSEST: i64 = 1_000_000_000;

struct SyncPeriod {
    given_share: f64,
    usual_share: f64,
    /// Time and frame of the last SYNC.
    last: Option<(i64, u64)>,
    intervals: [i64; WINDOW],
    filled: usize,
    median: Option<i64>,
    given: Option<i64>,
    /// A node uses another SYNC identifier.
    is_mixed: bool,
    /// The configuration of a node changed after the last SYNC. A transfer is reported before its value is stored.
    is_outdated: bool,
    /// Resolution of the timestamps relative to the first one, in nanoseconds.
    step: i64,
    first: i64,
    is_double: bool,
}

fn new(policy: &RulePolicy) -> SyncPeriod {
    let share = |key| policy.tolerance_value(&DECLARATION, key) / 100.0;
    SyncPeriod {
        given_share: share("given-percent"),
        usual_share: share("usual-percent"),
        last: None,
        intervals: [0; WINDOW],
        filled: 0,
        median: None,
        given: None,
        is_mixed: false,
        is_outdated: false,
        step: COARSEST,
        first: 0,
        is_double: false,
    }
}

impl SyncPeriod {
    fn on_sync(&mut self, event: &Event, context: &mut RuleContext<'_>) {
        if std::mem::take(&mut self.is_outdated) {
            self.update_expected(context.bus);
        }
        let Some(stamp) = event.time.filter(|_| !self.is_mixed) else { return };
        let now = context.now;
        let Some((last, frame)) = self.last.replace((now, event.frames.last)) else {
            self.first = stamp.0;
            return;
        };
        while self.step > 1 && stamp.0.saturating_sub(self.first) % self.step != 0 {
            self.step /= 10;
        }
        // An interval across a hole is that of the capture, not of the producer.
        if context.is_across_hole(frame) {
            return;
        }
        let interval = now.saturating_sub(last);
        self.intervals.rotate_left(1);
        if let Some(newest) = self.intervals.last_mut() {
            *newest = interval;
        }
        self.filled = self.filled.saturating_add(1);
        let (reference, share) = match (self.given, self.median) {
            (Some(given), _) => (Some(given), self.given_share),
            (None, median) => (median, self.usual_share),
        };
        let frames = FrameRange { first: frame, last: event.frames.last };
        let is_full = self.filled.is_multiple_of(WINDOW);
        if is_full {
            self.learn_period();
        }
        let is_near = reference.is_some_and(|period| self.is_near(interval, period, share));
        if self.filled >= WINDOW && (is_full || !is_near) {
            self.check_streams(event, reference, context);
        }
        let Some(period) = reference.filter(|_| !self.is_double) else { return };
        if is_near {
            return context.count_pass();
        }
        let source = if self.given.is_some() { "1006:00" } else { "usual period" };
        #[expect(clippy::cast_precision_loss, reason = "a measure to compare")]
        let measure = interval.abs_diff(period) as f64;
        let alarm = context
            .start_finding(event)
            .with_severity(Severity::Warning)
            .with_measure(measure)
            .with_frames(frames);
        alarm.report_finding(|| {
            let sign = if interval < period { "<" } else { ">" };
            let ([interval, period], percent) = ([interval, period].map(milliseconds_text), share * 100.0);
            format!("SYNC period {interval} {sign} {period} ± {percent:.0} % ({source})")
        });
    }

    /// Whether an interval equals a period within the tolerance and the timestamp resolution.
    fn is_near(&self, interval: i64, period: i64, share: f64) -> bool {
        #[expect(clippy::cast_precision_loss, reason = "times to compare")]
        let (off, most) = (interval.abs_diff(period) as f64, period as f64 * share + self.step as f64);
        off <= most
    }

    /// Updates the usual period if most of the latest intervals are near their median.
    fn learn_period(&mut self) {
        let mut sorted = self.intervals;
        sorted.sort_unstable();
        let Some(median) = sorted.get(WINDOW / 2).copied() else { return };
        let near =
            sorted.iter().filter(|interval| self.is_near(**interval, median, self.usual_share)).count();
        if near >= NEAR {
            self.median = Some(median);
        }
    }

    /// Checks whether the latest intervals belong to two producers.
    fn check_streams(&mut self, event: &Event, reference: Option<i64>, context: &mut RuleContext<'_>) {
        let was_double = std::mem::replace(&mut self.is_double, false);
        let Some([one, other]) = self.two_streams(reference) else {
            if was_double {
                context.close_condition(None, FindingSubject::Whole);
            }
            return;
        };
        self.is_double = true;
        if was_double {
            return;
        }
        let window: i64 = self.intervals.iter().sum();
        let since = event.time.map(|time| Timestamp(time.0.saturating_sub(window)));
        let alarm = context.start_finding(event).started_at(since);
        alarm.report_finding(|| {
            let [one, other, together] = [one, other, one + other].map(milliseconds_text);
            format!("two SYNC producers of {together} each (intervals alternate between {one} and {other})")
        });
    }

    /// Mean short and long interval, if they alternate and add up to the period.
    fn two_streams(&self, reference: Option<i64>) -> Option<[i64; 2]> {
        let half = i64::try_from(WINDOW / 2).ok()?;
        let means = [0, 1].map(|from| self.intervals.iter().skip(from).step_by(2).sum::<i64>() / half);
        let [one, other] = means;
        let both = one + other;
        let is_steady = self.intervals.chunks_exact(2).all(|pair| {
            pair.iter().zip(means).all(|(interval, mean)| self.is_near(*interval, mean, self.usual_share))
        });
        let differ = one.abs_diff(other) > both.unsigned_abs() / 5 + self.step.unsigned_abs() * 2;
        let fits = reference.is_none_or(|period| self.is_near(both, period, self.usual_share));
        (is_steady && differ && fits).then_some(means)
    }

    /// Updates the expected period from the configuration of the nodes.
    fn update_expected(&mut self, bus: &Bus) {
        let of_any = bus.nodes().filter_map(|node| confirmed_value(node, COB_ID));
        self.is_mixed = of_any.into_iter().any(|id| id & IDENTIFIER != PREDEFINED);
        let periods = bus
            .nodes()
            .filter_map(|node| Some((node, confirmed_value(node, PERIOD).filter(|period| *period > 0)?)));
        let produced = |node: &Node| confirmed_value(node, COB_ID).is_some_and(|id| id & PRODUCES != 0);
        let mut all: Vec<_> = periods.map(|(node, period)| (produced(node), period)).collect();
        if all.iter().any(|(produces, _)| *produces) {
            all.retain(|(produces, _)| *produces);
        }
        all.dedup();
        let given = match all.as_slice() {
            [(_, period)] => i64::try_from(*period).ok().map(|period| period.saturating_mul(1000)),
            _ => None,
        };
        if given != self.given {
            self.given = given;
            (self.last, self.median, self.filled) = (None, None, 0);
        }
    }

    /// Checks the producer bits after a transfer of 1005, whose value is not stored yet.
    fn check_producers(event: &Event, transfer: &SdoTransfer, context: &mut RuleContext<'_>) {
        let produces = |node: &&Node| {
            let transferred = transfer_number(transfer).filter(|_| event.node == Some(node.id()));
            transferred.or_else(|| confirmed_value(node, COB_ID)).is_some_and(|id| id & PRODUCES != 0)
        };
        let all: Vec<String> =
            context.bus.nodes().filter(produces).map(|node| node.id().to_string()).collect();
        if all.len() > 1 {
            let alarm = context.start_finding(event).with_subject(FindingSubject::Object(COB_ID));
            alarm.report_finding(|| {
                format!("several SYNC producers: nodes {} (1005:00 bit 30)", all.join(", "))
            });
        }
    }
}

fn milliseconds_text(time: i64) -> String {
    #[expect(clippy::cast_precision_loss, reason = "a time to read")]
    let milliseconds = time as f64 / 1e6;
    format!("{milliseconds:.1} ms")
}

impl Rule for SyncPeriod {
    fn on_event(&mut self, event: &Event, context: &mut RuleContext<'_>) {
        match &event.kind {
            EventKind::Sync { .. } if !event.presumed => self.on_sync(event, context),
            EventKind::SdoTransfer(transfer) => {
                self.is_outdated |= matches!(transfer.object, Some(PERIOD | COB_ID));
                if transfer.object == Some(COB_ID) {
                    Self::check_producers(event, transfer, context);
                }
            }
            EventKind::BootUp { .. } => self.is_outdated = true,
            // A planned standstill or restart: the producer may pause.
            EventKind::NmtCommand { to: Some(to), target: 0, .. } if *to != NmtState::Operational => {
                self.last = None;
            }
            _ => {}
        }
    }
}
