//! Dispatch tables from events to rules: one list per event kind, and one list per class of PDOs, since most
//! events are PDOs.

use strum::EnumCount as _;

use crate::event::{DecodedPdo, Event, EventKind, Kind, KindSet};
use crate::profile::PdoDirection;
use crate::rules::declaration::{Declaration, PdoSubset, TransferSubset};
use crate::wire::canopen::ObjectAddress;

/// Combinations of four properties: direction, request or data, payload unchanged or not, mapping confirmed
/// or not.
const PDO_CLASSES: usize = 16;

const RECEIVED: usize = 1;
const REQUEST: usize = 2;
const ROUTINE: usize = 4;
const MAPPED: usize = 8;

/// Whether a subset of the PDOs contains those of a class.
const fn contains(subset: PdoSubset, class: usize) -> bool {
    match subset {
        PdoSubset::All => true,
        PdoSubset::Transmitted => class & (RECEIVED | REQUEST) == 0,
        PdoSubset::Received => class & (RECEIVED | REQUEST) == RECEIVED,
        PdoSubset::ReceivedChanged => class & (RECEIVED | REQUEST | ROUTINE) == RECEIVED,
        PdoSubset::Mapped => class & (REQUEST | MAPPED) == MAPPED,
        PdoSubset::Changed => class & (REQUEST | ROUTINE) == 0,
    }
}

/// Bit mask of the classes of a subset of the PDOs.
fn classes(subset: PdoSubset) -> u16 {
    (0..PDO_CLASSES).filter(|class| contains(subset, *class)).fold(0, |all, class| all | 1 << class)
}

/// Indices of the objects of [`TransferSubset::Communication`].
const COMMUNICATION: std::ops::Range<u16> = 0x1000..0x2000;

/// Indices of the rules that receive an event.
#[derive(Debug)]
pub(super) struct RuleInterests {
    by_kind: [Vec<u16>; Kind::COUNT],
    /// Rules that also receive SDO transfers of objects outside of [`COMMUNICATION`].
    other_objects: Vec<u16>,
    pdo: [Vec<u16>; PDO_CLASSES],
    /// Rules that receive PDOs, in rule order: index, bit mask of the classes, whether the rule wants PDOs
    /// now.
    members: Vec<(u16, u16, bool)>,
}

impl Default for RuleInterests {
    fn default() -> Self {
        Self {
            by_kind: std::array::from_fn(|_| Vec::new()),
            other_objects: Vec::new(),
            pdo: std::array::from_fn(|_| Vec::new()),
            members: Vec::new(),
        }
    }
}

impl RuleInterests {
    /// Registers a rule for the events that it declares.
    pub(super) fn declare_rule(&mut self, rule: &Declaration, place: u16) {
        self.add(rule.kinds, rule.pdos, place);
        if rule.transfers == TransferSubset::Communication {
            self.other_objects.retain(|other| *other != place);
        }
    }

    /// Registers a rule for all events of these kinds.
    pub(super) fn register_kinds(&mut self, kinds: KindSet, place: u16) {
        self.add(kinds, PdoSubset::All, place);
    }

    fn add(&mut self, kinds: KindSet, pdos: PdoSubset, place: u16) {
        for kind in kinds.kinds() {
            if let Some(list) = self.by_kind.get_mut(kind as usize) {
                list.push(place);
            }
        }
        if kinds.contains_kind(Kind::SdoTransfer) {
            self.other_objects.push(place);
        }
        if kinds.contains_kind(Kind::Pdo) {
            self.members.push((place, classes(pdos), true));
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
    pub(super) fn renew_kinds(&mut self, place: u16, kinds: KindSet) {
        for list in &mut self.by_kind {
            list.retain(|other| *other != place);
        }
        self.other_objects.retain(|other| *other != place);
        if kinds.contains_kind(Kind::SdoTransfer) {
            self.other_objects.insert(0, place);
        }
        self.members.retain(|(member, ..)| *member != place);
        for kind in kinds.kinds() {
            if let Some(list) = self.by_kind.get_mut(kind as usize) {
                list.insert(0, place);
            }
        }
        if kinds.contains_kind(Kind::Pdo) {
            self.members.insert(0, (place, u16::MAX, true));
        }
        self.list_pdos();
    }

    /// Rules for an event other than a PDO, in rule order.
    #[inline]
    pub(super) fn rules_for(&self, kind: &EventKind) -> &[u16] {
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
                let class = pdo_class(event, pdo);
                let list = |class: usize| self.pdo.get(class).map_or(&[][..], Vec::as_slice);
                (list(class & !ROUTINE), list(class | ROUTINE))
            }
            kind => (self.rules_for(kind), self.rules_for(kind)),
        };
        changed.iter().map(|place| (*place, !unchanged.contains(place)))
    }

    /// Rules for a PDO, in rule order.
    #[inline]
    pub(super) fn of_pdo(&self, pdo: &DecodedPdo, event: &Event) -> &[u16] {
        self.pdo.get(pdo_class(event, pdo)).map_or(&[], Vec::as_slice)
    }
}

#[inline]
fn pdo_class(event: &Event, pdo: &DecodedPdo) -> usize {
    let bit = |is_set: bool, bit: usize| if is_set { bit } else { 0 };
    bit(pdo.name.direction == PdoDirection::Receive, RECEIVED)
        | bit(pdo.is_request, REQUEST)
        | bit(event.routine, ROUTINE)
        | bit(pdo.layout.as_ref().is_some_and(|layout| !layout.assumed), MAPPED)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn rule(kinds: &[Kind], pdos: PdoSubset, transfers: TransferSubset) -> Declaration {
        Declaration { kinds: KindSet::of(kinds), pdos, transfers, ..Declaration::PLAIN }
    }

    #[test]
    fn sdo_transfers_of_other_objects_reach_fewer_rules() {
        let mut interests = RuleInterests::default();
        interests.declare_rule(&rule(&[Kind::SdoTransfer], PdoSubset::All, TransferSubset::All), 1);
        let kinds = [Kind::Sync, Kind::SdoTransfer];
        interests.declare_rule(&rule(&kinds, PdoSubset::All, TransferSubset::Communication), 2);
        interests.register_kinds(KindSet::of(&[Kind::SdoTransfer]), 3);
        let places = |interests: &RuleInterests, object: Option<(u16, u8)>| {
            let object = object.map(|(index, sub)| ObjectAddress::new(index, sub));
            interests.of_transfer(object).to_vec()
        };
        assert_eq!(places(&interests, Some((0x1017, 0))), [1, 2, 3]);
        assert_eq!(places(&interests, Some((0x1FFF, 0))), [1, 2, 3]);
        assert_eq!(places(&interests, Some((0x0FFF, 0))), [1, 3]);
        assert_eq!(places(&interests, Some((0x2000, 0))), [1, 3]);
        assert_eq!(places(&interests, None), [1, 3]);
        interests.renew_kinds(3, KindSet::of(&[Kind::SdoTransfer]));
        assert_eq!(places(&interests, None), [3, 1]);
        interests.renew_kinds(3, KindSet::NONE);
        assert_eq!(places(&interests, None), [1]);
    }

    #[test]
    fn subsets_of_pdos_are_classes() {
        let mut interests = RuleInterests::default();
        let declare = |interests: &mut RuleInterests, pdos: PdoSubset, place: u16| {
            interests.declare_rule(&rule(&[Kind::Pdo], pdos, TransferSubset::All), place);
        };
        declare(&mut interests, PdoSubset::Received, 1);
        declare(&mut interests, PdoSubset::ReceivedChanged, 2);
        declare(&mut interests, PdoSubset::Transmitted, 3);
        declare(&mut interests, PdoSubset::All, 4);
        let lists: Vec<_> = interests.pdo.iter().map(Vec::as_slice).collect();
        // By class: direction is bit 0, request bit 1, unchanged payload bit 2.
        let wanted: [&[u16]; 8] = [&[3, 4], &[1, 2, 4], &[4], &[4], &[3, 4], &[1, 4], &[4], &[4]];
        assert_eq!(lists, [wanted, wanted].concat());
        let mut interests = RuleInterests::default();
        declare(&mut interests, PdoSubset::Mapped, 1);
        declare(&mut interests, PdoSubset::Mapped, 2);
        let lists: Vec<_> = interests.pdo.iter().skip(MAPPED).map(Vec::as_slice).collect();
        let wanted: [&[u16]; 8] = [&[1, 2], &[1, 2], &[], &[], &[1, 2], &[1, 2], &[], &[]];
        assert_eq!(lists, wanted);
        assert!(interests.pdo.iter().take(MAPPED).all(Vec::is_empty));
        let mut interests = RuleInterests::default();
        declare(&mut interests, PdoSubset::Changed, 1);
        let lists: Vec<_> = interests.pdo.iter().map(Vec::as_slice).collect();
        let wanted: [&[u16]; 8] = [&[1], &[1], &[], &[], &[], &[], &[], &[]];
        assert_eq!(lists, [wanted, wanted].concat());
    }
}
