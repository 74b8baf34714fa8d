//! Conditions and triggers of profiles.

use serde::Deserialize;

use super::network::NmtName;
use crate::profile::layout::PdoName;
use crate::profile::object::NumberList;
use crate::profile::one_or_many::{OneOrMany, deserialize_tables};
use crate::profile::reference::{BitReference, ObjectRange, ObjectReference};

/// Condition on a device or its bus.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(try_from = "ConditionKeys")]
pub enum DeviceCondition {
    /// NMT state of the node.
    Nmt(NmtName),
    /// The capture shows the value of an object, which the session compares with the traffic; without it, the
    /// condition is invisible.
    Known(ObjectReference),
    /// The raw value of an object, reduced by a mask, is (or is not) one of several values.
    Object {
        /// Object to compare.
        object: ObjectReference,
        /// Bits to compare.
        mask: u64,
        /// Values to compare with.
        values: NumberList,
        /// Whether the value must differ from all `values`.
        negated: bool,
    },
    /// The raw value of an object is within a range, limits included.
    Inside {
        /// Object to compare.
        object: ObjectReference,
        /// Minimum and maximum.
        range: [i64; 2],
    },
    /// The device reports one of these states.
    State(Vec<String>),
    /// SYNC with the identifier configured in the node is present.
    Sync,
    /// No error is active.
    NoError,
    /// No procedure is running that takes over the set points.
    NoProcedure,
    /// The last PDO is more recent than this time, in ms.
    Younger(u32),
    /// Condition without evidence on the bus.
    Invisible,
    /// At least one other node on the bus with the same profile, in any variant, meets all of these; in rules
    /// only. Fails if no such node exists or each one is proven not to meet them; otherwise unknown.
    Other(DeviceConditions),
    /// No other CANopen node on the bus has sent a boot-up, heartbeat, guarding response, EMCY, SDO response
    /// or TPDO within the last ten seconds; in rules only. Never unknown.
    Alone,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct ConditionKeys {
    nmt: Option<NmtName>,
    object: Option<ObjectReference>,
    equals: Option<NumberList>,
    not: Option<NumberList>,
    range: Option<[i64; 2]>,
    known: Option<bool>,
    mask: Option<u64>,
    state: Option<OneOrMany<String>>,
    sync: Option<bool>,
    no_error: Option<bool>,
    no_procedure: Option<bool>,
    younger: Option<u32>,
    visible: Option<bool>,
    other: Option<DeviceConditions>,
    alone: Option<bool>,
}

impl TryFrom<ConditionKeys> for DeviceCondition {
    type Error = &'static str;

    fn try_from(keys: ConditionKeys) -> Result<Self, &'static str> {
        let mask = keys.mask.unwrap_or(u64::MAX);
        let object = match (keys.object, keys.equals, keys.not, keys.range, keys.known) {
            (None, None, None, None, None) => None,
            (Some(object), None, None, None, Some(true)) if keys.mask.is_none() => Some(Self::Known(object)),
            (Some(object), Some(values), None, None, None) => {
                Some(Self::Object { object, mask, values, negated: false })
            }
            (Some(object), None, Some(values), None, None) => {
                Some(Self::Object { object, mask, values, negated: true })
            }
            (Some(object), None, None, Some(range), None) if keys.mask.is_none() && range[0] <= range[1] => {
                Some(Self::Inside { object, range })
            }
            _ => return Err("expected object with exactly one of equals, not, range, known"),
        };
        let all = [
            keys.nmt.map(Self::Nmt),
            object,
            keys.state.map(|states| Self::State(states.into_vec())),
            keys.sync.map(|_| Self::Sync),
            keys.no_error.map(|_| Self::NoError),
            keys.no_procedure.map(|_| Self::NoProcedure),
            keys.younger.map(Self::Younger),
            keys.visible.map(|_| Self::Invisible),
            keys.other.map(Self::Other),
            keys.alone.map(|_| Self::Alone),
        ];
        let mut given = all.into_iter().flatten();
        match (given.next(), given.next()) {
            (Some(condition), None) => Ok(condition),
            _ => Err(
                "expected exactly one of nmt, object, state, sync, no_error, no_procedure, younger, visible, other, alone",
            ),
        }
    }
}

/// Conditions that must all hold.
#[derive(Debug, Clone, PartialEq, Default, Deserialize)]
#[serde(transparent)]
pub struct DeviceConditions(#[serde(deserialize_with = "deserialize_tables")] pub Vec<DeviceCondition>);

impl DeviceConditions {
    /// Copy with the references of repeat `nth`.
    #[must_use]
    pub(crate) fn pin_repeat(&self, nth: u16, stride: u16) -> Self {
        Self(self.0.iter().map(|condition| condition.pin_repeat(nth, stride)).collect())
    }
}

/// Expected value of a write or read.
#[derive(Debug, Clone, PartialEq, Eq, Deserialize)]
#[serde(untagged, expecting = "expected a number, a list of numbers or a text such as \"save\"")]
pub enum ExpectedValue {
    /// One or several raw numbers.
    Numbers(NumberList),
    /// Text, for example a signature.
    Text(String),
}

/// Event that starts, ends or triggers something in a profile.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(try_from = "TriggerKeys")]
pub enum ProfileTrigger {
    /// Write to an object by SDO, optionally of certain values.
    Write(ObjectReference, Option<ExpectedValue>),
    /// Read of an object by SDO, optionally of certain values.
    Read(ObjectReference, Option<ExpectedValue>),
    /// Change of a bit to the given state.
    Bit(BitReference, bool),
    /// Reception of a PDO.
    Pdo(PdoName),
    /// Reception of a J1939 message.
    Message(MessageTrigger),
    /// Report of a fault: SPN and FMI, or any fault.
    Dtc(Option<(u32, u8)>),
    /// NMT command to the node.
    Nmt(String),
    /// Report of one of these states.
    State(Vec<String>),
    /// SYNC with the identifier configured in the node.
    Sync,
    /// EMCY message with this code.
    Emcy(u16),
    /// Start of the node.
    Boot,
    /// Start of the node without an NMT reset; in rules only.
    PowerOn,
    /// Update of an object by PDO, message or SDO; in rules only.
    Set(SetTrigger),
    /// SDO write to an object in a range, each object separately; in rules only.
    Writes(ObjectRange),
    /// LSS message; in rules only.
    Lss(LssTrigger),
    /// Guarding request of the NMT master; in rules only.
    Guard,
    /// Value of an object in a PDO or message of the device, in an upload, or of 1001 in an EMCY; in rules only.
    Shows(SetTrigger),
    /// One of these NMT states in a heartbeat or guarding response; `undefined` for other codes; in rules only.
    Reports(Vec<String>),
}

/// Value of an object: an update for `set`, a report of the device for `shows`. Occurs also if the value does not
/// change.
#[derive(Debug, Clone, PartialEq)]
pub struct SetTrigger {
    /// Object that is updated.
    pub object: ObjectReference,
    /// Bits to compare.
    pub mask: u64,
    /// Raw values, reduced by the mask; `None` for any value.
    pub values: Option<NumberList>,
    /// Whether the value must differ from all `values`.
    pub negated: bool,
    /// Whether the previous value must be known and different.
    pub changed: bool,
}

/// LSS message (CiA 305) on the node's bus. Requests address no node, so they apply to all nodes of the bus.
#[derive(Debug, Clone, PartialEq)]
pub struct LssTrigger {
    /// Name of the service, as in the LSS events.
    pub service: String,
    /// Whether it is the response of the slave rather than the request of the master.
    pub answer: bool,
    /// Byte after the command specifier: mode, node-ID or result code; `None` for any.
    pub values: Option<NumberList>,
}

/// Alternative triggers; one is sufficient.
#[derive(Debug, Clone, PartialEq, Default, Deserialize)]
#[serde(transparent)]
pub struct ProfileTriggers(#[serde(deserialize_with = "deserialize_tables")] pub Vec<ProfileTrigger>);

impl ProfileTriggers {
    /// Copy with the references of repeat `nth`.
    #[must_use]
    pub(crate) fn pin_repeat(&self, nth: u16, stride: u16) -> Self {
        Self(self.0.iter().map(|trigger| trigger.pin_repeat(nth, stride)).collect())
    }
}

/// Reception of a J1939 message.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct MessageTrigger {
    /// Name of the message in the profile.
    pub name: String,
    /// Number of consecutive messages required.
    #[serde(default = "once")]
    pub times: u8,
    /// Conditions that must hold each time.
    #[serde(default)]
    pub when: DeviceConditions,
}

const fn once() -> u8 {
    1
}

#[derive(Deserialize)]
#[serde(untagged, expecting = "expected true, or a fault such as \"298985/19\" (SPN/FMI)")]
enum DtcKey {
    Any(bool),
    One(String),
}

impl DtcKey {
    fn read_key(self) -> Result<Option<(u32, u8)>, &'static str> {
        let text = match self {
            Self::Any(true) => return Ok(None),
            Self::Any(false) => return Err("expected true, or a fault such as \"298985/19\" (SPN/FMI)"),
            Self::One(text) => text,
        };
        let numbers =
            text.split_once('/').and_then(|(spn, fmi)| Some((spn.parse().ok()?, fmi.parse().ok()?)));
        numbers.map(Some).ok_or("invalid fault; expected the form \"298985/19\" (SPN/FMI)")
    }
}

#[derive(Deserialize)]
#[serde(untagged, expecting = "expected true or \"power-on\"")]
enum BootKey {
    Any(bool),
    One(String),
}

impl BootKey {
    fn read_key(self) -> Result<ProfileTrigger, &'static str> {
        match self {
            Self::Any(true) => Ok(ProfileTrigger::Boot),
            Self::One(text) if text == "power-on" => Ok(ProfileTrigger::PowerOn),
            Self::Any(false) | Self::One(_) => Err("expected boot = true or boot = \"power-on\""),
        }
    }
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct TriggerKeys {
    write: Option<ObjectReference>,
    read: Option<ObjectReference>,
    equals: Option<ExpectedValue>,
    bit: Option<BitReference>,
    becomes: Option<u8>,
    pdo: Option<PdoName>,
    message: Option<MessageTrigger>,
    dtc: Option<DtcKey>,
    nmt: Option<String>,
    state: Option<OneOrMany<String>>,
    sync: Option<bool>,
    emcy: Option<u16>,
    boot: Option<BootKey>,
    set: Option<ObjectReference>,
    not: Option<NumberList>,
    mask: Option<u64>,
    changed: Option<bool>,
    writes: Option<ObjectRange>,
    lss: Option<String>,
    answer: Option<bool>,
    guard: Option<bool>,
    shows: Option<ObjectReference>,
    reports: Option<OneOrMany<String>>,
}

impl TriggerKeys {
    /// Trigger from the key `set` or `shows`.
    fn read_set_trigger(&self) -> Result<Option<SetTrigger>, &'static str> {
        let Some(object) = self.set.or(self.shows) else {
            let more = self.not.is_some() || self.mask.is_some() || self.changed.is_some();
            return if more { Err("not, mask and changed require set or shows") } else { Ok(None) };
        };
        let (values, negated) = match (self.read_numbers()?, &self.not) {
            (Some(_), Some(_)) => return Err("equals and not; expected only one of them"),
            (None, Some(values)) => (Some(values.clone()), true),
            (values, None) => (values, false),
        };
        if self.mask.is_some() && values.is_none() {
            return Err("mask requires equals or not");
        }
        let mask = self.mask.unwrap_or(u64::MAX);
        Ok(Some(SetTrigger { object, mask, values, negated, changed: self.changed == Some(true) }))
    }

    /// Trigger from the key `lss`.
    fn read_lss_trigger(&self) -> Result<Option<LssTrigger>, &'static str> {
        let Some(service) = self.lss.clone() else {
            return if self.answer.is_some() { Err("answer requires lss") } else { Ok(None) };
        };
        Ok(Some(LssTrigger { service, answer: self.answer == Some(true), values: self.read_numbers()? }))
    }

    fn read_numbers(&self) -> Result<Option<NumberList>, &'static str> {
        match &self.equals {
            None => Ok(None),
            Some(ExpectedValue::Numbers(numbers)) => Ok(Some(numbers.clone())),
            Some(ExpectedValue::Text(_)) => Err("a text in equals requires write or read"),
        }
    }
}

impl TryFrom<TriggerKeys> for ProfileTrigger {
    type Error = &'static str;

    fn try_from(keys: TriggerKeys) -> Result<Self, &'static str> {
        let objects = [keys.write, keys.read, keys.set, keys.shows];
        let is_valued = keys.lss.is_some() || objects.iter().any(Option::is_some);
        if keys.equals.is_some() && !is_valued {
            return Err("equals requires write, read, set, shows or lss");
        }
        if keys.bit.is_some() != keys.becomes.is_some() || keys.becomes.is_some_and(|value| value > 1) {
            return Err("expected bit together with becomes = 0 or 1");
        }
        let (value, lss) = (keys.read_set_trigger()?, keys.read_lss_trigger()?);
        let (set, shows) =
            (keys.set.and(value.clone()).map(Self::Set), keys.shows.and(value).map(Self::Shows));
        let all = [
            keys.write.map(|object| Self::Write(object, keys.equals.clone())),
            keys.read.map(|object| Self::Read(object, keys.equals)),
            keys.bit.map(|bit| Self::Bit(bit, keys.becomes == Some(1))),
            keys.pdo.map(Self::Pdo),
            keys.message.map(Self::Message),
            keys.dtc.map(DtcKey::read_key).transpose()?.map(Self::Dtc),
            keys.nmt.map(Self::Nmt),
            keys.state.map(|states| Self::State(states.into_vec())),
            keys.sync.map(|_| Self::Sync),
            keys.emcy.map(Self::Emcy),
            keys.boot.map(BootKey::read_key).transpose()?,
            set,
            shows,
            keys.reports.map(|states| Self::Reports(states.into_vec())),
            keys.writes.map(Self::Writes),
            lss.map(Self::Lss),
            keys.guard.map(|_| Self::Guard),
        ];
        let mut given = all.into_iter().flatten();
        match (given.next(), given.next()) {
            (Some(trigger), None) => Ok(trigger),
            _ => Err(
                "expected exactly one of write, read, bit, pdo, message, dtc, nmt, state, sync, emcy, boot, set, shows, reports, writes, lss, guard",
            ),
        }
    }
}

impl ProfileTrigger {
    /// Conditions that must hold when the trigger occurs.
    pub fn trigger_conditions(&self) -> &[DeviceCondition] {
        if let Self::Message(message) = self { &message.when.0 } else { &[] }
    }

    /// Number of consecutive occurrences required.
    pub fn occurrence_count(&self) -> u8 {
        if let Self::Message(message) = self { message.times } else { 1 }
    }

    /// Whether the trigger is valid in rules only.
    pub(crate) const fn is_of_rules(&self) -> bool {
        matches!(
            self,
            Self::Set(_)
                | Self::Writes(_)
                | Self::Lss(_)
                | Self::Guard
                | Self::PowerOn
                | Self::Shows(_)
                | Self::Reports(_)
        )
    }

    /// Copy with the references of repeat `nth`.
    #[must_use]
    pub(crate) fn pin_repeat(&self, nth: u16, stride: u16) -> Self {
        match self.clone() {
            Self::Write(object, wanted) => Self::Write(object.pin_repeat(nth, stride), wanted),
            Self::Read(object, wanted) => Self::Read(object.pin_repeat(nth, stride), wanted),
            Self::Bit(bit, becomes) => {
                Self::Bit(BitReference { object: bit.object.pin_repeat(nth, stride), ..bit }, becomes)
            }
            Self::Set(set) => Self::Set(SetTrigger { object: set.object.pin_repeat(nth, stride), ..set }),
            Self::Shows(set) => Self::Shows(SetTrigger { object: set.object.pin_repeat(nth, stride), ..set }),
            Self::Writes(range) => Self::Writes(range.pin_repeat(nth, stride)),
            other => other,
        }
    }
}

impl DeviceCondition {
    /// Copy with the references of repeat `nth`.
    #[must_use]
    pub(crate) fn pin_repeat(&self, nth: u16, stride: u16) -> Self {
        match self.clone() {
            Self::Object { object, mask, values, negated } => {
                Self::Object { object: object.pin_repeat(nth, stride), mask, values, negated }
            }
            Self::Inside { object, range } => Self::Inside { object: object.pin_repeat(nth, stride), range },
            Self::Known(object) => Self::Known(object.pin_repeat(nth, stride)),
            Self::Other(all) => Self::Other(all.pin_repeat(nth, stride)),
            other => other,
        }
    }
}
