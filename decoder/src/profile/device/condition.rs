//! Conditions and triggers: what must hold, what must happen.

use serde::Deserialize;

use super::network::NmtName;
use crate::profile::layout::PdoName;
use crate::profile::object::{Numbers, OneOrMany};
use crate::profile::reference::{BitReference, Reference};

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
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct ConditionKeys {
    nmt: Option<NmtName>,
    object: Option<Reference>,
    equals: Option<Numbers>,
    not: Option<Numbers>,
    mask: Option<u64>,
    state: Option<OneOrMany<String>>,
    sync: Option<bool>,
    no_error: Option<bool>,
    no_procedure: Option<bool>,
    younger: Option<u32>,
    visible: Option<bool>,
}

impl TryFrom<ConditionKeys> for Condition {
    type Error = &'static str;

    fn try_from(keys: ConditionKeys) -> Result<Self, &'static str> {
        let object = match (keys.object, keys.equals, keys.not) {
            (None, None, None) => None,
            (Some(object), Some(values), None) => Some((object, values, false)),
            (Some(object), None, Some(values)) => Some((object, values, true)),
            _ => return Err("a condition on an object needs object and either equals or not"),
        };
        let all = [
            keys.nmt.map(Self::Nmt),
            object.map(|(object, values, negated)| Self::Object {
                object,
                mask: keys.mask.unwrap_or(u64::MAX),
                values,
                negated,
            }),
            keys.state.map(|states| Self::State(states.into_vec())),
            keys.sync.map(|_| Self::Sync),
            keys.no_error.map(|_| Self::NoError),
            keys.no_procedure.map(|_| Self::NoProcedure),
            keys.younger.map(Self::Younger),
            keys.visible.map(|_| Self::Invisible),
        ];
        let mut given = all.into_iter().flatten();
        match (given.next(), given.next()) {
            (Some(condition), None) => Ok(condition),
            _ => Err(
                "a condition is exactly one of nmt, object, state, sync, no_error, no_procedure, younger, visible",
            ),
        }
    }
}

/// Conditions that must all hold.
#[derive(Debug, Clone, PartialEq, Default, Deserialize)]
#[serde(from = "OneOrMany<Condition>")]
pub struct Conditions(pub Vec<Condition>);

impl From<OneOrMany<Condition>> for Conditions {
    fn from(list: OneOrMany<Condition>) -> Self {
        Self(list.into_vec())
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
}

impl TryFrom<TriggerKeys> for Trigger {
    type Error = &'static str;

    fn try_from(keys: TriggerKeys) -> Result<Self, &'static str> {
        if keys.equals.is_some() && keys.write.is_none() && keys.read.is_none() {
            return Err("equals goes with write or read");
        }
        if keys.bit.is_some() != keys.becomes.is_some() || keys.becomes.is_some_and(|value| value > 1) {
            return Err("bit and becomes = 0 or 1 go together");
        }
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
        ];
        let mut given = all.into_iter().flatten();
        match (given.next(), given.next()) {
            (Some(trigger), None) => Ok(trigger),
            _ => Err(
                "a trigger is exactly one of write, read, bit, pdo, message, dtc, nmt, state, sync, emcy, boot",
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

    /// The same for good, in repeat `nth`.
    #[must_use]
    pub fn pinned(&self, nth: u16, stride: u16) -> Self {
        match self.clone() {
            Self::Write(object, wanted) => Self::Write(object.pinned(nth, stride), wanted),
            Self::Read(object, wanted) => Self::Read(object.pinned(nth, stride), wanted),
            Self::Bit(bit, becomes) => {
                Self::Bit(BitReference { object: bit.object.pinned(nth, stride), ..bit }, becomes)
            }
            other => other,
        }
    }
}

impl Condition {
    /// The same for good, in repeat `nth`.
    #[must_use]
    pub fn pinned(&self, nth: u16, stride: u16) -> Self {
        match self.clone() {
            Self::Object { object, mask, values, negated } => {
                Self::Object { object: object.pinned(nth, stride), mask, values, negated }
            }
            other => other,
        }
    }
}
