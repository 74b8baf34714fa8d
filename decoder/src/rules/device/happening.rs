//! What happens to a device, in the words of its rules, and whether a trigger waits for it.

use crate::event::{Abort, Direction, Outcome, SdoTransfer};
use crate::finding::About;
use crate::profile::device::{SetTrigger, Trigger, Wanted};
use crate::profile::object::{Format, Numbers};
use crate::profile::{DataType, Meaning, PdoName, Value, integer, little_endian};
use crate::wire::canopen::ObjectAddress;
use crate::wire::j1939::Pgn;

/// Something that happened at a device.
#[derive(Debug, Clone, Copy)]
pub(super) enum Happening<'a> {
    /// A PDO came.
    Pdo(PdoName),
    /// A J1939 message came, by its name in the profile.
    Message(&'a str, Pgn),
    /// An object was written or read, or its value came in a PDO or message.
    Came(Came<'a>),
    /// The master commands.
    Nmt(&'static str),
    /// The device reports a state, of one of its outputs.
    State(Option<u8>, &'a str),
    /// SYNC with its own identifier.
    Sync,
    /// It reports an error.
    Emcy(u16),
    /// It reports a trouble code.
    Dtc(u32, u8),
    /// It started.
    Boot,
    /// Its state is asked for.
    Guard,
    /// An LSS message of its bus.
    Lss(Lss<'a>),
}

/// A value that came.
#[derive(Debug, Clone, Copy)]
pub(super) struct Came<'a> {
    pub(super) object: ObjectAddress,
    pub(super) way: Way,
    /// The number, where it is one and all of it was seen.
    pub(super) raw: Option<i64>,
    /// The number known before.
    pub(super) before: Option<i64>,
    /// Bytes of a transfer.
    pub(super) bytes: &'a [u8],
    pub(super) meaning: Option<&'a Meaning>,
    /// The node's start was seen, and no value since: its bits are clear.
    pub(super) is_fresh: bool,
}

/// How a value came.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Way {
    /// By SDO to the device, which confirmed it.
    Written,
    /// By SDO to the device, which refused it.
    Refused,
    /// By SDO from the device.
    Read,
    /// In a PDO or message to the device.
    Received,
    /// In a PDO or message of the device.
    Sent,
}

/// An LSS message.
#[derive(Debug, Clone, Copy)]
pub(super) struct Lss<'a> {
    pub(super) service: &'a str,
    pub(super) is_answer: bool,
    /// Byte behind the command specifier, where the service has one that counts.
    pub(super) value: Option<u8>,
}

impl Way {
    /// Whether the value is for the device.
    pub(super) const fn is_command(self) -> bool {
        matches!(self, Self::Written | Self::Refused | Self::Received)
    }

    /// The same for people.
    pub(super) const fn words(self) -> &'static str {
        match self {
            Self::Written => "written",
            Self::Refused => "refused",
            Self::Read => "read",
            Self::Received => "received",
            Self::Sent => "sent",
        }
    }
}

impl<'a> Came<'a> {
    /// The value of a transfer that has an answer; `None` for others.
    pub(super) fn of(transfer: &'a SdoTransfer, before: Option<i64>) -> Option<Self> {
        let answered = match (transfer.outcome, transfer.abort) {
            (Outcome::Complete, _) => true,
            (Outcome::Aborted, Some(Abort { by_client: false, .. })) => false,
            _ => return None,
        };
        let way = match (transfer.direction?, answered) {
            (Direction::Download, true) => Way::Written,
            (Direction::Download, false) => Way::Refused,
            (Direction::Upload, true) => Way::Read,
            (Direction::Upload, false) => return None,
        };
        let is_whole = !transfer.truncated
            && transfer.announced.is_none_or(|size| u64::from(size) == transfer.size)
            && (!transfer.cut_start || way == Way::Read);
        let bytes = if is_whole { transfer.data.as_slice() } else { &[] };
        let meaning = transfer.meaning.as_deref();
        let raw = number(bytes, meaning.and_then(|meaning| meaning.data_type)).and_then(|it| integer(&it));
        Some(Self { object: transfer.object?, way, raw, before, bytes, meaning, is_fresh: false })
    }

    /// The value as people write it.
    pub(super) fn shown(&self) -> String {
        match (self.raw, self.meaning) {
            (Some(raw), Some(meaning)) => show(meaning, raw),
            (Some(raw), None) => format!("{:X}h", raw.cast_unsigned()),
            (None, _) => "value".to_owned(),
        }
    }
}

/// A number by its meaning; of bits only the word, as their names would fill the line.
pub(super) fn show(meaning: &Meaning, raw: i64) -> String {
    let digits = meaning.data_type.and_then(DataType::bits).map_or(0, |bits| usize::from(bits.div_ceil(4)));
    match (&meaning.bits, meaning.format) {
        (Some(_), _) => format!("{:0digits$X}h", raw.cast_unsigned()),
        // A signature: the first character is in the least significant byte.
        (None, Format::Ascii) => {
            let bytes = raw.to_le_bytes().into_iter().take(digits / 2);
            format!("'{}'", bytes.map(char::from).collect::<String>().escape_default())
        }
        (None, _) => meaning.show(&meaning.number(raw)),
    }
}

/// Bytes as a number. An expedited transfer that does not tell its size brings more of them than the type has.
fn number(bytes: &[u8], data_type: Option<DataType>) -> Option<Value> {
    let width = data_type.and_then(DataType::bits).map(|bits| usize::from(bits.div_ceil(8)));
    match (data_type, width.and_then(|width| bytes.get(..width))) {
        (Some(data_type), Some(bytes)) if bytes.len() <= 8 => Some(data_type.number(little_endian(bytes))),
        _ if bytes.is_empty() || bytes.len() > 8 => None,
        _ => Some(Value::Unsigned(little_endian(bytes))),
    }
}

/// A number through a mask.
pub(super) fn masked(raw: i64, mask: u64) -> i64 {
    if mask == u64::MAX { raw } else { (raw.cast_unsigned() & mask).cast_signed() }
}

impl Happening<'_> {
    /// Whether it is what a trigger in `on` waits for: there an attempt counts.
    pub(super) fn starts(&self, trigger: &Trigger) -> bool {
        self.is(trigger, true)
    }

    /// Whether it is what a trigger elsewhere waits for: there only what took effect counts.
    pub(super) fn fulfils(&self, trigger: &Trigger) -> bool {
        self.is(trigger, false)
    }

    fn is(&self, trigger: &Trigger, attempts: bool) -> bool {
        let counts = |way: Way| way == Way::Written || attempts && way == Way::Refused;
        match (self, trigger) {
            (Self::Came(came), Trigger::Write(of, wanted)) => {
                came.object == of.object && counts(came.way) && fits(came, wanted.as_ref())
            }
            (Self::Came(came), Trigger::Read(of, wanted)) => {
                came.object == of.object && came.way == Way::Read && fits(came, wanted.as_ref())
            }
            (Self::Came(came), Trigger::Writes(range)) => counts(came.way) && range.covers(came.object, 0, 0),
            (Self::Came(came), Trigger::Set(set)) => {
                came.object == set.object.object
                    && (counts(came.way) || came.way == Way::Received)
                    && is_set(came, set)
            }
            (Self::Came(came), Trigger::Bit(bit, becomes)) => {
                let of = |word: i64| word >> bit.bit & 1 == i64::from(*becomes);
                let before = came.before.or(came.is_fresh.then_some(0));
                came.object == bit.object.object
                    && !matches!(came.way, Way::Refused | Way::Read)
                    && came.raw.is_some_and(of)
                    && before.is_some_and(|before| !of(before))
            }
            (Self::Pdo(name), Trigger::Pdo(wanted)) => name == wanted,
            (Self::Message(name, _), Trigger::Message(wanted)) => *name == wanted.name,
            (Self::Nmt(command), Trigger::Nmt(wanted)) => command == wanted,
            (Self::State(_, state), Trigger::State(wanted)) => wanted.iter().any(|it| it == state),
            (Self::Emcy(code), Trigger::Emcy(wanted)) => code == wanted,
            (Self::Dtc(spn, fmi), Trigger::Dtc(wanted)) => wanted.is_none_or(|it| it == (*spn, *fmi)),
            (Self::Sync, Trigger::Sync) | (Self::Boot, Trigger::Boot) | (Self::Guard, Trigger::Guard) => true,
            (Self::Lss(lss), Trigger::Lss(wanted)) => {
                lss.service == wanted.service
                    && lss.is_answer == wanted.answer
                    && is_any(lss.value.map(i64::from), wanted.values.as_ref())
            }
            _ => false,
        }
    }

    /// What of the node a finding about it is about.
    pub(super) fn about(&self) -> About {
        match self {
            Self::Came(came) => About::Object(came.object),
            Self::Message(_, pgn) => About::Pgn(pgn.number()),
            Self::Emcy(code) => About::Code(*code),
            Self::Dtc(spn, fmi) => About::Fault(*spn, *fmi),
            Self::Pdo(name) => About::Name(name.to_string().into()),
            Self::State(Some(channel), _) => About::Name(format!("channel {channel}").into()),
            _ => About::Whole,
        }
    }

    /// Whether it is a value of this object.
    pub(super) fn is_of(&self, object: Option<ObjectAddress>) -> bool {
        matches!(self, Self::Came(came) if Some(came.object) == object)
    }

    /// The object that a count goes by, where a trigger speaks of many.
    pub(super) fn counted(&self, trigger: &Trigger) -> Option<ObjectAddress> {
        match (self, trigger) {
            (Self::Came(came), Trigger::Writes(_)) => Some(came.object),
            _ => None,
        }
    }

    /// What happened, in words.
    pub(super) fn words(&self) -> String {
        match self {
            Self::Pdo(name) => name.to_string(),
            Self::Message(name, _) => (*name).to_owned(),
            Self::Came(came) => format!("{} {}", came.shown(), came.way.words()),
            Self::Nmt(command) => format!("NMT {command}"),
            Self::State(_, state) => format!("state {state}"),
            Self::Sync => "SYNC".to_owned(),
            Self::Emcy(code) => format!("EMCY {code:04X}"),
            Self::Dtc(spn, fmi) => format!("SPN {spn} FMI {fmi}"),
            Self::Boot => "start".to_owned(),
            Self::Guard => "guarding request".to_owned(),
            Self::Lss(lss) => format!("LSS {}", lss.service),
        }
    }
}

fn fits(came: &Came<'_>, wanted: Option<&Wanted>) -> bool {
    match wanted {
        None => true,
        Some(Wanted::Text(text)) => text.as_bytes() == came.bytes,
        Some(Wanted::Numbers(numbers)) => came.raw.is_some_and(|raw| numbers.contains(raw)),
    }
}

fn is_set(came: &Came<'_>, set: &SetTrigger) -> bool {
    let through = |raw: i64| masked(raw, set.mask);
    let Some(raw) = came.raw.map(through) else { return set.values.is_none() && !set.changed };
    let is_meant = set.values.as_ref().is_none_or(|values| values.contains(raw) != set.negated);
    is_meant && (!set.changed || came.before.is_some_and(|before| through(before) != raw))
}

fn is_any(value: Option<i64>, wanted: Option<&Numbers>) -> bool {
    wanted.is_none_or(|wanted| value.is_some_and(|value| wanted.contains(value)))
}
