//! Failed and unfinished calibrations.

use crate::event::{EmcyAction, Event, EventKind, FrameRange, Kind, ProcedureEvent, ProcedurePhase};
use crate::finding::{FindingSubject, Severity};
use crate::profile::device::ProcedureStatus;
use crate::rules::rule::{declare_rule, define_tolerance};
use crate::rules::{Rule, RuleContext, RulePolicy};
use crate::wire::NodeId;

declare_rule! {
    /// # What it checks
    /// A calibration fails, is stopped (a note), is interrupted by a restart, does not start because another one
    /// is running, or does not end within `times` × the nominal time. Only its status object proves the result,
    /// whenever it is read; a result that is never read is a note. An error status without a calibration in the
    /// capture is an earlier failure (a warning).
    ///
    /// # Why it matters
    /// The device continues with the old values, or with its default values.
    ///
    /// # Source
    /// Calibrations and their status codes: the device's manual.
    ///
    /// # What to look at first
    /// Check the preconditions of the calibration in the manual. Examples are motor, actuators and
    /// temperature. If the calibration does not end, check whether the controller reads the status.
    ///
    /// # Mutation
    /// respond to the upload of a calibration's status with an error code
    "calibration", Error, "calibration failed or unfinished",
    kinds: [Kind::Procedure, Kind::BootUp, Kind::Emcy],
    needs: "a procedure of the profile",
    word: "CALIB",
    tolerances: &[define_tolerance("times", 2.0, "", "maximum duration as a multiple of the nominal time, a warning")],
}

/// KIND word of calibration procedures.
const CALIBRATION: &str = "CALIB";

/// Maximum number of calibrations in progress per bus; further ones have no time limit.
const RUNNING_LIMIT: usize = 256;

struct RunningCalibration {
    node: NodeId,
    name: String,
    began: i64,
    due: i64,
    nominal: f64,
    frame: u64,
    number: u64,
    /// Text of its end with an unknown result; None while it runs.
    unread: Option<String>,
}

struct Calibration {
    times: f64,
    running: Vec<RunningCalibration>,
    begun: u64,
}

fn new(policy: &RulePolicy) -> Calibration {
    Calibration { times: policy.tolerance_value(&DECLARATION, "times"), running: Vec::new(), begun: 0 }
}

/// Duration in ns of a time in s.
#[expect(clippy::cast_possible_truncation, reason = "saturates")]
const fn to_nanoseconds(seconds: f64) -> i64 {
    (seconds * 1e9) as i64
}

/// Duration in ns as text.
fn duration_text(time: i64) -> String {
    #[expect(clippy::cast_precision_loss, reason = "a time to read")]
    let seconds = time as f64 / 1e9;
    format!(" after {seconds:.1} s")
}

impl Calibration {
    fn on_procedure(
        &mut self,
        event: &Event,
        node: NodeId,
        reported: &ProcedureEvent,
        context: &mut RuleContext<'_>,
    ) {
        let is = |status: ProcedureStatus| reported.status == status;
        if is(ProcedureStatus::Running) {
            return self.on_started(event, node, reported, context);
        }
        if is(ProcedureStatus::Ended) {
            return self.on_ended(node, reported, context);
        }
        self.running.retain(|running| running.node != node || running.name != reported.procedure);
        let about = FindingSubject::Name(reported.procedure.as_str().into());
        context.close_condition(Some(node), about.clone());
        let (severity, what) = if reported.phase == ProcedurePhase::FailedEarlier {
            (Severity::Warning, "failed before this capture")
        } else if is(ProcedureStatus::Error) {
            (Severity::Error, "failed")
        } else if is(ProcedureStatus::Busy) {
            (Severity::Error, "not started")
        } else if is(ProcedureStatus::Stopped) {
            (Severity::Note, "stopped")
        } else {
            return context.count_pass();
        };
        let alarm = context.start_finding(event).with_subject(about).with_severity(severity);
        alarm.report_finding(|| {
            let after = reported.duration.map_or_else(String::new, duration_text);
            let why = if reported.text.is_empty() { String::new() } else { format!(": {}", reported.text) };
            format!("{} {what}{after}{why}", reported.procedure)
        });
    }

    /// Waits for the status of a calibration that ended with an unknown result, at least its nominal time.
    fn on_ended(&mut self, node: NodeId, reported: &ProcedureEvent, context: &mut RuleContext<'_>) {
        context.close_condition(Some(node), FindingSubject::Name(reported.procedure.as_str().into()));
        let found = self
            .running
            .iter_mut()
            .find(|running| running.node == node && running.name == reported.procedure);
        let Some(running) = found else { return };
        self.begun += 1;
        running.number = self.begun;
        running.due = running.due.max(context.now.saturating_add(to_nanoseconds(running.nominal)));
        let after = reported.duration.map_or_else(String::new, duration_text);
        running.unread = Some(format!("{} ended{after}; {}", reported.procedure, reported.text));
        context.wake_at(running.due, running.number);
    }

    /// Reports calibrations that a restart interrupted.
    fn on_restart(&mut self, event: &Event, node: NodeId, context: &mut RuleContext<'_>) {
        let is_interrupted = |it: &RunningCalibration| it.node == node && it.unread.is_none();
        for running in self.running.iter().filter(|it| is_interrupted(it)) {
            let about = FindingSubject::Name(running.name.as_str().into());
            let time = context.now.saturating_sub(running.began);
            let alarm = context.start_finding(event).with_subject(about).with_severity(Severity::Warning);
            alarm.report_finding(|| {
                format!("{} interrupted by a restart{}", running.name, duration_text(time))
            });
        }
        self.running.retain(|it| !is_interrupted(it));
    }

    fn on_started(
        &mut self,
        event: &Event,
        node: NodeId,
        reported: &ProcedureEvent,
        context: &mut RuleContext<'_>,
    ) {
        let (Some(nominal), true) =
            (reported.nominal, reported.phase == ProcedurePhase::Started && context.has_time)
        else {
            return;
        };
        if self.running.len() >= RUNNING_LIMIT {
            return;
        }
        self.running.retain(|running| running.node != node || running.name != reported.procedure);
        let time = to_nanoseconds(nominal * self.times);
        let began = context.now;
        let due = began.saturating_add(time);
        self.begun += 1;
        let (name, frame, number) = (reported.procedure.clone(), event.frames.last, self.begun);
        let unread = None;
        self.running.push(RunningCalibration { node, name, began, due, nominal, frame, number, unread });
        context.wake_at(due, number);
    }
}

impl Rule for Calibration {
    fn on_event(&mut self, event: &Event, context: &mut RuleContext<'_>) {
        let Some(node) = event.node else { return };
        match &event.kind {
            EventKind::Procedure(reported) if reported.word.as_deref() == Some(CALIBRATION) => {
                self.on_procedure(event, node, reported, context);
            }
            EventKind::BootUp { .. } => self.on_restart(event, node, context),
            EventKind::Emcy(emergency) if emergency.action == EmcyAction::Ready => {
                self.on_restart(event, node, context);
            }
            _ => {}
        }
    }

    fn on_wake(&mut self, token: u64, context: &mut RuleContext<'_>) {
        let Some(running) = self.running.iter().find(|running| running.number == token) else { return };
        let since = context.timestamp_of(running.began);
        let alarm = context.fail_at(running.due, Some(running.node), FrameRange::one(running.frame));
        let severity = if running.unread.is_some() { Severity::Note } else { Severity::Warning };
        let alarm = alarm
            .with_subject(FindingSubject::Name(running.name.as_str().into()))
            .with_severity(severity)
            .started_at(since);
        alarm.report_finding(|| {
            if let Some(text) = &running.unread {
                return text.clone();
            }
            let (name, nominal, limit) = (&running.name, running.nominal, running.nominal * self.times);
            format!("{name} without end (limit {limit:.0} s, nominal {nominal:.0} s)")
        });
    }
}
