//! Sets of event kinds: those a filter can match, and those that have a field.

use serde::de::{Deserialize, Deserializer, Error as _};
use strum::EnumCount as _;

use crate::event::{EventKind, Kind};

/// Set of event kinds, one bit per kind.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct KindSet(u64);

impl KindSet {
    /// Empty set.
    pub const NONE: Self = Self(0);
    /// Set of all kinds.
    pub const ALL: Self = Self((1 << Kind::COUNT) - 1);

    /// Kinds for which `pick` returns true.
    pub fn choose(pick: impl Fn(Kind) -> bool) -> Self {
        Kind::ALL.iter().copied().filter(|kind| pick(*kind)).collect()
    }

    /// Kinds for whose names `pick` returns true.
    pub fn by_name(pick: impl Fn(&str) -> bool) -> Self {
        Self::choose(|kind| pick(kind.name()))
    }

    /// Kinds of events that are decoded from a single frame.
    pub fn of_frames() -> Self {
        Self::choose(Kind::is_of_one_frame)
    }

    /// Whether the set contains the kind of this event.
    #[inline]
    pub fn contains(self, kind: &EventKind) -> bool {
        self.0 >> kind.kind() as u32 & 1 == 1
    }

    /// Whether the set contains the kind with this name.
    pub fn contains_name(self, name: &str) -> bool {
        self.names().any(|own| own == name)
    }

    /// Kinds in numerical order.
    pub fn kinds(self) -> impl Iterator<Item = Kind> {
        Kind::ALL.iter().copied().filter(move |kind| self.0 >> *kind as u32 & 1 == 1)
    }

    /// Names of the kinds in numerical order.
    pub fn names(self) -> impl Iterator<Item = &'static str> {
        self.kinds().map(Kind::name)
    }

    /// Union of both sets.
    #[must_use]
    pub const fn or(self, other: Self) -> Self {
        Self(self.0 | other.0)
    }

    /// Intersection of both sets.
    #[must_use]
    pub const fn and(self, other: Self) -> Self {
        Self(self.0 & other.0)
    }

    /// All kinds outside the set.
    #[must_use]
    pub const fn complement(self) -> Self {
        Self(!self.0 & Self::ALL.0)
    }
}

impl FromIterator<Kind> for KindSet {
    fn from_iter<I: IntoIterator<Item = Kind>>(kinds: I) -> Self {
        Self(kinds.into_iter().fold(0, |set, kind| set | 1 << kind as u32))
    }
}

/// From a list of kind names.
impl<'de> Deserialize<'de> for KindSet {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        let names = Vec::<String>::deserialize(deserializer)?;
        match names.iter().find(|name| !Self::ALL.contains_name(name)) {
            Some(unknown) => Err(D::Error::custom(format!("unknown kind {unknown:?}"))),
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
        assert_eq!(KindSet::ALL.names().count(), Kind::COUNT);
    }
}
