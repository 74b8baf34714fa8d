//! Sets of event kinds: those a filter can match, those that have a field, and those that a rule receives.

use serde::de::{Deserialize, Deserializer, Error as _};

use super::kind::{EventKind, Kind};

/// Number of words of a set: room for 128 kinds.
const WORDS: usize = 2;

/// Set of event kinds, one bit per kind.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct KindSet([u64; WORDS]);

/// Index of the word of a kind, and its bit in this word.
const fn position(kind: Kind) -> (usize, u64) {
    (kind as usize / 64, 1 << (kind as usize % 64))
}

impl KindSet {
    /// Empty set.
    pub const NONE: Self = Self([0; WORDS]);
    /// Set of all kinds.
    pub const ALL: Self = Self::of(Kind::ALL);
    /// Kinds of events that report findings.
    pub const FINDINGS: Self = Self::of(&[Kind::FindingOpened, Kind::FindingClosed]);

    /// The listed kinds.
    #[expect(
        clippy::indexing_slicing,
        reason = "`at` is below the length; a kind beyond the last word fails to compile"
    )]
    pub const fn of(kinds: &[Kind]) -> Self {
        let mut words = [0; WORDS];
        let mut at = 0;
        while at < kinds.len() {
            let (word, bit) = position(kinds[at]);
            words[word] |= bit;
            at += 1;
        }
        Self(words)
    }

    /// Kinds for which `pick` returns true.
    pub fn choose(pick: impl Fn(Kind) -> bool) -> Self {
        Kind::ALL.iter().copied().filter(|kind| pick(*kind)).collect()
    }

    /// Kinds of events that are decoded from a single frame.
    pub fn of_frames() -> Self {
        Self::choose(Kind::is_of_one_frame)
    }

    /// Whether the set contains the kind of this event.
    #[inline]
    pub fn contains(self, kind: &EventKind) -> bool {
        self.contains_kind(kind.kind())
    }

    /// Whether the set contains a kind.
    #[inline]
    pub fn contains_kind(self, kind: Kind) -> bool {
        let (word, bit) = position(kind);
        self.0.get(word).is_some_and(|word| word & bit != 0)
    }

    /// Kinds in numerical order.
    pub fn kinds(self) -> impl Iterator<Item = Kind> {
        Kind::ALL.iter().copied().filter(move |kind| self.contains_kind(*kind))
    }

    /// Names of the kinds in numerical order.
    pub fn names(self) -> impl Iterator<Item = &'static str> {
        self.kinds().map(Kind::name)
    }

    /// Union of both sets.
    #[must_use]
    pub const fn or(self, Self([low, high]): Self) -> Self {
        Self([self.0[0] | low, self.0[1] | high])
    }

    /// Intersection of both sets.
    #[must_use]
    pub const fn and(self, Self([low, high]): Self) -> Self {
        Self([self.0[0] & low, self.0[1] & high])
    }

    /// All kinds outside the set.
    #[must_use]
    pub const fn complement(self) -> Self {
        Self([!self.0[0], !self.0[1]]).and(Self::ALL)
    }
}

impl FromIterator<Kind> for KindSet {
    fn from_iter<I: IntoIterator<Item = Kind>>(kinds: I) -> Self {
        kinds.into_iter().fold(Self::NONE, |set, kind| set.or(Self::of(&[kind])))
    }
}

/// From a list of kind names.
impl<'de> Deserialize<'de> for KindSet {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        let names = Vec::<String>::deserialize(deserializer)?;
        let kind = |name: &String| {
            Kind::from_name(name).ok_or_else(|| D::Error::custom(format!("unknown kind {name:?}")))
        };
        names.iter().map(kind).collect()
    }
}

#[cfg(test)]
mod tests {
    use strum::EnumCount as _;

    use super::*;

    const _: () = assert!(Kind::COUNT <= 64 * WORDS);

    #[test]
    fn set_arithmetic() {
        let some = KindSet::of(&[Kind::NodeBack, Kind::NodeLost]);
        assert_eq!(some.names().collect::<Vec<_>>(), ["node-lost", "node-back"]);
        assert!(!some.complement().contains_kind(Kind::NodeLost));
        assert!(some.complement().contains(&EventKind::GuardRequest));
        assert_eq!(some.or(some.complement()), KindSet::ALL);
        assert_eq!(some.and(some.complement()), KindSet::NONE);
        assert_eq!(KindSet::ALL.names().count(), Kind::COUNT);
    }

    #[test]
    fn the_second_word_is_a_set_of_its_own() {
        let (low, high) = (KindSet([1 << 63, 0]), KindSet([0, 1]));
        assert_eq!(low.and(high), KindSet::NONE);
        assert_eq!(low.or(high), KindSet([1 << 63, 1]));
        assert!(!high.contains_kind(Kind::NmtCommand));
    }

    #[test]
    fn names_of_kinds_are_read() {
        assert_eq!(Kind::from_name("isotp-transfer"), Some(Kind::IsoTpTransfer));
        assert_eq!(Kind::from_name("iso-tp-transfer"), None);
        assert!(Kind::ALL.iter().all(|kind| Kind::from_name(kind.name()) == Some(*kind)));
    }
}
