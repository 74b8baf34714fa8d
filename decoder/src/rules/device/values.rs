//! Last values in PDOs and messages at one node.
//!
//! Most PDOs repeat their values, or change only measured ones that no rule checks. Their values are not stored one by
//! one, but read from the last payload on demand.

use super::progress::PdoTask;
use super::proofs::ProofAge;
use crate::profile::{IntegerPosition, PdoName};

/// Last values, by object index in the plan.
#[derive(Debug, Default)]
pub(super) struct LastValues {
    values: Vec<Option<StoredValue>>,
    /// The boot-up was seen: bits not written since then are 0.
    pub(super) is_fresh: bool,
    /// Number of value changes that conditions use.
    pub(super) changes: u64,
    /// Change count of the node's store at the last such value.
    stored: u64,
    carriers: Vec<CarrierPayload>,
    /// Number of times at which the last value of an object ceased to be the one in a payload.
    handovers: u64,
}

/// Last value of an object.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct LastValue {
    pub(super) raw: i64,
    pub(super) time: i64,
    pub(super) frame: u64,
    /// The device itself sent the value.
    pub(super) is_sent: bool,
}

/// Last value of an object, or its place in the last payload of a PDO.
#[derive(Debug, Clone, Copy)]
struct StoredValue {
    value: LastValue,
    /// Index of the PDO that contains the value.
    carrier: Option<(u16, IntegerPosition)>,
}

/// Last payload of a PDO.
#[derive(Debug)]
pub(super) struct CarrierPayload {
    identifier: usize,
    name: PdoName,
    pub(super) word: u64,
    pub(super) length: usize,
    time: i64,
    frame: u64,
    /// [`LastValues::handovers`] when all values of the PDO were the last ones of their objects.
    held: Option<u64>,
    /// Rules that do not rest, determined at this age of the values.
    pub(super) awake: AwakeRules,
}

/// Rules about a PDO that do not rest.
#[derive(Debug, Default)]
pub(super) struct AwakeRules {
    pub(super) age: Option<ProofAge>,
    /// Rules about the PDO itself, with what it does to them.
    pub(super) rules: Vec<(usize, PdoTask)>,
    /// Places of fields, and of rules that check each of their values.
    pub(super) clauses: Vec<(usize, usize)>,
}

impl LastValues {
    pub(super) fn new(count: usize) -> Self {
        Self { values: vec![None; count], ..Self::default() }
    }

    /// Last value by object index in the plan.
    pub(super) fn get(&self, place: usize) -> Option<LastValue> {
        let stored = self.values.get(place)?.as_ref()?;
        match stored.carrier {
            None => Some(stored.value),
            Some((number, position)) => {
                let carrier = self.carriers.get(usize::from(number))?;
                let raw = position.number(carrier.word, carrier.length)?;
                Some(LastValue { raw, time: carrier.time, frame: carrier.frame, ..stored.value })
            }
        }
    }

    /// Last raw value by object index in the plan.
    #[inline]
    pub(super) fn raw_value(&self, place: usize) -> Option<i64> {
        self.get(place).map(|value| value.raw)
    }

    /// Counts a value change that conditions use. After a change of the node's store, an equal value counts
    /// too, since it is newer than the stored one.
    #[inline]
    pub(super) fn count_value(&mut self, is_other: bool, stored: u64) {
        if is_other || self.stored != stored {
            self.count_change();
            self.stored = stored;
        }
    }

    pub(super) fn count_change(&mut self) {
        self.changes = self.changes.wrapping_add(1);
    }

    /// Stores a value, or that it is contained in a PDO, whose payload [`Self::store_payload`] stores.
    #[inline]
    pub(super) fn put_value(
        &mut self,
        place: usize,
        value: LastValue,
        carrier: Option<(u16, IntegerPosition)>,
    ) {
        let Some(known) = self.values.get_mut(place) else { return };
        let before = known.and_then(|known| known.carrier);
        *known = Some(StoredValue { value, carrier });
        if before != carrier {
            self.hand_over();
        }
    }

    /// Keeps the value of an object that the next payload of a PDO does not contain.
    pub(super) fn keep_value(&mut self, place: usize) {
        if let Some(value) = self.get(place) {
            self.put_value(place, value, None);
        }
    }

    fn keep_all(&mut self, is_meant: impl Fn(u16) -> bool) {
        for place in 0..self.values.len() {
            let stored = self.values.get(place).copied().flatten();
            if stored.and_then(|stored| stored.carrier).is_some_and(|(of, _)| is_meant(of)) {
                self.keep_value(place);
            }
        }
    }

    /// Forgets all PDOs, but not their values.
    pub(super) fn drop_carriers(&mut self) {
        self.keep_all(|_| true);
        self.carriers.clear();
    }

    fn hand_over(&mut self) {
        self.handovers = self.handovers.wrapping_add(1);
    }

    pub(super) fn clear(&mut self) {
        self.count_change();
        self.hand_over();
        self.values.fill(None);
        self.is_fresh = false;
    }

    /// Removes values sent by the device itself.
    pub(super) fn forget_sent(&mut self) {
        self.count_change();
        self.hand_over();
        for value in &mut self.values {
            value.take_if(|stored| stored.value.is_sent);
        }
    }

    /// Index of a PDO with an identifier, before its first payload.
    pub(super) fn add_carrier(&mut self, identifier: usize, name: PdoName) -> Option<u16> {
        let known =
            self.carriers.iter().position(|known| (known.identifier, known.name) == (identifier, name));
        let place = known.unwrap_or(self.carriers.len());
        let number = u16::try_from(place).ok()?;
        self.keep_all(|of| of == number);
        let awake = AwakeRules::default();
        let new =
            CarrierPayload { identifier, name, word: 0, length: 0, time: 0, frame: 0, held: None, awake };
        match self.carriers.get_mut(place) {
            Some(known) => *known = new,
            None => self.carriers.push(new),
        }
        Some(number)
    }

    /// Rules that do not rest at a PDO.
    #[inline]
    pub(super) fn awake_rules(&self, number: u16) -> Option<&AwakeRules> {
        self.carriers.get(usize::from(number)).map(|carrier| &carrier.awake)
    }

    /// A PDO by index.
    #[inline]
    pub(super) fn carrier_mut(&mut self, number: u16) -> Option<&mut CarrierPayload> {
        self.carriers.get_mut(usize::from(number))
    }

    /// Stores the next payload of a PDO, if its values are the last ones of their objects and none of the `watched` bits
    /// changes; then the payload before.
    #[inline]
    pub(super) fn repeat_payload(
        &mut self,
        number: u16,
        (word, length): (u64, usize),
        watched: u64,
        age: ProofAge,
        (time, frame): (i64, u64),
    ) -> Option<u64> {
        let handovers = self.handovers;
        let carrier = self.carriers.get_mut(usize::from(number))?;
        let is_repeated = carrier.held == Some(handovers)
            && carrier.length == length
            && (carrier.word ^ word) & watched == 0
            && carrier.awake.age == Some(age);
        is_repeated.then(|| {
            (carrier.time, carrier.frame) = (time, frame);
            std::mem::replace(&mut carrier.word, word)
        })
    }

    /// Stores the payload of a PDO after [`Self::put_value`] for all its values.
    pub(super) fn store_payload(
        &mut self,
        number: u16,
        (word, length): (u64, usize),
        (time, frame): (i64, u64),
    ) {
        let held = Some(self.handovers);
        if let Some(carrier) = self.carriers.get_mut(usize::from(number)) {
            (carrier.word, carrier.length) = (word, length);
            (carrier.time, carrier.frame, carrier.held) = (time, frame, held);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::profile::{DataType, PdoDirection, SignalField};
    use crate::wire::canopen::ObjectAddress;

    const AGE: ProofAge = (0, 0);
    const NAME: PdoName = PdoName { direction: PdoDirection::Transmit, number: 1 };

    const fn value(raw: i64) -> LastValue {
        LastValue { raw, time: 5, frame: 50, is_sent: true }
    }

    /// Byte 0 is object 0, byte 1 is object 1.
    fn positions() -> [IntegerPosition; 2] {
        let object = ObjectAddress::new(0x2000, 0);
        let field = |bit| SignalField::of_object(object, bit, 8, DataType::Unsigned8);
        [0, 8].map(|bit| IntegerPosition::position_of(&field(bit)).unwrap())
    }

    /// Values of a PDO with the contents 01 02 at the time 5.
    fn carried() -> (LastValues, u16) {
        let mut last = LastValues::new(3);
        let number = last.add_carrier(7, NAME).unwrap();
        let [first, second] = positions();
        last.put_value(0, value(1), Some((number, first)));
        last.put_value(1, value(2), Some((number, second)));
        last.store_payload(number, (0x0201, 2), (5, 50));
        last.carrier_mut(number).unwrap().awake.age = Some(AGE);
        (last, number)
    }

    fn raw_value(last: &LastValues) -> [Option<i64>; 2] {
        [last.raw_value(0), last.raw_value(1)]
    }

    #[test]
    fn values_are_read_from_the_last_payload() {
        let (mut last, number) = carried();
        assert_eq!(last.repeat_payload(number, (0x0301, 2), 0xFF, AGE, (6, 60)), Some(0x0201));
        assert_eq!(last.get(1), Some(LastValue { raw: 3, time: 6, frame: 60, is_sent: true }));
        // A watched bit, another length, and another age of the conditions.
        assert_eq!(last.repeat_payload(number, (0x0300, 2), 0xFF, AGE, (7, 70)), None);
        assert_eq!(last.repeat_payload(number, (0x0301, 1), 0xFF, AGE, (7, 70)), None);
        assert_eq!(last.repeat_payload(number, (0x0301, 2), 0xFF, (1, 0), (7, 70)), None);
        assert_eq!((raw_value(&last), last.get(0).unwrap().time), ([Some(1), Some(3)], 6));
    }

    #[test]
    fn another_source_of_an_object_ends_the_repetition() {
        let (mut last, number) = carried();
        last.put_value(1, value(9), None);
        assert_eq!(raw_value(&last), [Some(1), Some(9)]);
        assert_eq!(last.repeat_payload(number, (0x0201, 2), 0, AGE, (6, 60)), None);
        let (mut last, number) = carried();
        last.forget_sent();
        assert_eq!(raw_value(&last), [None; 2]);
        assert_eq!(last.repeat_payload(number, (0x0201, 2), 0, AGE, (6, 60)), None);
    }

    #[test]
    fn values_stay_without_their_pdo() {
        let (mut last, number) = carried();
        // A shorter payload does not contain object 1.
        last.put_value(0, value(4), Some((number, positions()[0])));
        last.keep_value(1);
        last.store_payload(number, (0x04, 1), (6, 60));
        assert_eq!(raw_value(&last), [Some(4), Some(2)]);
        last.drop_carriers();
        assert_eq!((raw_value(&last), last.get(0).unwrap().frame), ([Some(4), Some(2)], 60));
        assert_eq!(last.repeat_payload(number, (0x04, 1), 0, AGE, (7, 70)), None);
    }
}
