//! State machines of a device.

use serde::Deserialize;

use super::network::Words;
use crate::profile::object::{ONCE, Only, Repeat};
use crate::profile::reference::Reference;

/// A state machine of a device, or of each of its channels.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Machine {
    /// Name.
    pub name: String,
    /// One a channel.
    #[serde(default)]
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
