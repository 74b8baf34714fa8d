//! Conditions and triggers: what must hold, what must happen.

use serde::Deserialize;

use super::network::NmtName;
use crate::profile::layout::PdoName;
use crate::profile::object::Numbers;
use crate::profile::one_or_many::{OneOrMany, tables};
use crate::profile::reference::{BitReference, ObjectRange, Reference};

/// Something that holds or not.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(try_from = "ConditionKeys")]
pub enum Condition {
    /// The node's NMT state.
    Nmt(NmtName),
    /// An object's raw value, through a mask, is one of these (or none of them).
    Object {
        /// The object.
        object: Reference,
        /// Bits that count.
        mask: u64,
        /// Values.
        values: Numbers,
        /// Whether it must be none of them.
        negated: bool,
    },
    /// An object's raw value lies between two, both included.
    Inside {
        /// The object.
        object: Reference,
        /// Least and most.
        range: [i64; 2],
    },
    /// The state the device reports is one of these.
    State(Vec<String>),
    /// SYNC with the node's own identifier comes.
    Sync,
    /// No error is active.
    NoError,
    /// No procedure runs that takes the set points over.
    NoProcedure,
    /// The last PDO is younger than so many ms.
    Younger(u32),
    /// The bus never shows it.
    Invisible,
    /// One other node of the bus with the same profile, in whatever variant, meets all of these; in rules only.
    /// Fails when each such node is known not to, and when there is none; otherwise it is unknown.
    Other(Conditions),
    /// No other CANopen node of the bus sent a boot-up, heartbeat, guard reply, EMCY, SDO response or TPDO within
    /// the last ten seconds; in rules only. Never unknown.
    Alone,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct ConditionKeys {
    nmt: Option<NmtName>,
    object: Option<Reference>,
    equals: Option<Numbers>,
    not: Option<Numbers>,
    range: Option<[i64; 2]>,
    mask: Option<u64>,
    state: Option<OneOrMany<String>>,
    sync: Option<bool>,
    no_error: Option<bool>,
    no_procedure: Option<bool>,
    younger: Option<u32>,
    visible: Option<bool>,
    other: Option<Conditions>,
    alone: Option<bool>,
}

impl TryFrom<ConditionKeys> for Condition {
    type Error = &'static str;

    fn try_from(keys: ConditionKeys) -> Result<Self, &'static str> {
        let mask = keys.mask.unwrap_or(u64::MAX);
        let object = match (keys.object, keys.equals, keys.not, keys.range) {
            (None, None, None, None) => None,
            (Some(object), Some(values), None, None) => {
                Some(Self::Object { object, mask, values, negated: false })
            }
            (Some(object), None, Some(values), None) => {
                Some(Self::Object { object, mask, values, negated: true })
            }
            (Some(object), None, None, Some(range)) if keys.mask.is_none() && range[0] <= range[1] => {
                Some(Self::Inside { object, range })
            }
            _ => return Err("a condition on an object needs object and one of equals, not, range"),
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
                "a condition is exactly one of nmt, object, state, sync, no_error, no_procedure, younger, visible, other, alone",
            ),
        }
    }
}

/// Conditions that must all hold.
#[derive(Debug, Clone, PartialEq, Default, Deserialize)]
#[serde(transparent)]
pub struct Conditions(#[serde(deserialize_with = "tables")] pub Vec<Condition>);

impl Conditions {
    /// The same for good, in repeat `nth`.
    #[must_use]
    pub(crate) fn pinned(&self, nth: u16, stride: u16) -> Self {
        Self(self.0.iter().map(|condition| condition.pinned(nth, stride)).collect())
    }
}

/// A value that is written.
#[derive(Debug, Clone, PartialEq, Eq, Deserialize)]
#[serde(untagged, expecting = "a number, a list of numbers or a text such as \"save\"")]
pub enum Wanted {
    /// Numbers.
    Numbers(Numbers),
    /// A signature.
    Text(String),
}

/// Something that happens.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(try_from = "TriggerKeys")]
pub enum Trigger {
    /// An object is written.
    Write(Reference, Option<Wanted>),
    /// An object is read.
    Read(Reference, Option<Wanted>),
    /// A bit changes.
    Bit(BitReference, bool),
    /// A PDO comes.
    Pdo(PdoName),
    /// A J1939 message comes.
    Message(MessageTrigger),
    /// A fault is reported: any, or one.
    Dtc(Option<(u32, u8)>),
    /// An NMT command is given to the node.
    Nmt(String),
    /// The device reports a state.
    State(Vec<String>),
    /// SYNC with the node's own identifier.
    Sync,
    /// An EMCY code.
    Emcy(u16),
    /// The node starts.
    Boot,
    /// A value comes to an object, by PDO, message or SDO; in rules only.
    Set(SetTrigger),
    /// An object of a range is written by SDO, each counted for itself; in rules only.
    Writes(ObjectRange),
    /// An LSS service; in rules only.
    Lss(LssTrigger),
    /// The master asks for the node's state by a remote frame; in rules only.
    Guard,
}

/// A value that comes to an object; each time, also when it stays the same.
#[derive(Debug, Clone, PartialEq)]
pub struct SetTrigger {
    /// The object.
    pub object: Reference,
    /// Bits that count.
    pub mask: u64,
    /// Raw values through the mask; any if none are named.
    pub values: Option<Numbers>,
    /// Whether it is none of them.
    pub negated: bool,
    /// Only where the value before was seen and was another one.
    pub changed: bool,
}

/// An LSS service (CiA 305) on the node's bus: requests name no node, so it counts for all nodes there.
#[derive(Debug, Clone, PartialEq)]
pub struct LssTrigger {
    /// Name of the service.
    pub service: String,
    /// The slave's answer, not the master's request.
    pub answer: bool,
    /// Byte behind the command specifier: mode, node-ID or result code; any if none is named.
    pub values: Option<Numbers>,
}

/// Things that may happen; one is enough.
#[derive(Debug, Clone, PartialEq, Default, Deserialize)]
#[serde(transparent)]
pub struct Triggers(#[serde(deserialize_with = "tables")] pub Vec<Trigger>);

impl Triggers {
    /// The same for good, in repeat `nth`.
    #[must_use]
    pub(crate) fn pinned(&self, nth: u16, stride: u16) -> Self {
        Self(self.0.iter().map(|trigger| trigger.pinned(nth, stride)).collect())
    }
}

/// A J1939 message that comes.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct MessageTrigger {
    /// Its name in the profile.
    pub name: String,
    /// So many times in a row.
    #[serde(default = "once")]
    pub times: u8,
    /// Each time with these conditions.
    #[serde(default)]
    pub when: Conditions,
}

const fn once() -> u8 {
    1
}

#[derive(Deserialize)]
#[serde(untagged, expecting = "true, or a fault as \"298985/19\": SPN and FMI")]
enum DtcKey {
    Any(bool),
    One(String),
}

impl DtcKey {
    fn read(self) -> Result<Option<(u32, u8)>, &'static str> {
        let text = match self {
            Self::Any(true) => return Ok(None),
            Self::Any(false) => return Err("dtc is true, or a fault as \"298985/19\""),
            Self::One(text) => text,
        };
        let numbers =
            text.split_once('/').and_then(|(spn, fmi)| Some((spn.parse().ok()?, fmi.parse().ok()?)));
        numbers.map(Some).ok_or("a fault is written \"298985/19\": SPN and FMI")
    }
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct TriggerKeys {
    write: Option<Reference>,
    read: Option<Reference>,
    equals: Option<Wanted>,
    bit: Option<BitReference>,
    becomes: Option<u8>,
    pdo: Option<PdoName>,
    message: Option<MessageTrigger>,
    dtc: Option<DtcKey>,
    nmt: Option<String>,
    state: Option<OneOrMany<String>>,
    sync: Option<bool>,
    emcy: Option<u16>,
    boot: Option<bool>,
    set: Option<Reference>,
    not: Option<Numbers>,
    mask: Option<u64>,
    changed: Option<bool>,
    writes: Option<ObjectRange>,
    lss: Option<String>,
    answer: Option<bool>,
    guard: Option<bool>,
}

impl TriggerKeys {
    /// What `set` says.
    fn set(&self) -> Result<Option<SetTrigger>, &'static str> {
        let Some(object) = self.set else {
            let more = self.not.is_some() || self.mask.is_some() || self.changed.is_some();
            return if more { Err("not, mask and changed go with set") } else { Ok(None) };
        };
        let (values, negated) = match (self.numbers()?, &self.not) {
            (Some(_), Some(_)) => return Err("set takes either equals or not"),
            (None, Some(values)) => (Some(values.clone()), true),
            (values, None) => (values, false),
        };
        if self.mask.is_some() && values.is_none() {
            return Err("mask goes with equals or not");
        }
        let mask = self.mask.unwrap_or(u64::MAX);
        Ok(Some(SetTrigger { object, mask, values, negated, changed: self.changed == Some(true) }))
    }

    /// What `lss` says.
    fn lss(&self) -> Result<Option<LssTrigger>, &'static str> {
        let Some(service) = self.lss.clone() else {
            return if self.answer.is_some() { Err("answer goes with lss") } else { Ok(None) };
        };
        Ok(Some(LssTrigger { service, answer: self.answer == Some(true), values: self.numbers()? }))
    }

    fn numbers(&self) -> Result<Option<Numbers>, &'static str> {
        match &self.equals {
            None => Ok(None),
            Some(Wanted::Numbers(numbers)) => Ok(Some(numbers.clone())),
            Some(Wanted::Text(_)) => Err("equals is a text with write and read only"),
        }
    }
}

impl TryFrom<TriggerKeys> for Trigger {
    type Error = &'static str;

    fn try_from(keys: TriggerKeys) -> Result<Self, &'static str> {
        let valued = keys.write.is_some() || keys.read.is_some() || keys.set.is_some() || keys.lss.is_some();
        if keys.equals.is_some() && !valued {
            return Err("equals goes with write, read, set or lss");
        }
        if keys.bit.is_some() != keys.becomes.is_some() || keys.becomes.is_some_and(|value| value > 1) {
            return Err("bit and becomes = 0 or 1 go together");
        }
        let (set, lss) = (keys.set()?, keys.lss()?);
        let all = [
            keys.write.map(|object| Self::Write(object, keys.equals.clone())),
            keys.read.map(|object| Self::Read(object, keys.equals)),
            keys.bit.map(|bit| Self::Bit(bit, keys.becomes == Some(1))),
            keys.pdo.map(Self::Pdo),
            keys.message.map(Self::Message),
            keys.dtc.map(DtcKey::read).transpose()?.map(Self::Dtc),
            keys.nmt.map(Self::Nmt),
            keys.state.map(|states| Self::State(states.into_vec())),
            keys.sync.map(|_| Self::Sync),
            keys.emcy.map(Self::Emcy),
            keys.boot.map(|_| Self::Boot),
            set.map(Self::Set),
            keys.writes.map(Self::Writes),
            lss.map(Self::Lss),
            keys.guard.map(|_| Self::Guard),
        ];
        let mut given = all.into_iter().flatten();
        match (given.next(), given.next()) {
            (Some(trigger), None) => Ok(trigger),
            _ => Err(
                "a trigger is exactly one of write, read, bit, pdo, message, dtc, nmt, state, sync, emcy, boot, set, writes, lss, guard",
            ),
        }
    }
}

impl Trigger {
    /// What must hold when it happens.
    pub fn when(&self) -> &[Condition] {
        if let Self::Message(message) = self { &message.when.0 } else { &[] }
    }

    /// How often in a row it must happen.
    pub fn times(&self) -> u8 {
        if let Self::Message(message) = self { message.times } else { 1 }
    }

    /// Whether only rules know it.
    pub(crate) const fn is_of_rules(&self) -> bool {
        matches!(self, Self::Set(_) | Self::Writes(_) | Self::Lss(_) | Self::Guard)
    }

    /// The same for good, in repeat `nth`.
    #[must_use]
    pub(crate) fn pinned(&self, nth: u16, stride: u16) -> Self {
        match self.clone() {
            Self::Write(object, wanted) => Self::Write(object.pinned(nth, stride), wanted),
            Self::Read(object, wanted) => Self::Read(object.pinned(nth, stride), wanted),
            Self::Bit(bit, becomes) => {
                Self::Bit(BitReference { object: bit.object.pinned(nth, stride), ..bit }, becomes)
            }
            Self::Set(set) => Self::Set(SetTrigger { object: set.object.pinned(nth, stride), ..set }),
            Self::Writes(range) => Self::Writes(range.pinned(nth, stride)),
            other => other,
        }
    }
}

impl Condition {
    /// The same for good, in repeat `nth`.
    #[must_use]
    pub(crate) fn pinned(&self, nth: u16, stride: u16) -> Self {
        match self.clone() {
            Self::Object { object, mask, values, negated } => {
                Self::Object { object: object.pinned(nth, stride), mask, values, negated }
            }
            Self::Inside { object, range } => Self::Inside { object: object.pinned(nth, stride), range },
            Self::Other(all) => Self::Other(all.pinned(nth, stride)),
            other => other,
        }
    }
}
