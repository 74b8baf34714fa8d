//! Error frames, error states of the CAN controller, and bus load.

use std::collections::VecDeque;
use std::sync::Arc;

use crate::event::{Event, EventKind, FrameRange, Kind};
use crate::finding::{FindingSubject, Severity};
use crate::frame::Timestamp;
use crate::rules::rule::{declare_rule, define_tolerance};
use crate::rules::{BusSecond, Rule, RuleContext, RulePolicy};
use crate::wire::error_frame::ErrorFrameFields;

declare_rule! {
    /// # What it checks
    /// Error frames exceed `errors-percent` of all frames, or `errors-per-second` within any second. Or the CAN
    /// controller of the capturing interface is error passive or bus-off. If the bus file states the bit rate,
    /// the bus load per second is checked too. Interfaces that do not report error frames leave the rule without data.
    ///
    /// # Why it matters
    /// A disturbed frame is sent again, which delays messages. A controller with too many errors goes
    /// bus-off. On a busy bus, messages of low priority are delayed.
    ///
    /// # Source
    /// ISO 11898-1 §10.8 to §10.14 (error frames, error passive, bus off); linux/can/error.h
    ///
    /// # What to look at first
    /// Check termination, bit rate, shield and stubs. The termination is 60 Ω between the lines, and all
    /// devices need the same bit rate and sample point. Note which node is connected when the errors begin.
    ///
    /// # Mutation
    /// insert error frames within a second
    "bus-health", Error, "bus disturbed or overloaded",
    kinds: [Kind::CanError],
    needs: "error frames or controller states of the interface, or a bit rate in the bus file",
    word: "BUS",
    tolerances: &[
        define_tolerance("errors-percent", 0.1, "%", "share of error frames in all frames, a warning"),
        define_tolerance("errors-per-second", 10.0, "", "error frames per second, a warning"),
        define_tolerance("load-warning-percent", 60.0, "%", "bus load within a second, a warning"),
        define_tolerance("load-error-percent", 80.0, "%", "bus load within a second, an error"),
    ],
}

/// Minimum number of error frames in a second without any other frame that suggests a wrong bit rate.
const ONLY_ERRORS: u64 = 5;

/// Minimum number of frames for a meaningful share of error frames.
const JUDGED: u64 = 1_000;

/// One second in ns.
const SECOND: i64 = 1_000_000_000;

/// Maximum number of error frames kept for a second; more than fit on a bus of 1 Mbit/s.
const KEPT: usize = 32_768;

/// Class bits and controller bits of SocketCAN error frames. A frame is disturbed by a protocol error, a missing
/// acknowledgement or a bus error.
const DISTURBED: u32 = 0x008 | 0x020 | 0x080;
const CONTROLLER: u32 = 0x004;
const BUS_OFF: u32 = 0x040;
const RESTARTED: u32 = 0x100;
const PASSIVE: u8 = 0x30;
const ACTIVE: u8 = 0x40;

struct BusHealth {
    share: f64,
    in_second: f64,
    load: (f64, f64),
    errors: Arc<str>,
    busy: Arc<str>,
    passive: Arc<str>,
    off: Arc<str>,
    /// Time and frame of the error frames of the last second.
    recent: VecDeque<(i64, u64)>,
    /// Maximum number of error frames within a second since the last verdict.
    worst: ErrorBurst,
    /// Time and frame of the last error frame: a verdict at a later time would prolong the disturbance.
    last: Option<(Option<Timestamp>, u64)>,
}

/// Error frames within a second.
#[derive(Default)]
struct ErrorBurst {
    count: usize,
    frames: FrameRange,
    /// Timestamp of the last one.
    end: Option<Timestamp>,
}

fn new(policy: &RulePolicy) -> BusHealth {
    let of = |key| policy.tolerance_value(&DECLARATION, key);
    BusHealth {
        share: of("errors-percent"),
        in_second: of("errors-per-second"),
        load: (of("load-warning-percent"), of("load-error-percent")),
        errors: "error frames".into(),
        busy: "load".into(),
        passive: "error passive".into(),
        off: "bus-off".into(),
        recent: VecDeque::new(),
        worst: ErrorBurst::default(),
        last: None,
    }
}

impl BusHealth {
    fn on_controller_error(&self, event: &Event, error: ErrorFrameFields, context: &mut RuleContext<'_>) {
        let is_controller = error.classes & CONTROLLER != 0;
        if error.classes & RESTARTED != 0 || is_controller && error.controller & ACTIVE != 0 {
            context.close_condition(None, FindingSubject::Name(Arc::clone(&self.off)));
            context.close_condition(None, FindingSubject::Name(Arc::clone(&self.passive)));
        }
        let (sent, received) = (error.transmit_errors, error.receive_errors);
        if error.classes & BUS_OFF != 0 {
            let alarm = context
                .start_finding(event)
                .with_subject(FindingSubject::Name(Arc::clone(&self.off)))
                .mark_ongoing();
            alarm.mark_certain().report_finding(|| "CAN interface bus-off".to_owned());
        } else if is_controller && error.controller & PASSIVE != 0 {
            let alarm = context
                .start_finding(event)
                .with_subject(FindingSubject::Name(Arc::clone(&self.passive)))
                .mark_ongoing();
            alarm.mark_certain().report_finding(|| {
                format!(
                    "CAN interface error passive (transmit error counter {sent}, receive error counter {received}, \
                     limit 127)"
                )
            });
        }
    }

    /// Adds an error frame to the sliding second.
    fn add_error_frame(&mut self, event: &Event, context: &RuleContext<'_>) {
        let (now, frame) = (context.now, event.frames.last);
        self.last = Some((event.time, frame));
        if !context.has_time {
            return;
        }
        while self.recent.len() >= KEPT
            || self.recent.front().is_some_and(|(time, _)| now.saturating_sub(*time) >= SECOND)
        {
            self.recent.pop_front();
        }
        self.recent.push_back((now, frame));
        let count = self.recent.len();
        if let Some((_, first)) = self.recent.front().filter(|_| count > self.worst.count) {
            self.worst =
                ErrorBurst { count, frames: FrameRange { first: *first, last: frame }, end: event.time };
        }
    }

    /// Judges the sliding seconds that ended since the last verdict.
    fn judge_errors(&mut self, second: &BusSecond, context: &mut RuleContext<'_>) {
        let ErrorBurst { count, frames, end } = std::mem::take(&mut self.worst);
        let last = self.last.and_then(|(time, _)| time);
        #[expect(clippy::cast_precision_loss, reason = "frames of a second")]
        let (errors, all) = (count as f64, second.errors as f64);
        let about = FindingSubject::Name(Arc::clone(&self.errors));
        if second.count >= ONLY_ERRORS && second.errors == second.count {
            let alarm = context
                .fail_at_timestamp(last, None, second.frames)
                .with_subject(about)
                .with_measure(all)
                .mark_certain();
            alarm.report_finding(|| format!("{all} error frames/s and no other frames (wrong bit rate?)"));
        } else if errors > self.in_second {
            self.recent.clear();
            let alarm = context.fail_at_timestamp(end, None, frames).with_subject(about);
            let limit = self.in_second;
            let alarm = alarm.with_severity(Severity::Warning).with_measure(errors).mark_certain();
            alarm.report_finding(|| format!("{errors} error frames/s (limit {limit}/s)"));
        } else {
            context.count_pass();
        }
    }

    fn on_load(&self, second: &BusSecond, rate: u32, context: &mut RuleContext<'_>) {
        #[expect(clippy::cast_precision_loss, reason = "bits of a second")]
        let percent = |bits: u64| bits as f64 * 100.0 / f64::from(rate);
        let (warning, error) = self.load;
        if percent(second.most) <= warning {
            return context.count_pass();
        }
        // Without stuff bits, the real load is higher still.
        let least = percent(second.bits.unwrap_or(second.least));
        if least <= warning {
            if second.bits.is_some() {
                context.count_pass();
            }
            return;
        }
        let (severity, limit) =
            if least > error { (Severity::Error, error) } else { (Severity::Warning, warning) };
        let about = FindingSubject::Name(Arc::clone(&self.busy));
        let alarm =
            context.fail_at(context.now, None, second.frames).with_subject(about).with_severity(severity);
        let at_least = if second.bits.is_some() { "" } else { "at least " };
        alarm.with_measure(least).mark_certain().report_finding(|| {
            format!("bus load {at_least}{least:.0} % of {} kbit/s (limit {limit} %)", rate / 1_000)
        });
    }
}

impl Rule for BusHealth {
    fn on_event(&mut self, event: &Event, context: &mut RuleContext<'_>) {
        if let EventKind::CanError(error) = event.kind {
            self.on_controller_error(event, error, context);
            if error.classes & DISTURBED != 0 {
                self.add_error_frame(event, context);
            }
        }
    }

    fn on_second(&mut self, context: &mut RuleContext<'_>) {
        // With generated timestamps, a second is meaningless.
        if context.meter.has_varied {
            let second = context.meter.last;
            self.judge_errors(&second, context);
            if let Some(rate) = context.meter.bit_rate {
                self.on_load(&second, rate, context);
            }
        }
    }

    fn on_end(&mut self, context: &mut RuleContext<'_>) {
        // Errors after the last complete second.
        if context.meter.has_varied && self.worst.count > 0 {
            self.judge_errors(&BusSecond::default(), context);
        }
        let (errors, frames) = (context.meter.errors, context.meter.frames);
        if frames < JUDGED {
            return;
        }
        #[expect(clippy::cast_precision_loss, reason = "a share")]
        let share = errors as f64 * 100.0 / frames as f64;
        if share <= self.share {
            return context.count_pass();
        }
        let about = FindingSubject::Name(Arc::clone(&self.errors));
        let (time, frame) =
            self.last.unwrap_or((context.timestamp_of(context.now), context.bus.last_frame()));
        let alarm = context
            .fail_at_timestamp(time, None, FrameRange::one(frame))
            .with_subject(about)
            .with_severity(Severity::Warning);
        let limit = self.share;
        alarm
            .mark_certain()
            .report_finding(|| format!("{share:.2} % error frames (limit {limit} %): {errors} of {frames}"));
    }
}
