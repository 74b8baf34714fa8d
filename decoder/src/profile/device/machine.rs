//! State machines of a device.

use serde::Deserialize;
use strum::IntoStaticStr;

use super::network::TextList;
use crate::profile::object::{EntryRepetition, ONCE, VariantFilter};
use crate::profile::reference::ObjectReference;

/// State machine of a device, or of one of its channels.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct StateMachine {
    /// Name in output and in conditions.
    pub name: String,
    /// Repeats, one per channel.
    #[serde(default)]
    pub repeat: EntryRepetition,
    /// Status word that reports the state.
    pub status: MaskedWord,
    /// Control word that commands the state.
    pub control: MaskedWord,
    /// All states of the machine.
    pub states: Vec<StateDefinition>,
    /// Transitions caused by the control word.
    #[serde(default)]
    pub transitions: Vec<StateTransition>,
    /// A control word causes at most one transition.
    #[serde(default)]
    pub single_step: bool,
    /// Transitions with other causes.
    #[serde(default)]
    pub forced: Vec<ForcedTransition>,
    /// Variants it applies to; all if empty.
    #[serde(default)]
    pub only: VariantFilter,
    /// Assumption or defect of the manual.
    #[serde(default)]
    pub note: String,
    /// Section of the manual.
    #[serde(default)]
    pub source: String,
    /// Channel number; `None` without channels.
    #[serde(skip)]
    pub channel: Option<u8>,
}

/// Selected bits of a word.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct MaskedWord {
    /// Object that contains the word.
    pub object: ObjectReference,
    /// Bits to compare.
    pub mask: u64,
}

/// State of a machine.
#[derive(Debug, Clone, PartialEq, Eq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct StateDefinition {
    /// Name in output and in transitions.
    pub name: String,
    /// Value of the status word, reduced by the mask.
    pub value: u64,
    /// Bits to compare, if different from those of the machine.
    #[serde(default)]
    pub mask: Option<u64>,
    /// Whether it is a fault state.
    #[serde(default)]
    pub fault: bool,
    /// Whether set points take effect in this state.
    #[serde(default)]
    pub active: bool,
}

/// Transition caused by the control word.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct StateTransition {
    /// Possible start states.
    pub from: TextList,
    /// Target state.
    pub to: String,
    /// Bits of the control word to compare.
    pub mask: u64,
    /// Required value of these bits.
    pub value: u64,
    /// Bits that need a 0→1 edge.
    #[serde(default)]
    pub edge: u64,
    /// The device may first slow down, so the transition has no time limit.
    #[serde(default)]
    pub slow: bool,
    /// Instruction to the user, if not obvious.
    #[serde(default)]
    pub text: Option<String>,
}

/// Cause of a transition that is neither a command nor an EMCY.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize, IntoStaticStr)]
#[serde(rename_all = "kebab-case")]
#[strum(serialize_all = "kebab-case")]
pub enum ForcingEvent {
    /// Life guarding expired.
    LifeGuard,
    /// The node booted.
    BootUp,
}

impl ForcingEvent {
    /// The name in profiles.
    pub fn name(self) -> &'static str {
        self.into()
    }
}

/// Transition with a cause other than the control word.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ForcedTransition {
    /// NMT command that causes it.
    #[serde(default)]
    pub nmt: Option<String>,
    /// EMCY that causes it: `true` for any code except 0000, or codes.
    #[serde(default)]
    pub emcy: Option<EmcyCodes>,
    /// Other cause.
    #[serde(default)]
    pub event: Option<ForcingEvent>,
    /// Possible start states; any if empty.
    #[serde(default)]
    pub from: TextList,
    /// Target state.
    pub to: String,
}

/// Selection of EMCY codes.
#[derive(Debug, Clone, PartialEq, Eq, Deserialize)]
#[serde(untagged, expecting = "expected true, a code or a list of codes")]
pub enum EmcyCodes {
    /// Any code except 0000.
    Any(bool),
    /// A single code.
    One(u16),
    /// Several codes.
    List(Vec<u16>),
}

impl EmcyCodes {
    /// Whether the selection contains a code.
    pub fn contains(&self, code: u16) -> bool {
        match self {
            Self::Any(any) => *any && code != 0,
            Self::One(one) => *one == code,
            Self::List(list) => list.contains(&code),
        }
    }
}

impl StateMachine {
    /// State that a status word reports.
    pub fn reported_state(&self, status: u64) -> Option<&StateDefinition> {
        self.states.iter().find(|state| {
            let mask = state.mask.unwrap_or(self.status.mask);
            status & mask == state.value & mask
        })
    }

    /// Copy for repeat `nth`.
    pub(super) fn pin_repeat(&self, nth: u16) -> Self {
        let mut machine = self.clone();
        let stride = self.repeat.stride;
        machine.status.object = self.status.object.pin_repeat(nth, stride);
        machine.control.object = self.control.object.pin_repeat(nth, stride);
        machine.channel = self.repeat.channel_number(nth);
        machine.repeat = ONCE;
        machine
    }
}

impl EntryRepetition {
    /// Channel number of repeat `nth`; `None` if the repeats are not channels.
    pub fn channel_number(&self, nth: u16) -> Option<u8> {
        self.channel.then(|| u8::try_from(self.first.saturating_add(nth)).ok()).flatten()
    }
}
