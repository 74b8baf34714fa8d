//! Sets of event kinds: what a filter can match at all, and which kinds have a field.

use serde::de::{Deserialize, Deserializer, Error as _};

use crate::event::EventKind;

/// How many kinds of events there are.
pub const KIND_COUNT: usize = 47;

/// Names of all kinds; a kind's place here is its number in a [`KindSet`].
const NAMES: [&str; KIND_COUNT] = [
    "nmt-command",
    "nmt-state",
    "boot-up",
    "heartbeat",
    "guard-request",
    "guard-reply",
    "node-lost",
    "node-back",
    "sync",
    "time",
    "emcy",
    "pdo",
    "sdo-transfer",
    "lss",
    "node-id-change",
    "node-identified",
    "device-state",
    "bits-changed",
    "set-point",
    "mode",
    "procedure",
    "conflict",
    "object-change",
    "can-error",
    "frame",
    "malformed",
    "evicted",
    "clock-step",
    "bus-silent",
    "lost-frames",
    "unreadable",
    "note",
    "j1939-message",
    "j1939-transfer",
    "j1939-request",
    "acknowledgement",
    "address-claim",
    "commanded-address",
    "dtc",
    "message-gap",
    "transport-irregularity",
    "isotp-transfer",
    "uds-exchange",
    "finding-opened",
    "finding-closed",
    "test-case",
    "link",
];

/// What a single frame can say by itself; everything else is made of several, or of what was known before.
const OF_FRAMES: &[&str] = &[
    "nmt-command",
    "boot-up",
    "heartbeat",
    "guard-request",
    "guard-reply",
    "sync",
    "time",
    "emcy",
    "pdo",
    "lss",
    "can-error",
    "frame",
    "malformed",
    "j1939-message",
    "j1939-request",
    "acknowledgement",
    "address-claim",
    "commanded-address",
    "test-case",
];

/// Place in [`NAMES`]. A new kind does not compile before it has one.
const fn number(kind: &EventKind) -> u32 {
    match kind {
        EventKind::NmtCommand { .. } => 0,
        EventKind::NmtState(_) => 1,
        EventKind::BootUp { .. } => 2,
        EventKind::Heartbeat { .. } => 3,
        EventKind::GuardRequest => 4,
        EventKind::GuardReply { .. } => 5,
        EventKind::NodeLost(_) => 6,
        EventKind::NodeBack(_) => 7,
        EventKind::Sync { .. } => 8,
        EventKind::Time { .. } => 9,
        EventKind::Emcy(_) => 10,
        EventKind::Pdo(_) => 11,
        EventKind::SdoTransfer(_) => 12,
        EventKind::Lss { .. } => 13,
        EventKind::NodeIdChange { .. } => 14,
        EventKind::NodeIdentified(_) => 15,
        EventKind::DeviceState(_) => 16,
        EventKind::BitsChanged(_) => 17,
        EventKind::SetPoint(_) => 18,
        EventKind::Mode(_) => 19,
        EventKind::Procedure(_) => 20,
        EventKind::Conflict(_) => 21,
        EventKind::ObjectChange(_) => 22,
        EventKind::CanError(_) => 23,
        EventKind::Frame(_) => 24,
        EventKind::Malformed { .. } => 25,
        EventKind::Evicted { .. } => 26,
        EventKind::ClockStep { .. } => 27,
        EventKind::BusSilent { .. } => 28,
        EventKind::LostFrames { .. } => 29,
        EventKind::Unreadable { .. } => 30,
        EventKind::Note { .. } => 31,
        EventKind::J1939Message(_) => 32,
        EventKind::J1939Transfer(_) => 33,
        EventKind::J1939Request(_) => 34,
        EventKind::Acknowledgement(_) => 35,
        EventKind::AddressClaim(_) => 36,
        EventKind::CommandedAddress(_) => 37,
        EventKind::Dtc(_) => 38,
        EventKind::MessageGap(_) => 39,
        EventKind::TransportIrregularity(_) => 40,
        EventKind::IsoTpTransfer(_) => 41,
        EventKind::UdsExchange(_) => 42,
        EventKind::FindingOpened(_) => 43,
        EventKind::FindingClosed(_) => 44,
        EventKind::TestCase(_) => 45,
        EventKind::Link { .. } => 46,
    }
}

/// A set of event kinds.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct KindSet(u64);

impl KindSet {
    /// No kind.
    pub const NONE: Self = Self(0);
    /// Every kind.
    pub const ALL: Self = Self((1 << NAMES.len()) - 1);

    /// The kinds whose names `pick` likes.
    pub fn by_name(pick: impl Fn(&str) -> bool) -> Self {
        let picked = NAMES.iter().enumerate().filter(|(_, name)| pick(name));
        Self(picked.fold(0, |set, (number, _)| set | 1 << number))
    }

    /// The kinds of what a single frame can say by itself.
    pub fn of_frames() -> Self {
        Self::by_name(|name| OF_FRAMES.contains(&name))
    }

    /// Whether an event is of one of these kinds.
    pub const fn contains(self, kind: &EventKind) -> bool {
        self.0 >> number(kind) & 1 == 1
    }

    /// Whether the kind of this name is one of them.
    pub fn contains_name(self, name: &str) -> bool {
        self.names().any(|own| own == name)
    }

    /// Places of the kinds, each below [`KIND_COUNT`].
    pub fn places(self) -> impl Iterator<Item = usize> {
        (0..KIND_COUNT).filter(move |place| self.0 >> place & 1 == 1)
    }

    /// The place of an event's kind.
    #[inline]
    pub const fn place(kind: &EventKind) -> usize {
        number(kind) as usize
    }

    /// Names of the kinds.
    pub fn names(self) -> impl Iterator<Item = &'static str> {
        NAMES.iter().enumerate().filter(move |(number, _)| self.0 >> number & 1 == 1).map(|(_, name)| *name)
    }

    /// The kinds of either set.
    #[must_use]
    pub const fn or(self, other: Self) -> Self {
        Self(self.0 | other.0)
    }

    /// The kinds of both sets.
    #[must_use]
    pub const fn and(self, other: Self) -> Self {
        Self(self.0 & other.0)
    }

    /// All other kinds.
    #[must_use]
    pub const fn complement(self) -> Self {
        Self(!self.0 & Self::ALL.0)
    }
}

/// A list of names.
impl<'de> Deserialize<'de> for KindSet {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        let names = Vec::<String>::deserialize(deserializer)?;
        match names.iter().find(|name| !NAMES.contains(&name.as_str())) {
            Some(unknown) => Err(D::Error::custom(format!("there is no kind {unknown:?}"))),
            None => Ok(Self::by_name(|name| names.iter().any(|own| own == name))),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn set_arithmetic() {
        let some = KindSet::by_name(|name| name.starts_with("node-"));
        assert_eq!(
            some.names().collect::<Vec<_>>(),
            ["node-lost", "node-back", "node-id-change", "node-identified"]
        );
        assert!(!some.complement().contains_name("node-lost"));
        assert!(some.complement().contains(&EventKind::GuardRequest));
        assert_eq!(some.or(some.complement()), KindSet::ALL);
        assert_eq!(some.and(some.complement()), KindSet::NONE);
        assert_eq!(KindSet::ALL.names().count(), NAMES.len());
    }
}
