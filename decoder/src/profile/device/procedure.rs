//! Procedures: device functions with a start and an end, such as a calibration.

use serde::Deserialize;

use super::condition::{DeviceCondition, ProfileTrigger};
use crate::profile::object::{EntryRepetition, ONCE, VariantFilter, WriteEffect};
use crate::profile::reference::{ObjectRange, ObjectReference};

/// Device function with a start and an end.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct DeviceProcedure {
    /// Name; `{n}` is replaced by the repeat number.
    pub name: String,
    /// KIND column of its event lines.
    #[serde(default)]
    pub word: Option<String>,
    /// Repeats with consecutive objects.
    #[serde(default)]
    pub repeat: EntryRepetition,
    /// Trigger that starts it.
    pub start: ProfileTrigger,
    /// Source of its status.
    #[serde(default)]
    pub status: Option<StatusSpec>,
    /// Object that contains the result.
    #[serde(default)]
    pub result: Option<ObjectReference>,
    /// Nominal duration in s.
    #[serde(default)]
    pub seconds: Option<f64>,
    /// Whether the device ignores set points from the bus while it runs.
    #[serde(default)]
    pub takes_over: bool,
    /// Trigger that stops it.
    #[serde(default)]
    pub stop: Option<ProfileTrigger>,
    /// Trigger that ends it with an unknown outcome.
    #[serde(default)]
    pub also_end: Option<ProfileTrigger>,
    /// Trigger that ends it with success.
    #[serde(default)]
    pub end: Option<ProfileTrigger>,
    /// Intermediate steps.
    #[serde(default)]
    pub steps: Vec<ProcedureStep>,
    /// Whether the confirmation of the start is also its end.
    #[serde(default)]
    pub instant: bool,
    /// Restart at which the result takes effect; until then it is unknown.
    #[serde(default)]
    pub effect: WriteEffect,
    /// Objects whose values it changes.
    #[serde(default)]
    pub invalidates: Vec<ObjectRange>,
    /// Values that the device restores after a failure.
    #[serde(default)]
    pub on_error: Vec<FallbackValue>,
    /// Preconditions that are visible on the bus.
    #[serde(default)]
    pub needs: Vec<DeviceCondition>,
    /// Preconditions that are not visible on the bus.
    #[serde(default)]
    pub checks: Vec<String>,
    /// Variants it applies to; all if empty.
    #[serde(default)]
    pub only: VariantFilter,
    /// Assumption or defect of the manual.
    #[serde(default)]
    pub note: String,
    /// Section of the manual.
    #[serde(default)]
    pub source: String,
}

/// Object and code table of a status.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct StatusSpec {
    /// Status object.
    pub object: ObjectReference,
    /// Name of a `[codes.NAME]` table.
    pub codes: String,
}

/// Intermediate step of a procedure.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ProcedureStep {
    /// Trigger of the step.
    pub on: ProfileTrigger,
    /// Name of the step in output.
    pub step: String,
}

/// Value that an object is reset to.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct FallbackValue {
    /// Object that changes.
    pub object: ObjectReference,
    /// New raw value.
    pub becomes: i64,
}

/// Table of status numbers.
#[derive(Debug, Clone, Default, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct StatusCodes {
    /// Codes in order of precedence.
    pub list: Vec<StatusCode>,
}

/// Meaning of one status number.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct StatusCode {
    /// Status number.
    pub code: u64,
    /// Bits to compare.
    #[serde(default = "all")]
    pub mask: u64,
    /// Status of the procedure.
    pub outcome: ProcedureStatus,
    /// Explanation for the user.
    #[serde(default)]
    pub text: String,
}

const fn all() -> u64 {
    u64::MAX
}

/// Status of a procedure.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum ProcedureStatus {
    /// In progress.
    Running,
    /// Finished with success.
    Ok,
    /// Not started: another procedure is running.
    Busy,
    /// Stopped on request.
    Stopped,
    /// Failed.
    Error,
    /// Ended with an unknown outcome.
    Ended,
}

impl ProcedureStatus {
    /// Name in all output.
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
    /// First code that matches a status number.
    pub fn find_code(&self, number: u64) -> Option<&StatusCode> {
        self.list.iter().find(|code| number & code.mask == code.code & code.mask)
    }
}

impl DeviceProcedure {
    /// All triggers of the procedure.
    pub(crate) fn all_triggers(&self) -> impl Iterator<Item = &ProfileTrigger> {
        let ends = [Some(&self.start), self.stop.as_ref(), self.end.as_ref(), self.also_end.as_ref()];
        ends.into_iter().flatten().chain(self.steps.iter().map(|step| &step.on))
    }

    pub(super) fn pin_repeat(&self, nth: u16) -> Self {
        let stride = self.repeat.stride;
        let trigger =
            |trigger: &Option<ProfileTrigger>| trigger.as_ref().map(|it| it.pin_repeat(nth, stride));
        let number = self.repeat.first.saturating_add(nth).to_string();
        Self {
            name: self.name.replace("{n}", &number),
            start: self.start.pin_repeat(nth, stride),
            stop: trigger(&self.stop),
            end: trigger(&self.end),
            also_end: trigger(&self.also_end),
            status: self.status.as_ref().map(|status| StatusSpec {
                object: status.object.pin_repeat(nth, stride),
                codes: status.codes.clone(),
            }),
            result: self.result.map(|result| result.pin_repeat(nth, stride)),
            steps: self
                .steps
                .iter()
                .map(|step| ProcedureStep { on: step.on.pin_repeat(nth, stride), step: step.step.clone() })
                .collect(),
            invalidates: self.invalidates.iter().map(|range| range.pin_repeat(nth, stride)).collect(),
            on_error: self
                .on_error
                .iter()
                .map(|fall| FallbackValue {
                    object: fall.object.pin_repeat(nth, stride),
                    becomes: fall.becomes,
                })
                .collect(),
            needs: self.needs.iter().map(|need| need.pin_repeat(nth, stride)).collect(),
            repeat: ONCE,
            ..self.clone()
        }
    }
}
