//! What a capture can violate of a manual, and which general rules a device need not obey.

use serde::Deserialize;

use super::condition::{Conditions, Trigger};
use crate::profile::object::{Numbers, Only};
use crate::profile::reference::Reference;

/// A statement of the manual that a capture can violate.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct DeviceRule {
    /// Name in kebab-case; printed behind the profile's id.
    pub name: String,
    /// How bad.
    pub severity: Severity,
    /// What kind of statement; the keys below belong to some.
    pub kind: RuleKind,
    /// For the reader.
    pub text: String,
    /// What it is about.
    #[serde(default)]
    pub on: Option<Trigger>,
    /// What must follow.
    #[serde(default)]
    pub then: Option<Trigger>,
    /// What must have been before.
    #[serde(default)]
    pub before: Option<Trigger>,
    /// Object of a limit.
    #[serde(default)]
    pub object: Option<Reference>,
    /// Objects whose values rise.
    #[serde(default)]
    pub objects: Vec<Reference>,
    /// Permitted raw values.
    #[serde(default)]
    pub range: Option<[i64; 2]>,
    /// Permitted values in the object's unit.
    #[serde(default)]
    pub limits: Option<[f64; 2]>,
    /// Forbidden raw values.
    #[serde(default)]
    pub values: Option<Numbers>,
    /// Milliseconds.
    #[serde(default)]
    pub ms: Option<f64>,
    /// How many.
    #[serde(default)]
    pub count: Option<u32>,
    /// `sync` or seconds.
    #[serde(default)]
    pub per: Option<Per>,
    /// What must hold.
    #[serde(default)]
    pub needs: Conditions,
    /// Only while this holds.
    #[serde(default, rename = "while")]
    pub during: Conditions,
    /// First and last identifier.
    #[serde(default)]
    pub ids: Option<[u32; 2]>,
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

/// How bad.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Severity {
    /// For information.
    Note,
    /// Should be looked at.
    Warning,
    /// Wrong.
    Error,
}

impl Severity {
    /// One step less.
    #[must_use]
    pub const fn lowered(self) -> Self {
        match self {
            Self::Error => Self::Warning,
            Self::Warning | Self::Note => Self::Note,
        }
    }

    /// The name used in all output.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Note => "note",
            Self::Warning => "warning",
            Self::Error => "error",
        }
    }
}

/// Kinds of statement.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum RuleKind {
    /// An object stays inside.
    Limit,
    /// Values that are not written.
    Forbidden,
    /// Not more often.
    MinInterval,
    /// Not more rarely.
    MaxInterval,
    /// At most so many.
    MaxCount,
    /// Only when conditions hold.
    Precondition,
    /// Something follows in time.
    Follow,
    /// Something was there first.
    Order,
    /// Values rise.
    Ascending,
    /// Identifiers others must not use.
    ReservedId,
}

/// What `count` counts in.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(untagged, expecting = "\"sync\" or seconds")]
pub enum Per {
    /// A number of seconds.
    Seconds(f64),
    /// `sync`: between two SYNCs.
    Word(String),
}

impl DeviceRule {
    /// A key its kind needs and does not have.
    pub fn missing(&self) -> Option<&'static str> {
        let limit = self.object.is_some() && (self.range.is_some() || self.limits.is_some());
        let (there, what) = match self.kind {
            RuleKind::Limit => (limit, "object, and range or limits"),
            RuleKind::Forbidden => (self.object.is_some() && self.values.is_some(), "object and values"),
            RuleKind::MinInterval | RuleKind::MaxInterval => {
                (self.on.is_some() && self.ms.is_some(), "on and ms")
            }
            RuleKind::MaxCount => {
                (self.on.is_some() && self.count.is_some() && self.per.is_some(), "on, count and per")
            }
            RuleKind::Precondition => (self.on.is_some() && !self.needs.0.is_empty(), "on and needs"),
            RuleKind::Follow => {
                (self.on.is_some() && self.then.is_some() && self.ms.is_some(), "on, then and ms")
            }
            RuleKind::Order => (self.on.is_some() && self.before.is_some(), "on and before"),
            RuleKind::Ascending => (self.objects.len() > 1, "two objects or more"),
            RuleKind::ReservedId => {
                (self.ids.is_some_and(|[first, last]| first <= last), "ids, first to last")
            }
        };
        (!there).then_some(what)
    }
}

/// A general rule the device need not obey.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Waiver {
    /// Name of the rule.
    pub rule: String,
    /// Why.
    pub text: String,
    /// Variants it belongs to.
    #[serde(default)]
    pub only: Only,
    /// Section.
    #[serde(default)]
    pub source: String,
}
