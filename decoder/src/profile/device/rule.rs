//! Rules from a device manual, and waivers of general rules.
//!
//! The following applies to all kinds:
//! - A rule is checked per node with the profile; with `repeat`, per channel.
//! - With `while` it is checked only while all these conditions are proven. Not proven are: an object without
//!   a value on the bus, a factory default, a presumed NMT state, a state transition in progress. An object
//!   with role `actual` is valid for two seconds after the frame that contains it.
//! - Each trigger in `on` is checked separately; in `before`, `since`, `after` and `then` one is sufficient.
//! - In `on` an SDO write occurs with the server's response, confirmed or aborted, since manuals refer to the
//!   attempt. Elsewhere only a confirmed write counts. A write without a response never counts.
//! - Conditions are evaluated just before `on` takes effect, but with the objects in the same PDO or message.
//! - Time limits are relaxed by the granularity of the timestamps, and not checked without usable timestamps.
//!   `limits` have a tolerance of a thousandth of their span, `range` has none.
//! - A PDO is recognised by the identifier in force. If that is only assumed, a missing PDO proves nothing.
//! - A rule that never started, or whose `while` was never proven, is *not exercised*.

use std::borrow::Cow;

use serde::Deserialize;
use toml::Spanned;

use super::condition::{DeviceConditions, ProfileTrigger, ProfileTriggers};
use crate::profile::object::{EntryRepetition, NumberList, ONCE, VariantFilter};
use crate::profile::reference::{ObjectRange, ObjectReference};
use crate::profile::written::NodeNumber;

/// Requirement of the manual that a capture can violate.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct DeviceRule {
    /// Name in kebab-case; printed after the profile id.
    pub name: String,
    /// Repeats, for example one per channel; references move along. With `channel` a state is that of the
    /// channel.
    #[serde(default)]
    pub repeat: EntryRepetition,
    /// Bus it applies to; in bus files only.
    #[serde(default)]
    pub(crate) bus: Option<String>,
    /// Node it applies to; in bus files only, and required there.
    #[serde(default)]
    pub(crate) node: Option<Spanned<NodeNumber>>,
    /// Severity of its findings.
    pub severity: Severity,
    /// Kind of requirement; it determines the other keys.
    pub kind: RuleKind,
    /// Requirement as text.
    pub text: String,
    /// Next step for the user: an imperative without a full stop.
    #[serde(default)]
    pub next: String,
    /// Triggers that start a check.
    #[serde(default)]
    pub on: ProfileTriggers,
    /// Triggers that must follow.
    #[serde(default)]
    pub then: ProfileTriggers,
    /// Triggers that must have occurred before.
    #[serde(default)]
    pub before: ProfileTriggers,
    /// Triggers that invalidate an earlier `before`; the start of the node if empty. For the kinds about
    /// values and events: the rule applies only after one of them.
    #[serde(default)]
    pub since: ProfileTriggers,
    /// Triggers after which the rule no longer applies.
    #[serde(default)]
    pub until: ProfileTriggers,
    /// Triggers of the steps of a sequence, in their order.
    #[serde(default)]
    pub steps: Vec<ProfileTriggers>,
    /// Start of `ms`, if different from the previous `on`.
    #[serde(default)]
    pub after: ProfileTriggers,
    /// Object of a limit.
    #[serde(default)]
    pub object: Option<ObjectReference>,
    /// Objects of a limit, or with ascending values.
    #[serde(default)]
    pub objects: Vec<ObjectReference>,
    /// Permitted raw values: minimum and maximum.
    #[serde(default)]
    pub range: Option<[i64; 2]>,
    /// Permitted values in the object's unit: minimum and maximum.
    #[serde(default)]
    pub limits: Option<[f64; 2]>,
    /// Object whose scaled value is the maximum of the magnitude.
    #[serde(default)]
    pub within: Option<ObjectReference>,
    /// Forbidden or permitted raw values.
    #[serde(default)]
    pub values: Option<NumberList>,
    /// Permitted raw values are multiples of this step.
    #[serde(default)]
    pub step: Option<u32>,
    /// Whether consecutive values may be equal.
    #[serde(default)]
    pub or_equal: bool,
    /// Time limit in ms.
    #[serde(default)]
    pub ms: Option<f64>,
    /// Object whose scaled value is the limit in ms; not checked if 0 or unknown.
    #[serde(default)]
    pub ms_of: Option<ObjectReference>,
    /// Factor for the value of `ms_of`.
    #[serde(default = "one_time")]
    pub times: f64,
    /// Max number of occurrences.
    #[serde(default)]
    pub count: Option<u32>,
    /// Interval of `count`: `sync`, `while` or seconds.
    #[serde(default)]
    pub per: Option<CountWindow>,
    /// Conditions that must hold.
    #[serde(default)]
    pub needs: DeviceConditions,
    /// Conditions under which the rule applies (`while`).
    #[serde(default, rename = "while")]
    pub during: DeviceConditions,
    /// Length of a message in bytes.
    #[serde(default)]
    pub bytes: Option<u8>,
    /// J1939 parameter groups.
    #[serde(default)]
    pub groups: Vec<u32>,
    /// First and last CAN identifier.
    #[serde(default)]
    pub ids: Option<[u32; 2]>,
    /// Permitted form of frames on `ids`.
    #[serde(default)]
    pub shape: Option<FrameForm>,
    /// Objects that are exempt.
    #[serde(default)]
    pub except: Vec<ObjectRange>,
    /// Rules of this profile, otherwise general rules, whose findings on the same node have the same cause
    /// and are listed under a finding of this rule.
    #[serde(default)]
    pub takes_in: Vec<String>,
    /// Rules of this profile, otherwise general rules, whose finding on the same node is the cause of a finding
    /// of this rule while it lasts.
    #[serde(default)]
    pub follows: Vec<String>,
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

const fn one_time() -> f64 {
    1.0
}

/// Severity of a finding.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Severity {
    /// Information only.
    Note,
    /// Should be checked.
    Warning,
    /// Violation with effect on the machine.
    Error,
}

impl Severity {
    /// Next lower severity.
    #[must_use]
    pub(crate) const fn next_lower(self) -> Self {
        match self {
            Self::Error => Self::Warning,
            Self::Warning | Self::Note => Self::Note,
        }
    }

    /// Name in all output.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Note => "note",
            Self::Warning => "warning",
            Self::Error => "error",
        }
    }
}

/// Kind of requirement.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum RuleKind {
    /// The objects stay within `range` or `limits`, or their magnitude is at most `within`. Checks each value in a PDO, message, upload or download
    /// (also an aborted one), except special values (`special`). `limits` are not checked with an assumed
    /// scale.
    Limit,
    /// The objects never receive one of `values`. Checks each download, also an aborted one, and each PDO or
    /// message that carries them to the device, but not uploads.
    Forbidden,
    /// The objects receive only `values`, or multiples of `step`; otherwise like `Forbidden`.
    Permitted,
    /// `on` does not occur. Exercised by what is compared with `on`: for a write any write, for a value one of its
    /// object, for a message one of its kind.
    Never,
    /// `on` occurs at least `ms` after the previous `on`, or after the last `after`. Not checked for the
    /// first `on` after the start of the node or after a silent bus.
    MinInterval,
    /// `on` occurs at most `ms` after the previous `on`. The interval starts with the first `on`, or as soon
    /// as `while` holds, and ends when `while` ceases to hold. One finding per gap, at its end.
    MaxInterval,
    /// At most `count` of `on` between two SYNCs with the identifier configured in the node (`per = "sync"`),
    /// in one uninterrupted period of `while` (`"while"`), or within a number of seconds.
    MaxCount,
    /// All `needs` hold when `on` occurs. Reports only conditions that are proven not to hold; with `ms`, only
    /// if they did not hold at any `on` during this time.
    Precondition,
    /// `then` occurs within `ms` after `on`. Another `on` restarts the time; the end of `while`, a restart of
    /// the node and the end of the capture cancel the check.
    Follow,
    /// `on` occurs only after `before`. `since` invalidates an earlier `before`. Checked only after the first
    /// `since` in the capture, because earlier events are unknown; with `ms`, not until that time
    /// after it, unless it is the start of the node.
    Order,
    /// The first occurrences of `steps` since the start of the node have this order. Steps may be missing.
    /// Checked only after a start in the capture.
    Sequence,
    /// The values of `objects` ascend. Checked when `on` occurs; without `on`, one second after the last
    /// write to one of them. Reports two consecutive known values that do not ascend.
    Ascending,
    /// The identifiers `ids` are reserved for the device and its tools. Reports, on each bus with such a
    /// device, an owner of another kind (seen in SDO traffic, bus file, device file) and a data frame without
    /// `shape`.
    ReservedId,
    /// SDO transfers are expedited except for the objects in `except`. Reports segmented and block transfers
    /// of other objects, also aborted ones.
    Expedited,
    /// A remote frame that requests a TPDO of the device has the length of that PDO.
    RemoteLength,
    /// An EMCY has eight bytes. An empty one is permitted if the device sends it at its start
    /// (`at_boot = "ready-telegram"`).
    EmcyLength,
    /// The code of an EMCY is in the list `[[emcy.code]]`.
    EmcyCode,
    /// The error register of an EMCY has the bits that `[[emcy.code]]` gives for its code. More bits may belong
    /// to other errors. With `cleared = "all-gone"` it is 0 for code 0000.
    EmcyRegister,
    /// The device refuses SDO requests only with codes of the list `[[abort]]`.
    AbortCode,
    /// The node-ID is within `range`. Checked once, at the first frame of the node under this node-ID.
    NodeId,
    /// The J1939 source address is within `range`. Checked like `NodeId`.
    SourceAddress,
    /// The J1939 messages in `on` have `bytes` bytes.
    MessageLength,
    /// The device sends the parameter groups `groups` only within `ms` after a request for them. Not checked in
    /// the first `ms` after its first frame.
    OnRequest,
    /// UDS requests to the device have one of the services in `values`.
    UdsServices,
    /// The PDOs in `on` have the fixed content (`constant`) that the profile gives for a part of them.
    Constant,
}

/// Interval in which `count` counts.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(untagged, expecting = "expected \"sync\", \"while\" or a number of seconds")]
pub enum CountWindow {
    /// Fixed time in seconds.
    Seconds(f64),
    /// Interval without a fixed length.
    Variable(VariableWindow),
}

/// Interval without a fixed length.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum VariableWindow {
    /// Between two SYNCs.
    Sync,
    /// Uninterrupted period in which the conditions of `while` hold.
    While,
}

/// Permitted form of a frame.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum FrameForm {
    /// Eight bytes that start with an SDO command specifier.
    Sdo,
}

/// A number of a device rule that the bus file can override.
#[derive(Debug, Clone, PartialEq)]
pub struct RuleTolerance {
    /// Key in `[rules."profile:rule"]`.
    pub key: &'static str,
    /// Value without a setting in the bus file.
    pub value: f64,
    /// Unit; empty for a factor or a count.
    pub unit: &'static str,
    /// Meaning of the limit.
    pub text: String,
}

impl DeviceRule {
    /// Keys that the kind of rule requires and that are missing.
    pub fn missing_keys(&self) -> Option<&'static str> {
        let on = !self.on.0.is_empty();
        let object = self.rule_objects().next().is_some();
        let time = self.ms.is_some() != self.ms_of.is_some();
        let (there, what) = match self.kind {
            RuleKind::Limit => {
                let given = [self.range.is_some(), self.limits.is_some(), self.within.is_some()];
                let is_one = given.into_iter().filter(|is_given| *is_given).count() == 1;
                (object && is_one, "object, and range, limits or within")
            }
            RuleKind::Forbidden => (object && self.values.is_some(), "object and values"),
            RuleKind::Permitted => {
                (object && self.values.is_some() != self.step.is_some(), "object, and values or step")
            }
            RuleKind::Never => (on, "on"),
            RuleKind::MinInterval | RuleKind::MaxInterval => (on && time, "on, and ms or ms_of"),
            RuleKind::MaxCount => {
                let stretch = self.per == Some(CountWindow::Variable(VariableWindow::While));
                let bounded = !stretch || !self.during.0.is_empty();
                (
                    on && self.count.is_some() && self.per.is_some() && bounded,
                    "on, count and per, and while with per = \"while\"",
                )
            }
            RuleKind::Precondition => (on && !self.needs.0.is_empty(), "on and needs"),
            RuleKind::Follow => (on && !self.then.0.is_empty() && time, "on, then, and ms or ms_of"),
            RuleKind::Order => (on && !self.before.0.is_empty() && self.ms_of.is_none(), "on and before"),
            RuleKind::Sequence => (self.steps.len() > 1, "at least two steps"),
            RuleKind::Ascending => (self.objects.len() > 1, "at least two objects"),
            RuleKind::ReservedId => {
                (self.ids.is_some_and(|[first, last]| first <= last), "ids in ascending order")
            }
            _ => self.required_of_lists(),
        };
        (!there).then_some(what)
    }

    /// Problem of a rule that can be found without its device.
    pub(crate) fn alone_problem(&self) -> Option<String> {
        let is_part = |byte: u8| byte.is_ascii_lowercase() || byte.is_ascii_digit() || byte == b'-';
        if self.name.is_empty() || !self.name.bytes().all(is_part) {
            return Some(format!("invalid rule name '{}'; expected a-z, 0-9 and hyphens", self.name));
        }
        if self.repeat.count == 0 {
            return Some("invalid repeat; expected count > 0".into());
        }
        let missing = self.missing_keys()?;
        Some(format!("a rule of this kind requires {missing}"))
    }

    /// Whether a rule about a list, range or content has its keys, and these keys.
    fn required_of_lists(&self) -> (bool, &'static str) {
        let on =
            |is_right: fn(&ProfileTrigger) -> bool| !self.on.0.is_empty() && self.on.0.iter().all(is_right);
        match self.kind {
            RuleKind::NodeId | RuleKind::SourceAddress => (self.range.is_some(), "range"),
            RuleKind::UdsServices => (self.values.is_some(), "values"),
            RuleKind::OnRequest => {
                let has_time = self.ms.is_some() != self.ms_of.is_some();
                (!self.groups.is_empty() && has_time, "groups, and ms or ms_of")
            }
            RuleKind::Constant => (on(|it| matches!(it, ProfileTrigger::Pdo(_))), "on with PDOs only"),
            RuleKind::MessageLength => {
                let are_messages = on(|it| matches!(it, ProfileTrigger::Message(_)));
                (are_messages && self.bytes.is_some(), "on with messages only, and bytes")
            }
            _ => (true, ""),
        }
    }

    /// Numbers of the rule that the user can override.
    pub fn tolerances(&self) -> impl Iterator<Item = RuleTolerance> {
        let tolerance = |key, value, unit, text| RuleTolerance { key, value, unit, text };
        let ms = self.ms.map(|ms| tolerance("ms", ms, "ms", self.time_text().to_owned()));
        let of = |of: ObjectReference| format!("factor for the time in {}", of.object);
        let times = self.ms_of.map(|it| tolerance("times", self.times, "", of(it)));
        let count =
            self.count.map(|count| tolerance("count", f64::from(count), "", self.count_text().into_owned()));
        [ms, times, count].into_iter().flatten()
    }

    /// Meaning of `ms`.
    const fn time_text(&self) -> &'static str {
        match self.kind {
            RuleKind::MinInterval => "min interval",
            RuleKind::MaxInterval => "max interval",
            RuleKind::Follow => "max time to the expected event",
            RuleKind::OnRequest => "max time after the request",
            RuleKind::Precondition => "time without the condition before a finding",
            RuleKind::Order => "time without a check after the event that requires the order",
            _ => "time limit",
        }
    }

    /// Meaning of `count`.
    fn count_text(&self) -> Cow<'static, str> {
        match self.per {
            Some(CountWindow::Seconds(seconds)) => format!("max number in {seconds} s").into(),
            Some(CountWindow::Variable(VariableWindow::Sync)) => "max number between two SYNCs".into(),
            Some(CountWindow::Variable(VariableWindow::While)) | None => "max number".into(),
        }
    }

    /// Overrides one of the tolerances.
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

    /// Whether the rule applies only after `since`, until `until` or a restart of the node.
    pub(crate) const fn is_scoped(&self) -> bool {
        let has_scope = matches!(
            self.kind,
            RuleKind::Limit
                | RuleKind::Forbidden
                | RuleKind::Permitted
                | RuleKind::Never
                | RuleKind::Precondition
        );
        has_scope && !self.since.0.is_empty()
    }

    /// Objects in `object` and `objects`.
    pub(crate) fn rule_objects(&self) -> impl Iterator<Item = ObjectReference> {
        self.object.iter().chain(&self.objects).copied()
    }

    /// Copy for repeat `nth`.
    pub(crate) fn pin_repeat(&self, nth: u16) -> Self {
        let stride = self.repeat.stride;
        Self {
            on: self.on.pin_repeat(nth, stride),
            then: self.then.pin_repeat(nth, stride),
            before: self.before.pin_repeat(nth, stride),
            since: self.since.pin_repeat(nth, stride),
            until: self.until.pin_repeat(nth, stride),
            steps: self.steps.iter().map(|step| step.pin_repeat(nth, stride)).collect(),
            after: self.after.pin_repeat(nth, stride),
            object: self.object.map(|it| it.pin_repeat(nth, stride)),
            objects: self.objects.iter().map(|it| it.pin_repeat(nth, stride)).collect(),
            within: self.within.map(|it| it.pin_repeat(nth, stride)),
            ms_of: self.ms_of.map(|it| it.pin_repeat(nth, stride)),
            needs: self.needs.pin_repeat(nth, stride),
            during: self.during.pin_repeat(nth, stride),
            except: self.except.iter().map(|it| it.pin_repeat(nth, stride)).collect(),
            channel: self.repeat.channel_number(nth),
            repeat: ONCE,
            ..self.clone()
        }
    }
}

/// General rule that does not apply to the device.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RuleWaiver {
    /// Rule slug, with its position in the profile.
    pub rule: Spanned<String>,
    /// Reason of the waiver.
    pub text: String,
    /// Objects it applies to; all if empty.
    #[serde(default)]
    pub objects: Vec<ObjectRange>,
    /// Variants it applies to; all if empty.
    #[serde(default)]
    pub only: VariantFilter,
    /// Section of the manual.
    #[serde(default)]
    pub source: String,
}
