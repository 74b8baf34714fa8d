//! A calibration fails, or does not end.

use crate::event::{Event, EventKind, FrameRange, ProcedureEvent};
use crate::finding::{About, Severity};
use crate::profile::device::ProcedureStatus;
use crate::rules::rule::{declare_rule, tolerance};
use crate::rules::{Context, Policy, Rule};
use crate::wire::NodeId;

declare_rule! {
    /// # What it checks
    /// A calibration ends with an error, was not begun because another one runs, is stopped (a note), or shows no end
    /// within a multiple of the time its manual gives. What a status number says is what the manual says of it.
    ///
    /// # Why it matters
    /// The device goes on with the old values, or with defaults of its own.
    ///
    /// # Source
    /// Calibrations and their status codes: the device's manual.
    ///
    /// # What to look at first
    /// The preconditions the manual names: motor, actuators, temperature. Without an end: whether the controller reads
    /// the status at all.
    ///
    /// # Mutation
    /// answer the upload of a calibration's status with an error code
    "calibration", Error, "a calibration fails or does not end",
    kinds: ["procedure", "boot-up"],
    word: "CALIB",
    tolerances: &[tolerance("times", 2.0, "", "nominal times within which it ends, a warning")],
}

/// KIND word of the procedures that are calibrations.
const CALIBRATION: &str = "CALIB";

/// Calibrations that run at once on a bus; further ones are judged by their end only.
const RUNNING_LIMIT: usize = 256;

struct Running {
    node: NodeId,
    name: String,
    due: i64,
    nominal: f64,
    frame: u64,
    number: u64,
}

struct Calibration {
    times: f64,
    running: Vec<Running>,
    begun: u64,
}

fn new(policy: &Policy) -> Calibration {
    Calibration { times: policy.tolerance(&DECLARATION, "times"), running: Vec::new(), begun: 0 }
}

impl Calibration {
    fn procedure(&mut self, event: &Event, node: NodeId, told: &ProcedureEvent, context: &mut Context<'_>) {
        let is = |status: ProcedureStatus| told.status == status.name();
        if is(ProcedureStatus::Running) {
            return self.started(event, node, told, context);
        }
        self.running.retain(|running| running.node != node || running.name != told.procedure);
        let about = About::Name(told.procedure.as_str().into());
        context.close(Some(node), about.clone());
        let (severity, what) = if is(ProcedureStatus::Error) {
            (Severity::Error, "failed")
        } else if is(ProcedureStatus::Busy) {
            (Severity::Error, "not begun")
        } else if is(ProcedureStatus::Stopped) {
            (Severity::Note, "stopped")
        } else {
            return context.pass();
        };
        let alarm = context.fail(event).about(about).severity(severity);
        alarm.say(|| {
            let after = told.duration.map_or_else(String::new, |time| {
                #[expect(clippy::cast_precision_loss, reason = "a time to read")]
                let seconds = time as f64 / 1e9;
                format!(" after {seconds:.1} s")
            });
            let why = if told.text.is_empty() { String::new() } else { format!(": {}", told.text) };
            format!("{} {what}{after}{why}", told.procedure)
        });
    }

    fn started(&mut self, event: &Event, node: NodeId, told: &ProcedureEvent, context: &mut Context<'_>) {
        let (Some(nominal), true) = (told.nominal, told.step == "started" && context.has_time) else {
            return;
        };
        if self.running.len() >= RUNNING_LIMIT {
            return;
        }
        self.running.retain(|running| running.node != node || running.name != told.procedure);
        #[expect(clippy::cast_possible_truncation, reason = "saturates")]
        let time = (nominal * self.times * 1e9) as i64;
        let due = context.now.saturating_add(time);
        self.begun += 1;
        let (name, frame, number) = (told.procedure.clone(), event.frames.last, self.begun);
        self.running.push(Running { node, name, due, nominal, frame, number });
        context.wake_at(due, number);
    }
}

impl Rule for Calibration {
    fn event(&mut self, event: &Event, context: &mut Context<'_>) {
        let Some(node) = event.node else { return };
        match &event.kind {
            EventKind::Procedure(told) if told.word.as_deref() == Some(CALIBRATION) => {
                self.procedure(event, node, told, context);
            }
            EventKind::BootUp { .. } => self.running.retain(|running| running.node != node),
            _ => {}
        }
    }

    fn wake(&mut self, token: u64, context: &mut Context<'_>) {
        let Some(running) = self.running.iter().find(|running| running.number == token) else { return };
        let alarm = context.fail_at(running.due, Some(running.node), FrameRange::one(running.frame));
        let alarm =
            alarm.about(About::Name(running.name.as_str().into())).severity(Severity::Warning).ongoing();
        alarm.say(|| {
            let (name, nominal, limit) = (&running.name, running.nominal, running.nominal * self.times);
            format!("{name} shows no end within {limit:.0} s, it takes about {nominal:.0} s")
        });
    }
}
