//! Which rules look at an event: a list a kind, and for PDOs, of which most events are made, a list a class.

use strum::EnumCount as _;

use crate::event::{Event, EventKind, Kind, Pdo};
use crate::profile::PdoDirection;
use crate::query::KindSet;

/// Classes of PDOs: sent or received by the node, request or data, changed or as before, fields known for sure or not.
const PDO_CLASSES: usize = 16;

const RECEIVED: usize = 1;
const REQUEST: usize = 2;
const ROUTINE: usize = 4;
const MAPPED: usize = 8;

/// Whether a class of PDOs is meant.
type IsMeant = fn(usize) -> bool;

/// Words for some PDOs among the kinds that a rule declares.
const PDO_WORDS: [(&str, IsMeant); 7] = [
    ("pdo", |_| true),
    ("pdo-mapped", |class| class & (REQUEST | MAPPED) == MAPPED),
    ("pdo-mapped-changed", |class| class & (REQUEST | ROUTINE | MAPPED) == MAPPED),
    ("tpdo", |class| class & (RECEIVED | REQUEST) == 0),
    ("rpdo", |class| class & (RECEIVED | REQUEST) == RECEIVED),
    ("pdo-changed", |class| class & (REQUEST | ROUTINE) == 0),
    ("pdo-request", |class| class & REQUEST != 0),
];

/// Places of rules by what they look at.
#[derive(Debug)]
pub(super) struct Interests {
    by_kind: [Vec<u16>; Kind::COUNT],
    pdo: [Vec<u16>; PDO_CLASSES],
    /// Rules that look at PDOs, in their order: place, the classes as bits, whether they want them now.
    members: Vec<(u16, u16, bool)>,
}

impl Default for Interests {
    fn default() -> Self {
        Self {
            by_kind: std::array::from_fn(|_| Vec::new()),
            pdo: std::array::from_fn(|_| Vec::new()),
            members: Vec::new(),
        }
    }
}

impl Interests {
    /// A rule looks at the kinds it declares, and at the PDOs its words mean.
    pub(super) fn declared(&mut self, words: &[&str], place: u16) {
        let kinds = KindSet::by_name(|name| name != "pdo" && words.contains(&name));
        self.kinds(kinds, place);
        let wanted: Vec<_> = PDO_WORDS.iter().filter(|(word, _)| words.contains(word)).collect();
        let classes = (0..PDO_CLASSES).filter(|class| wanted.iter().any(|(_, means)| means(*class)));
        let classes = classes.fold(0_u16, |all, class| all | 1 << class);
        if classes != 0 {
            self.members.push((place, classes, true));
            self.list_pdos();
        }
    }

    /// A rule looks at all events of these kinds.
    pub(super) fn kinds(&mut self, kinds: KindSet, place: u16) {
        for kind in kinds.kinds() {
            if let Some(list) = self.by_kind.get_mut(kind as usize) {
                list.push(place);
            }
        }
        if kinds.contains_name("pdo") {
            self.members.push((place, u16::MAX, true));
            self.list_pdos();
        }
    }

    /// A rule wants PDOs from now on, or no longer.
    #[inline]
    pub(super) fn want_pdos(&mut self, place: u16, wants: bool) {
        let member = self.members.iter_mut().find(|(member, ..)| *member == place);
        if let Some((_, _, wanted)) = member.filter(|(_, _, wanted)| *wanted != wants) {
            *wanted = wants;
            self.list_pdos();
        }
    }

    #[cold]
    fn list_pdos(&mut self) {
        for (class, list) in self.pdo.iter_mut().enumerate() {
            let wanting = self
                .members
                .iter()
                .filter(|(_, classes, wants)| (*wants || class & REQUEST != 0) && classes >> class & 1 == 1);
            list.clear();
            list.extend(wanting.map(|(place, ..)| *place));
        }
    }

    /// What a rule looks at changed. It stands first in every list, as it explains others.
    pub(super) fn renew(&mut self, place: u16, kinds: KindSet) {
        for list in &mut self.by_kind {
            list.retain(|other| *other != place);
        }
        self.members.retain(|(member, ..)| *member != place);
        for kind in kinds.kinds() {
            if let Some(list) = self.by_kind.get_mut(kind as usize) {
                list.insert(0, place);
            }
        }
        if kinds.contains_name("pdo") {
            self.members.insert(0, (place, u16::MAX, true));
        }
        self.list_pdos();
    }

    /// Who looks at an event that is no PDO, in the order of the rules.
    #[inline]
    pub(super) fn of(&self, kind: &EventKind) -> &[u16] {
        self.by_kind.get(kind.kind() as usize).map_or(&[], Vec::as_slice)
    }

    /// Who looks at a PDO.
    #[inline]
    pub(super) fn of_pdo(&self, pdo: &Pdo, event: &Event) -> &[u16] {
        self.pdo.get(class(event, pdo)).map_or(&[], Vec::as_slice)
    }
}

#[inline]
fn class(event: &Event, pdo: &Pdo) -> usize {
    let bit = |is_set: bool, bit: usize| if is_set { bit } else { 0 };
    bit(pdo.name.direction == PdoDirection::Receive, RECEIVED)
        | bit(pdo.is_request, REQUEST)
        | bit(event.routine, ROUTINE)
        | bit(pdo.layout.as_ref().is_some_and(|layout| !layout.assumed), MAPPED)
}

/// Whether a rule may declare this word.
#[cfg(test)]
pub(super) fn is_known(word: &str) -> bool {
    KindSet::ALL.contains_name(word) || PDO_WORDS.iter().any(|(known, _)| *known == word)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::rules::declarations;

    #[test]
    fn rules_declare_kinds_there_are() {
        for rule in declarations() {
            for word in rule.kinds {
                assert!(is_known(word), "{}: {word}", rule.name);
            }
        }
    }

    #[test]
    fn words_mean_classes() {
        let mut interests = Interests::default();
        interests.declared(&["rpdo", "sync"], 1);
        interests.declared(&["pdo-changed"], 2);
        interests.declared(&["pdo-request", "tpdo"], 3);
        let lists: Vec<_> = interests.pdo.iter().map(Vec::as_slice).collect();
        let wanted: [&[u16]; 8] = [&[2, 3], &[1, 2], &[3], &[3], &[3], &[1], &[3], &[3]];
        assert_eq!(lists, [wanted, wanted].concat());
        assert_eq!(interests.by_kind.iter().flatten().count(), 1);
        let mut interests = Interests::default();
        interests.declared(&["pdo-mapped"], 1);
        interests.declared(&["pdo-mapped-changed"], 2);
        let lists: Vec<_> = interests.pdo.iter().skip(MAPPED).map(Vec::as_slice).collect();
        let wanted: [&[u16]; 8] = [&[1, 2], &[1, 2], &[], &[], &[1], &[1], &[], &[]];
        assert_eq!(lists, wanted);
        assert!(interests.pdo.iter().take(MAPPED).all(Vec::is_empty));
    }
}
