//! Dispatch tables from events to rules: one list per event kind, and one list per class of PDOs, since most
//! events are PDOs.

use strum::EnumCount as _;

use crate::event::{Event, EventKind, Kind, Pdo};
use crate::profile::PdoDirection;
use crate::query::KindSet;
use crate::wire::canopen::ObjectAddress;

/// Combinations of four properties: direction, request or data, payload unchanged or not, mapping confirmed
/// or not.
const PDO_CLASSES: usize = 16;

const RECEIVED: usize = 1;
const REQUEST: usize = 2;
const ROUTINE: usize = 4;
const MAPPED: usize = 8;

/// Predicate on a PDO class.
type ClassPredicate = fn(usize) -> bool;

/// Words with which a rule declares a subset of all PDOs.
const PDO_WORDS: [(&str, ClassPredicate); 8] = [
    ("pdo", |_| true),
    ("pdo-mapped", |class| class & (REQUEST | MAPPED) == MAPPED),
    ("pdo-mapped-changed", |class| class & (REQUEST | ROUTINE | MAPPED) == MAPPED),
    ("tpdo", |class| class & (RECEIVED | REQUEST) == 0),
    ("rpdo", |class| class & (RECEIVED | REQUEST) == RECEIVED),
    ("rpdo-changed", |class| class & (RECEIVED | REQUEST | ROUTINE) == RECEIVED),
    ("pdo-changed", |class| class & (REQUEST | ROUTINE) == 0),
    ("pdo-request", |class| class & REQUEST != 0),
];

/// Word with which a rule declares SDO transfers of objects in the communication profile area only (CiA 301 §7.4.1).
const SDO_OF_COMMUNICATION: &str = "sdo-transfer-communication";

/// Name of the event kind of SDO transfers.
const SDO: &str = "sdo-transfer";

/// Indices of the objects in this area.
const COMMUNICATION: std::ops::Range<u16> = 0x1000..0x2000;

/// Indices of the rules that receive an event.
#[derive(Debug)]
pub(super) struct Interests {
    by_kind: [Vec<u16>; Kind::COUNT],
    /// Rules that also receive SDO transfers of objects outside of [`COMMUNICATION`].
    other_objects: Vec<u16>,
    pdo: [Vec<u16>; PDO_CLASSES],
    /// Rules that receive PDOs, in rule order: index, bit mask of the classes, whether the rule wants PDOs
    /// now.
    members: Vec<(u16, u16, bool)>,
}

impl Default for Interests {
    fn default() -> Self {
        Self {
            by_kind: std::array::from_fn(|_| Vec::new()),
            other_objects: Vec::new(),
            pdo: std::array::from_fn(|_| Vec::new()),
            members: Vec::new(),
        }
    }
}

impl Interests {
    /// Registers a rule for the event kinds and PDO words that it declares.
    pub(super) fn declared(&mut self, words: &[&str], place: u16) {
        let is_limited = words.contains(&SDO_OF_COMMUNICATION);
        let kinds =
            KindSet::by_name(|name| name != "pdo" && (words.contains(&name) || is_limited && name == SDO));
        self.kinds(kinds, place);
        if is_limited {
            self.other_objects.retain(|other| *other != place);
        }
        let wanted: Vec<_> = PDO_WORDS.iter().filter(|(word, _)| words.contains(word)).collect();
        let classes = (0..PDO_CLASSES).filter(|class| wanted.iter().any(|(_, means)| means(*class)));
        let classes = classes.fold(0_u16, |all, class| all | 1 << class);
        if classes != 0 {
            self.members.push((place, classes, true));
            self.list_pdos();
        }
    }

    /// Registers a rule for all events of these kinds.
    pub(super) fn kinds(&mut self, kinds: KindSet, place: u16) {
        for kind in kinds.kinds() {
            if let Some(list) = self.by_kind.get_mut(kind as usize) {
                list.push(place);
            }
        }
        if kinds.contains_name(SDO) {
            self.other_objects.push(place);
        }
        if kinds.contains_name("pdo") {
            self.members.push((place, u16::MAX, true));
            self.list_pdos();
        }
    }

    /// Rules that have declared PDOs.
    pub(super) fn with_pdos(&self) -> impl Iterator<Item = u16> {
        self.members.iter().map(|(place, ..)| *place)
    }

    /// Enables or disables the delivery of PDOs to a rule.
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

    /// Replaces the event kinds of a rule and moves it to the front of every list: device rules run first
    /// because their findings can explain others.
    pub(super) fn renew(&mut self, place: u16, kinds: KindSet) {
        for list in &mut self.by_kind {
            list.retain(|other| *other != place);
        }
        self.other_objects.retain(|other| *other != place);
        if kinds.contains_name(SDO) {
            self.other_objects.insert(0, place);
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

    /// Rules for an event other than a PDO, in rule order.
    #[inline]
    pub(super) fn of(&self, kind: &EventKind) -> &[u16] {
        match kind {
            EventKind::SdoTransfer(transfer) => self.of_transfer(transfer.object),
            _ => self.of_kind(kind.kind()),
        }
    }

    fn of_transfer(&self, object: Option<ObjectAddress>) -> &[u16] {
        let is_of_communication = object.is_some_and(|object| COMMUNICATION.contains(&object.index));
        if is_of_communication { self.of_kind(Kind::SdoTransfer) } else { &self.other_objects }
    }

    #[inline]
    fn of_kind(&self, kind: Kind) -> &[u16] {
        self.by_kind.get(kind as usize).map_or(&[], Vec::as_slice)
    }

    /// Rules for a PDO or message after `event` with another content or the same; `true` for those that receive it only
    /// if its content changes.
    pub(super) fn of_next(&self, event: &Event) -> impl Iterator<Item = (u16, bool)> {
        let (changed, unchanged) = match &event.kind {
            EventKind::Pdo(pdo) => {
                let class = class(event, pdo);
                let list = |class: usize| self.pdo.get(class).map_or(&[][..], Vec::as_slice);
                (list(class & !ROUTINE), list(class | ROUTINE))
            }
            kind => (self.of(kind), self.of(kind)),
        };
        changed.iter().map(|place| (*place, !unchanged.contains(place)))
    }

    /// Rules for a PDO, in rule order.
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

#[cfg(test)]
pub(super) fn is_known(word: &str) -> bool {
    KindSet::ALL.contains_name(word)
        || word == SDO_OF_COMMUNICATION
        || PDO_WORDS.iter().any(|(known, _)| *known == word)
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
    fn sdo_transfers_of_other_objects_reach_fewer_rules() {
        let mut interests = Interests::default();
        interests.declared(&["sdo-transfer"], 1);
        interests.declared(&["sync", SDO_OF_COMMUNICATION], 2);
        interests.kinds(KindSet::by_name(|name| name == SDO), 3);
        let places = |interests: &Interests, object: Option<(u16, u8)>| {
            let object = object.map(|(index, sub)| ObjectAddress::new(index, sub));
            interests.of_transfer(object).to_vec()
        };
        assert_eq!(places(&interests, Some((0x1017, 0))), [1, 2, 3]);
        assert_eq!(places(&interests, Some((0x1FFF, 0))), [1, 2, 3]);
        assert_eq!(places(&interests, Some((0x0FFF, 0))), [1, 3]);
        assert_eq!(places(&interests, Some((0x2000, 0))), [1, 3]);
        assert_eq!(places(&interests, None), [1, 3]);
        interests.renew(3, KindSet::by_name(|name| name == SDO));
        assert_eq!(places(&interests, None), [3, 1]);
        interests.renew(3, KindSet::NONE);
        assert_eq!(places(&interests, None), [1]);
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
