//! What a capture can violate of a manual, and which general rules a device need not obey.
//!
//! What holds for all kinds:
//! - A rule is judged for each node with the profile by itself; with `repeat` for each channel by itself.
//! - With `while` it is judged only while all of those conditions are proven. What is unknown proves nothing:
//!   an object that was not seen, one known only as delivered, an NMT state that is only presumed, a state on its
//!   way. An object of role `actual` counts for two seconds after the frame that brought it.
//! - A list of triggers in `on` is judged one by one; of those in `before`, `since`, `after` and `then` one is enough.
//! - In `on` a write by SDO happens at the server's answer, confirmed or refused: the attempt is what the manual
//!   speaks of. In all other places only a confirmed one counts. A write without an answer counts nowhere.
//! - Conditions are those just before `on` took effect; objects in the same PDO or message count as it brings them.
//! - Times are compared with the granularity of the capture's stamps in the rule's favour, and not at all where
//!   the capture's times are of no use. `limits` have a tolerance of a thousandth of their span, `range` has none.
//! - A PDO comes with the identifier in force. While that is only assumed, absence of the PDO proves nothing.
//! - What never started a rule, or never proved its `while`, leaves it *not exercised*.

use serde::Deserialize;
use toml::Spanned;

use super::condition::{Conditions, Triggers};
use crate::profile::object::{Numbers, ONCE, Only, Repeat};
use crate::profile::reference::{ObjectRange, Reference};

/// A statement of the manual that a capture can violate.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct DeviceRule {
    /// Name in kebab-case; printed behind the profile's id.
    pub name: String,
    /// One a channel, or several alike; references move along. With `channel` a state is that of the channel.
    #[serde(default)]
    pub repeat: Repeat,
    /// How bad.
    pub severity: Severity,
    /// What kind of statement; the keys below belong to some.
    pub kind: RuleKind,
    /// For the reader.
    pub text: String,
    /// What it is about.
    #[serde(default)]
    pub on: Triggers,
    /// What must follow.
    #[serde(default)]
    pub then: Triggers,
    /// What must have been before.
    #[serde(default)]
    pub before: Triggers,
    /// What makes an earlier `before` void; the node's start if none is named.
    #[serde(default)]
    pub since: Triggers,
    /// What `ms` is counted from, where not from the `on` before.
    #[serde(default)]
    pub after: Triggers,
    /// Object of a limit.
    #[serde(default)]
    pub object: Option<Reference>,
    /// Objects of a limit, or those whose values rise.
    #[serde(default)]
    pub objects: Vec<Reference>,
    /// Permitted raw values.
    #[serde(default)]
    pub range: Option<[i64; 2]>,
    /// Permitted values in the object's unit.
    #[serde(default)]
    pub limits: Option<[f64; 2]>,
    /// Raw values that are forbidden or permitted.
    #[serde(default)]
    pub values: Option<Numbers>,
    /// Permitted raw values are multiples of it.
    #[serde(default)]
    pub step: Option<u32>,
    /// Values of neighbours may be equal.
    #[serde(default)]
    pub or_equal: bool,
    /// Milliseconds.
    #[serde(default)]
    pub ms: Option<f64>,
    /// Object whose scaled value is the milliseconds; unknown or 0: not judged.
    #[serde(default)]
    pub ms_of: Option<Reference>,
    /// So many times the value of `ms_of`.
    #[serde(default = "one_time")]
    pub times: f64,
    /// How many.
    #[serde(default)]
    pub count: Option<u32>,
    /// `sync`, `while` or seconds.
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
    /// What frames on `ids` may be.
    #[serde(default)]
    pub shape: Option<Shape>,
    /// Objects the statement does not hold for.
    #[serde(default)]
    pub except: Vec<ObjectRange>,
    /// Rules of this profile, or else general ones, whose findings of the same node have the same cause and belong
    /// under a finding of this one.
    #[serde(default)]
    pub takes_in: Vec<String>,
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

const fn one_time() -> f64 {
    1.0
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
    pub(crate) const fn lowered(self) -> Self {
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
    /// The objects stay inside `range` or `limits`: each value that comes by PDO, message, upload or download (also
    /// a refused one) is judged, special values (`special`) apart. A scale that is only assumed leaves `limits`
    /// unjudged.
    Limit,
    /// None of `values` comes to the objects: each download, also a refused one, and each PDO or message that carries
    /// them to the device is judged. Uploads are not.
    Forbidden,
    /// Nothing but `values`, or multiples of `step`, comes to the objects; as `Forbidden` otherwise.
    Permitted,
    /// `on` does not happen. Without `while` it is exercised by the device's presence.
    Never,
    /// `on` comes at least `ms` after the `on` before, or, with `after`, after the latest of those. The first `on` of
    /// a node's life, and the first since the bus was silent, are not judged.
    MinInterval,
    /// `on` comes at most `ms` after the `on` before. The wait begins with the first `on`; where there is a `while`,
    /// already when that comes to hold, and it ends when that ceases. One finding a gap, at its end.
    MaxInterval,
    /// At most `count` of `on` between two SYNCs with the node's own identifier (`per = "sync"`), in one stretch of
    /// `while` that nothing interrupts (`"while"`), or in any so many seconds.
    MaxCount,
    /// When `on` happens, all of `needs` hold. Fires only where one of them is proven not to.
    Precondition,
    /// After `on`, `then` comes within `ms`. A further `on` before that begins anew; a `while` that ceases, a restart
    /// of the node and the end of the capture withdraw it.
    Follow,
    /// `on` comes only after `before`. `since` makes an earlier `before` void. Judged from the first `since` in the
    /// capture on: what was before that is not known.
    Order,
    /// The values of `objects` rise from each to the next. Judged when `on` happens; without `on` one second after the
    /// last write to one of them. Fires where two neighbours that were both seen do not rise.
    Ascending,
    /// Identifiers `ids` belong to the device and its tools. Fires on each bus with such a device for an owner of
    /// another kind (identifier learnt on the wire, bus file, device file), and for a data frame that has not `shape`.
    ReservedId,
    /// SDO transfers are expedited, apart from those of `except`: segmented and block transfers of other objects, also
    /// refused ones, are findings.
    Expedited,
    /// A remote frame that asks for a TPDO of the device carries the length of that PDO.
    RemoteLength,
}

/// What `count` counts in.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(untagged, expecting = "\"sync\", \"while\" or seconds")]
pub enum Per {
    /// A number of seconds.
    Seconds(f64),
    /// A stretch.
    Stretch(Stretch),
}

/// Stretches of time without a fixed length.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Stretch {
    /// Between two SYNCs.
    Sync,
    /// While the conditions of `while` hold without a break.
    While,
}

/// What a frame may be.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Shape {
    /// Eight bytes, the first a command specifier of SDO.
    Sdo,
}

impl DeviceRule {
    /// A key its kind needs and does not have.
    pub fn missing(&self) -> Option<&'static str> {
        let on = !self.on.0.is_empty();
        let object = self.subjects().next().is_some();
        let time = self.ms.is_some() != self.ms_of.is_some();
        let (there, what) = match self.kind {
            RuleKind::Limit => {
                (object && self.range.is_some() != self.limits.is_some(), "object, and range or limits")
            }
            RuleKind::Forbidden => (object && self.values.is_some(), "object and values"),
            RuleKind::Permitted => {
                (object && self.values.is_some() != self.step.is_some(), "object, and values or step")
            }
            RuleKind::Never => (on, "on"),
            RuleKind::MinInterval | RuleKind::MaxInterval => (on && time, "on, and ms or ms_of"),
            RuleKind::MaxCount => {
                let stretch = self.per == Some(Per::Stretch(Stretch::While));
                let bounded = !stretch || !self.during.0.is_empty();
                (on && self.count.is_some() && self.per.is_some() && bounded, "on, count, per and its while")
            }
            RuleKind::Precondition => (on && !self.needs.0.is_empty(), "on and needs"),
            RuleKind::Follow => (on && !self.then.0.is_empty() && time, "on, then, and ms or ms_of"),
            RuleKind::Order => (on && !self.before.0.is_empty(), "on and before"),
            RuleKind::Ascending => (self.objects.len() > 1, "two objects or more"),
            RuleKind::ReservedId => {
                (self.ids.is_some_and(|[first, last]| first <= last), "ids, first to last")
            }
            RuleKind::Expedited | RuleKind::RemoteLength => (true, ""),
        };
        (!there).then_some(what)
    }

    /// What the user may set, by the name of its key: what the rule itself has.
    pub fn tolerances(&self) -> impl Iterator<Item = &'static str> {
        let all =
            [("ms", self.ms.is_some()), ("times", self.ms_of.is_some()), ("count", self.count.is_some())];
        all.into_iter().filter(|(_, is_there)| *is_there).map(|(key, _)| key)
    }

    /// Sets one of them.
    pub(in crate::profile) fn set_tolerance(&mut self, key: &str, value: f64) {
        #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "saturates")]
        let count = value as u32;
        match key {
            "ms" => self.ms = self.ms.map(|_| value),
            "times" => self.times = value,
            "count" => self.count = self.count.map(|_| count),
            _ => {}
        }
    }

    /// `object` and `objects`.
    pub(crate) fn subjects(&self) -> impl Iterator<Item = Reference> {
        self.object.iter().chain(&self.objects).copied()
    }

    /// The same for one channel.
    pub(super) fn pinned(&self, nth: u16) -> Self {
        let stride = self.repeat.stride;
        Self {
            on: self.on.pinned(nth, stride),
            then: self.then.pinned(nth, stride),
            before: self.before.pinned(nth, stride),
            since: self.since.pinned(nth, stride),
            after: self.after.pinned(nth, stride),
            object: self.object.map(|it| it.pinned(nth, stride)),
            objects: self.objects.iter().map(|it| it.pinned(nth, stride)).collect(),
            ms_of: self.ms_of.map(|it| it.pinned(nth, stride)),
            needs: self.needs.pinned(nth, stride),
            during: self.during.pinned(nth, stride),
            except: self.except.iter().map(|it| it.pinned(nth, stride)).collect(),
            channel: self.repeat.number(nth),
            repeat: ONCE,
            ..self.clone()
        }
    }
}

/// A general rule the device need not obey.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Waiver {
    /// Name of the rule.
    pub rule: Spanned<String>,
    /// Why.
    pub text: String,
    /// Only findings about these objects, if any are named.
    #[serde(default)]
    pub objects: Vec<ObjectRange>,
    /// Variants it belongs to.
    #[serde(default)]
    pub only: Only,
    /// Section.
    #[serde(default)]
    pub source: String,
}
