//! Gates: conditions for set points to act.

use serde::Deserialize;

use super::condition::Conditions;
use crate::profile::layout::PdoName;
use crate::profile::object::{ONCE, Only, Repeat};
use crate::profile::reference::Reference;

/// A condition for set points to act.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Gate {
    /// Set points; all if empty.
    #[serde(default, rename = "for")]
    pub of: Vec<Reference>,
    /// One a channel.
    #[serde(default)]
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
