//! Procedures: what a device does that begins and ends.

use serde::Deserialize;

use super::condition::{Condition, Trigger};
use crate::profile::object::{ONCE, Only, Repeat};
use crate::profile::reference::{ObjectRange, Reference};

/// Something with a begin and an end.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Procedure {
    /// Name.
    pub name: String,
    /// KIND of its lines.
    #[serde(default)]
    pub word: Option<String>,
    /// Several alike.
    #[serde(default)]
    pub repeat: Repeat,
    /// What starts it.
    pub start: Trigger,
    /// Where its status can be read.
    #[serde(default)]
    pub status: Option<StatusSpec>,
    /// Where the outcome stands.
    #[serde(default)]
    pub result: Option<Reference>,
    /// Nominal duration.
    #[serde(default)]
    pub seconds: Option<f64>,
    /// Set points of the bus are ignored meanwhile.
    #[serde(default)]
    pub takes_over: bool,
    /// What stops it.
    #[serde(default)]
    pub stop: Option<Trigger>,
    /// A sign that it ended, though not how.
    #[serde(default)]
    pub also_end: Option<Trigger>,
    /// What ends it well.
    #[serde(default)]
    pub end: Option<Trigger>,
    /// What happens on the way.
    #[serde(default)]
    pub steps: Vec<Step>,
    /// The confirmation of the start is its end.
    #[serde(default)]
    pub instant: bool,
    /// Objects it changes.
    #[serde(default)]
    pub invalidates: Vec<ObjectRange>,
    /// Values the device falls back to when it fails.
    #[serde(default)]
    pub on_error: Vec<Fallback>,
    /// Preconditions the bus can show.
    #[serde(default)]
    pub needs: Vec<Condition>,
    /// Preconditions it cannot.
    #[serde(default)]
    pub checks: Vec<String>,
    /// Variants it belongs to.
    #[serde(default)]
    pub only: Only,
    /// Assumption or defect of the manual.
    #[serde(default)]
    pub note: String,
    /// Section.
    #[serde(default)]
    pub source: String,
}

/// Where a status can be read, and what its numbers mean.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct StatusSpec {
    /// The object.
    pub object: Reference,
    /// Name of a `[codes.NAME]` table.
    pub codes: String,
}

/// A step on the way.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Step {
    /// When.
    pub on: Trigger,
    /// Name.
    pub step: String,
}

/// A value an object falls back to.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Fallback {
    /// The object.
    pub object: Reference,
    /// Its raw value then.
    pub becomes: i64,
}

/// What numbers of a status mean.
#[derive(Debug, Clone, Default, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct StatusCodes {
    /// First match wins.
    pub list: Vec<StatusCode>,
}

/// One of them.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct StatusCode {
    /// The number.
    pub code: u64,
    /// Bits that count.
    #[serde(default = "all")]
    pub mask: u64,
    /// What it says of the procedure.
    pub outcome: ProcedureStatus,
    /// For the reader.
    #[serde(default)]
    pub text: String,
}

const fn all() -> u64 {
    u64::MAX
}

/// How a procedure stands.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum ProcedureStatus {
    /// Goes on.
    Running,
    /// Finished well.
    Ok,
    /// Not begun: another one runs.
    Busy,
    /// Stopped by the user.
    Stopped,
    /// Failed.
    Error,
    /// Ended, but how was not seen.
    Ended,
}

impl ProcedureStatus {
    /// The name used in all output.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Running => "running",
            Self::Ok => "ok",
            Self::Busy => "busy",
            Self::Stopped => "stopped",
            Self::Error => "error",
            Self::Ended => "ended",
        }
    }
}

impl StatusCodes {
    /// What a number says.
    pub fn find(&self, number: u64) -> Option<&StatusCode> {
        self.list.iter().find(|code| number & code.mask == code.code & code.mask)
    }
}

impl Procedure {
    /// All it waits for.
    pub(crate) fn triggers(&self) -> impl Iterator<Item = &Trigger> {
        let ends = [Some(&self.start), self.stop.as_ref(), self.end.as_ref(), self.also_end.as_ref()];
        ends.into_iter().flatten().chain(self.steps.iter().map(|step| &step.on))
    }

    pub(super) fn pinned(&self, nth: u16) -> Self {
        let stride = self.repeat.stride;
        let trigger = |trigger: &Option<Trigger>| trigger.as_ref().map(|it| it.pinned(nth, stride));
        let number = self.repeat.first.saturating_add(nth).to_string();
        Self {
            name: self.name.replace("{n}", &number),
            start: self.start.pinned(nth, stride),
            stop: trigger(&self.stop),
            end: trigger(&self.end),
            also_end: trigger(&self.also_end),
            status: self.status.as_ref().map(|status| StatusSpec {
                object: status.object.pinned(nth, stride),
                codes: status.codes.clone(),
            }),
            result: self.result.map(|result| result.pinned(nth, stride)),
            steps: self
                .steps
                .iter()
                .map(|step| Step { on: step.on.pinned(nth, stride), step: step.step.clone() })
                .collect(),
            invalidates: self.invalidates.iter().map(|range| range.pinned(nth, stride)).collect(),
            on_error: self
                .on_error
                .iter()
                .map(|fall| Fallback { object: fall.object.pinned(nth, stride), becomes: fall.becomes })
                .collect(),
            needs: self.needs.iter().map(|need| need.pinned(nth, stride)).collect(),
            repeat: ONCE,
            ..self.clone()
        }
    }
}
