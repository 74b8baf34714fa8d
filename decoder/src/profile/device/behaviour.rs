//! What a device does: PDOs, state machine, gates, procedures.

use serde::Deserialize;

use super::condition::{Condition, Conditions, Trigger};
use super::network::Words;
use crate::profile::layout::PdoName;
use crate::profile::object::{ONCE, Only, Repeat, When};
use crate::profile::reference::{ObjectRange, Reference};

/// A PDO of the device.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PdoSpec {
    /// Which.
    pub pdo: PdoName,
    /// What decides its contents.
    pub mapping: Mapping,
    /// What makes the device send it.
    #[serde(default)]
    pub trigger: Option<String>,
    /// When an RPDO acts.
    #[serde(default)]
    pub effect: PdoEffect,
    /// Contents, from bit 0 of byte 0.
    #[serde(default)]
    pub fields: Vec<PdoField>,
    /// Only with this value of an object.
    #[serde(default)]
    pub when: Option<When>,
    /// Identifier, where it is not that of the predefined connection set.
    #[serde(default)]
    pub cob_id: Option<String>,
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

/// What decides a PDO's contents.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Mapping {
    /// Never changes.
    Fixed,
    /// As delivered, until the bus shows another.
    Default,
    /// Set by the maker's tool: only the bus file can tell.
    BusFile,
}

/// When an RPDO acts.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum PdoEffect {
    /// As its transmission type says (14xx:02), at once if that is not known.
    #[default]
    ByType,
    /// At the next SYNC with the node's own identifier.
    AtSync,
    /// At once.
    AtOnce,
}

/// A part of a PDO.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PdoField {
    /// Object; none: room without meaning.
    #[serde(default)]
    pub object: Option<Reference>,
    /// Width.
    pub bits: u16,
    /// What room without meaning always holds.
    #[serde(default)]
    pub constant: Option<u64>,
}

/// A state machine of a device, or of each of its channels.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Machine {
    /// Name.
    pub name: String,
    /// One a channel.
    #[serde(default = "once")]
    pub repeat: Repeat,
    /// Word the device reports its state in.
    pub status: Masked,
    /// Word that commands it.
    pub control: Masked,
    /// States.
    pub states: Vec<State>,
    /// How control bits move it.
    #[serde(default)]
    pub transitions: Vec<Transition>,
    /// What else moves it.
    #[serde(default)]
    pub forced: Vec<Forced>,
    /// Variants it belongs to.
    #[serde(default)]
    pub only: Only,
    /// Assumption or defect of the manual.
    #[serde(default)]
    pub note: String,
    /// Section.
    #[serde(default)]
    pub source: String,
    /// Number of the channel, where there are several.
    #[serde(skip)]
    pub channel: Option<u8>,
}

const fn once() -> Repeat {
    ONCE
}

/// A word of which some bits count.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Masked {
    /// The object.
    pub object: Reference,
    /// Bits that count.
    pub mask: u64,
}

/// A state.
#[derive(Debug, Clone, PartialEq, Eq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct State {
    /// Name.
    pub name: String,
    /// Bits of the status word.
    pub value: u64,
    /// Bits that count, where not those of the machine.
    #[serde(default)]
    pub mask: Option<u64>,
    /// A fault.
    #[serde(default)]
    pub fault: bool,
    /// Set points act.
    #[serde(default)]
    pub active: bool,
}

/// How control bits move the machine.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Transition {
    /// From one of these.
    pub from: Words,
    /// To.
    pub to: String,
    /// Bits of the control word that count.
    pub mask: u64,
    /// What they must be.
    pub value: u64,
    /// Bits that must go from 0 to 1.
    #[serde(default)]
    pub edge: u64,
    /// What to do, where that is not obvious.
    #[serde(default)]
    pub text: Option<String>,
}

/// What moves the machine besides the control word.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Forced {
    /// An NMT command.
    #[serde(default)]
    pub nmt: Option<String>,
    /// An EMCY: `true` for any but 0000, or codes.
    #[serde(default)]
    pub emcy: Option<EmcyCodes>,
    /// `life-guard` or `boot-up`.
    #[serde(default)]
    pub event: Option<String>,
    /// Only from these states.
    #[serde(default)]
    pub from: Words,
    /// To.
    pub to: String,
}

/// Which EMCY codes.
#[derive(Debug, Clone, PartialEq, Eq, Deserialize)]
#[serde(untagged, expecting = "true, a code or a list of codes")]
pub enum EmcyCodes {
    /// Any but 0000.
    Any(bool),
    /// One.
    One(u16),
    /// These.
    List(Vec<u16>),
}

impl EmcyCodes {
    /// Whether a code is meant.
    pub fn contains(&self, code: u16) -> bool {
        match self {
            Self::Any(any) => *any && code != 0,
            Self::One(one) => *one == code,
            Self::List(list) => list.contains(&code),
        }
    }
}

impl Machine {
    /// The state a status word shows.
    pub fn state(&self, status: u64) -> Option<&State> {
        self.states.iter().find(|state| {
            let mask = state.mask.unwrap_or(self.status.mask);
            status & mask == state.value & mask
        })
    }

    /// The same for one channel.
    pub(super) fn pinned(&self, nth: u16) -> Self {
        let mut machine = self.clone();
        let stride = self.repeat.stride;
        machine.status.object = self.status.object.pinned(nth, stride);
        machine.control.object = self.control.object.pinned(nth, stride);
        machine.channel = self.repeat.number(nth);
        machine.repeat = ONCE;
        machine
    }
}

impl Repeat {
    /// Number of a repeat's channel, where it counts channels.
    pub fn number(&self, nth: u16) -> Option<u8> {
        self.channel.then(|| u8::try_from(self.first.saturating_add(nth)).ok()).flatten()
    }
}

/// A condition for set points to act.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Gate {
    /// Set points; all if empty.
    #[serde(default, rename = "for")]
    pub of: Vec<Reference>,
    /// One a channel.
    #[serde(default = "once")]
    pub repeat: Repeat,
    /// What is printed when it is closed.
    pub name: String,
    /// When it is open.
    pub open: Conditions,
    /// For the reader: what a closed gate means.
    #[serde(default)]
    pub text: String,
    /// What to do about it.
    #[serde(default)]
    pub check: String,
    /// Only for set points that came by this PDO.
    #[serde(default)]
    pub pdo: Option<PdoName>,
    /// `unknown`: not met does not mean closed.
    #[serde(default)]
    pub otherwise: Otherwise,
    /// Set points it closes, where not all of `for`.
    #[serde(default)]
    pub closes: Vec<Reference>,
    /// Variants it belongs to.
    #[serde(default)]
    pub only: Only,
    /// Assumption or defect of the manual.
    #[serde(default)]
    pub note: String,
    /// Section.
    #[serde(default)]
    pub source: String,
    /// Number of the channel, where there are several.
    #[serde(skip)]
    pub channel: Option<u8>,
}

/// What a condition that is not met means.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Otherwise {
    /// The gate is closed.
    #[default]
    Closed,
    /// Nothing certain.
    Unknown,
}

impl Gate {
    /// Whether it concerns a set point.
    pub fn concerns(&self, set_point: crate::wire::canopen::ObjectAddress, channel: Option<u8>) -> bool {
        if !self.closes.is_empty() {
            return self.closes.iter().any(|of| of.object == set_point);
        }
        if !self.of.is_empty() {
            return self.of.iter().any(|of| of.object == set_point);
        }
        self.channel.is_none() || self.channel == channel
    }

    pub(super) fn pinned(&self, nth: u16) -> Self {
        let stride = self.repeat.stride;
        let all = |list: &[Reference]| list.iter().map(|of| of.pinned(nth, stride)).collect();
        Self {
            of: all(&self.of),
            closes: all(&self.closes),
            open: Conditions(self.open.0.iter().map(|open| open.pinned(nth, stride)).collect()),
            channel: self.repeat.number(nth),
            repeat: ONCE,
            ..self.clone()
        }
    }
}

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
    #[serde(default = "once")]
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
    pub fn triggers(&self) -> impl Iterator<Item = &Trigger> {
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
