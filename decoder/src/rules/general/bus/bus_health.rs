//! The bus itself is disturbed or too busy.

use std::sync::Arc;

use crate::event::{Event, EventKind, FrameRange};
use crate::finding::{About, Severity};
use crate::rules::rule::{declare_rule, tolerance};
use crate::rules::{Context, Policy, Rule, Second};
use crate::wire::error_frame::ErrorFrame;

declare_rule! {
    /// # What it checks
    /// Error frames are more than a share of all frames, or more than so many in a second. The controller of the
    /// recorder is error passive or bus-off. With the bit rate of the bus file: the bus is busy for more than a share of
    /// a second. A second of error frames and nothing else asks for the bit rate. Where the recorder notes no error
    /// frames, their absence says nothing.
    ///
    /// # Why it matters
    /// A disturbed frame is sent again, so things come late; a controller that sees too many errors leaves the bus.
    /// On a busy bus the messages of low priority wait.
    ///
    /// # Source
    /// ISO 11898-1 §10.8 to §10.14 (error frames, error passive, bus off); linux/can/error.h
    ///
    /// # What to look at first
    /// Termination (60 Ω between the lines), bit rate and sample point of all devices, shield and stubs, which node is
    /// there when the errors begin.
    ///
    /// # Mutation
    /// insert error frames within a second
    "bus-health", Error, "the bus is disturbed or too busy",
    kinds: ["can-error"],
    word: "BUS",
    tolerances: &[
        tolerance("errors-percent", 0.1, "%", "error frames of all frames, a warning"),
        tolerance("errors-per-second", 10.0, "", "error frames in a second, a warning"),
        tolerance("load-warning-percent", 60.0, "%", "of the bit rate in a second, a warning"),
        tolerance("load-error-percent", 80.0, "%", "of the bit rate in a second, an error"),
    ],
}

/// Error frames in a second that are enough to ask for the bit rate where nothing else comes.
const ONLY_ERRORS: u64 = 5;

/// Frames from which on a share of them says something.
const JUDGED: u64 = 1_000;

/// Class bits and controller bits of SocketCAN.
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
}

fn new(policy: &Policy) -> BusHealth {
    let of = |key| policy.tolerance(&DECLARATION, key);
    BusHealth {
        share: of("errors-percent"),
        in_second: of("errors-per-second"),
        load: (of("load-warning-percent"), of("load-error-percent")),
        errors: "error frames".into(),
        busy: "load".into(),
        passive: "error passive".into(),
        off: "bus-off".into(),
    }
}

impl BusHealth {
    fn controller(&self, event: &Event, error: ErrorFrame, context: &mut Context<'_>) {
        let is_controller = error.classes & CONTROLLER != 0;
        if error.classes & RESTARTED != 0 || is_controller && error.controller & ACTIVE != 0 {
            context.close(None, About::Name(Arc::clone(&self.off)));
            context.close(None, About::Name(Arc::clone(&self.passive)));
        }
        let (sent, received) = (error.transmit_errors, error.receive_errors);
        if error.classes & BUS_OFF != 0 {
            let alarm = context.fail(event).about(About::Name(Arc::clone(&self.off))).ongoing();
            alarm.certain().say(|| "the recorder's controller is bus-off".to_owned());
        } else if is_controller && error.controller & PASSIVE != 0 {
            let alarm = context.fail(event).about(About::Name(Arc::clone(&self.passive))).ongoing();
            alarm.certain().say(|| {
                format!(
                    "the recorder's controller is error passive: {sent} errors sending, {received} receiving"
                )
            });
        }
    }

    fn judge(&self, second: &Second, context: &mut Context<'_>) {
        #[expect(clippy::cast_precision_loss, reason = "frames of a second")]
        let errors = second.errors as f64;
        let about = About::Name(Arc::clone(&self.errors));
        if second.count >= ONLY_ERRORS && second.errors == second.count {
            let alarm =
                context.fail_at(context.now, None, second.frames).about(about).measure(errors).certain();
            alarm.say(|| format!("{errors} error frames in a second and nothing else: wrong bit rate?"));
        } else if errors > self.in_second {
            let alarm = context.fail_at(context.now, None, second.frames).about(about);
            let limit = self.in_second;
            let alarm = alarm.severity(Severity::Warning).measure(errors).certain();
            alarm.say(|| format!("{errors} error frames in a second; {limit} are too many"));
        } else {
            context.pass();
        }
        if let Some(rate) = context.meter.bit_rate {
            self.load(second, rate, context);
        }
    }

    fn load(&self, second: &Second, rate: u32, context: &mut Context<'_>) {
        #[expect(clippy::cast_precision_loss, reason = "bits of a second")]
        let percent = |bits: u64| bits as f64 * 100.0 / f64::from(rate);
        let (warning, error) = self.load;
        if percent(second.most) <= warning {
            return context.pass();
        }
        // Without stuff bits it is more than that: enough to tell.
        let least = percent(second.bits.unwrap_or(second.least));
        if least <= warning {
            if second.bits.is_some() {
                context.pass();
            }
            return;
        }
        let severity = if least > error { Severity::Error } else { Severity::Warning };
        let about = About::Name(Arc::clone(&self.busy));
        let alarm = context.fail_at(context.now, None, second.frames).about(about).severity(severity);
        let at_least = if second.bits.is_some() { "" } else { "at least " };
        alarm.measure(least).certain().say(|| {
            format!("{at_least}{least:.0} % of {} kbit/s in a second; {warning} % is busy", rate / 1_000)
        });
    }
}

impl Rule for BusHealth {
    fn event(&mut self, event: &Event, context: &mut Context<'_>) {
        if let EventKind::CanError(error) = event.kind {
            self.controller(event, error, context);
        }
    }

    fn second(&mut self, context: &mut Context<'_>) {
        // Of made-up stamps a second says nothing.
        if context.meter.has_varied {
            let second = context.meter.last;
            self.judge(&second, context);
        }
    }

    fn finish(&mut self, context: &mut Context<'_>) {
        let (errors, frames) = (context.meter.errors, context.meter.frames);
        if frames < JUDGED {
            return;
        }
        #[expect(clippy::cast_precision_loss, reason = "a share")]
        let share = errors as f64 * 100.0 / frames as f64;
        if share <= self.share {
            return context.pass();
        }
        let about = About::Name(Arc::clone(&self.errors));
        let last = FrameRange::one(context.bus.last_frame());
        let alarm = context.fail_at(context.now, None, last).about(about).severity(Severity::Warning);
        let limit = self.share;
        alarm.certain().say(|| format!("{errors} error frames of {frames}: {share:.2} %, over {limit} %"));
    }
}
