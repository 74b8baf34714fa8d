//! Gates: conditions for set points to take effect.

use serde::Deserialize;

use super::condition::DeviceConditions;
use crate::profile::layout::PdoName;
use crate::profile::object::{EntryRepetition, ONCE, VariantFilter};
use crate::profile::reference::ObjectReference;

/// Condition for set points to take effect.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Gate {
    /// Set points it applies to; all if empty.
    #[serde(default, rename = "for")]
    pub of: Vec<ObjectReference>,
    /// Repeats, one per channel.
    #[serde(default)]
    pub repeat: EntryRepetition,
    /// Name printed while the gate is closed.
    pub name: String,
    /// Conditions under which it is open.
    pub open: DeviceConditions,
    /// Explanation of a closed gate for the user.
    #[serde(default)]
    pub text: String,
    /// Recommended action.
    #[serde(default)]
    pub check: String,
    /// PDO in which the set point must arrive for the gate to apply; `None` for any.
    #[serde(default)]
    pub pdo: Option<PdoName>,
    /// Meaning of unmet conditions.
    #[serde(default)]
    pub otherwise: GateFallback,
    /// Set points that the gate closes, if not all those in `of`.
    #[serde(default)]
    pub closes: Vec<ObjectReference>,
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

/// Meaning of an unmet gate condition.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum GateFallback {
    /// The gate is closed.
    #[default]
    Closed,
    /// The status of the gate is unknown.
    Unknown,
}

impl Gate {
    /// Whether the gate applies to a set point.
    pub fn is_for(&self, set_point: crate::wire::canopen::ObjectAddress, channel: Option<u8>) -> bool {
        if !self.closes.is_empty() {
            return self.closes.iter().any(|of| of.object == set_point);
        }
        if !self.of.is_empty() {
            return self.of.iter().any(|of| of.object == set_point);
        }
        self.channel.is_none() || self.channel == channel
    }

    pub(super) fn pin_repeat(&self, nth: u16) -> Self {
        let stride = self.repeat.stride;
        let all = |list: &[ObjectReference]| list.iter().map(|of| of.pin_repeat(nth, stride)).collect();
        Self {
            of: all(&self.of),
            closes: all(&self.closes),
            open: DeviceConditions(self.open.0.iter().map(|open| open.pin_repeat(nth, stride)).collect()),
            channel: self.repeat.channel_number(nth),
            repeat: ONCE,
            ..self.clone()
        }
    }
}
