//! Object store of one node: object values and their origin.

use std::collections::{BTreeMap, HashMap};
use std::sync::Arc;

use foldhash::fast::FixedState;

use crate::frame::Timestamp;
use crate::profile::{KnownValues, WriteEffect};
use crate::session::limits::{OBJECT_BYTES_LIMIT, OBJECT_LIMIT, OBJECT_VALUE_LIMIT};
use crate::wire::canopen::ObjectAddress;

/// Source of a value.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum OriginKind {
    /// Written by SDO and confirmed by the server.
    Download,
    /// Read by SDO.
    Upload,
    /// Stated in the bus file.
    BusFile,
    /// Sent in a PDO; one sample of a changing value.
    Pdo,
    /// Configured value in a DCF or XDC.
    DeviceFile,
}

impl OriginKind {
    /// Name used in all output.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Download => "download",
            Self::Upload => "upload",
            Self::Pdo => "pdo",
            Self::BusFile => "bus-file",
            Self::DeviceFile => "dcf",
        }
    }
}

impl OriginKind {
    /// Origin as one or two words in text output.
    pub const fn origin_text(self) -> &'static str {
        match self {
            Self::Download => "written",
            Self::Upload => "read",
            Self::Pdo => "sent",
            Self::BusFile => "given",
            Self::DeviceFile => "in DCF",
        }
    }
}

/// Origin of a value.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct StoredOrigin {
    /// Source of the value.
    pub kind: OriginKind,
    /// Frame that confirmed it.
    pub frame: u64,
    /// Timestamp of that frame.
    pub time: Option<Timestamp>,
}

impl StoredOrigin {
    /// Whether a frame before the capture carried the value, as the bus file states.
    pub const fn is_earlier(&self) -> bool {
        self.frame == 0 && matches!(self.kind, OriginKind::Download | OriginKind::Upload | OriginKind::Pdo)
    }

    /// Place in text output: ` {88}`, ` before the capture`, or nothing for a value without a frame.
    pub fn origin_place(&self) -> String {
        match self.frame {
            0 if self.is_earlier() => " before the capture".to_owned(),
            0 => String::new(),
            frame => format!(" {{{frame}}}"),
        }
    }
}

/// Value of one object.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct StoredObject {
    /// Bytes, truncated to 1 KiB.
    pub value: Vec<u8>,
    /// Size of the complete value in bytes.
    pub size: u64,
    /// Source, frame and time of the value.
    pub origin: StoredOrigin,
    /// The value may have changed since, for example by a restart that restored the stored value.
    pub stale: bool,
}

/// Objects of a node by address.
#[derive(Debug, Clone, Default)]
pub struct ObjectStore {
    entries: HashMap<ObjectAddress, StoredObject, FixedState>,
    bytes: usize,
    /// Units from the user, for objects whose unit no message contains.
    units: BTreeMap<ObjectAddress, String>,
    /// Written values that take effect at a restart.
    waiting: BTreeMap<ObjectAddress, PendingValue>,
    /// Values known to be in non-volatile memory.
    kept: BTreeMap<ObjectAddress, Vec<u8>>,
    /// Values in a device file: used until a message contains the value, and always marked as doubtful.
    wanted: Arc<BTreeMap<ObjectAddress, StoredObject>>,
    /// Counter of changes, without values of a device file.
    changes: u64,
}

/// A written value that takes effect later.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct PendingValue {
    /// Value as written.
    pub value: Vec<u8>,
    /// Condition under which it takes effect.
    pub effect: WriteEffect,
    /// Transfer that wrote it.
    pub origin: StoredOrigin,
}

impl KnownValues for ObjectStore {
    fn object_bytes(&self, object: ObjectAddress) -> Option<(&[u8], bool)> {
        self.get(object).map(|entry| (entry.value.as_slice(), entry.stale))
    }

    fn object_unit(&self, object: ObjectAddress) -> Option<&str> {
        self.units.get(&object).map(String::as_str)
    }
}

impl ObjectStore {
    /// Sets the unit of an object from the user.
    pub(in crate::session) fn give_unit(&mut self, address: ObjectAddress, unit: &str) {
        self.units.insert(address, unit.to_owned());
    }

    /// Value of an object that takes effect later.
    pub fn waiting_value(&self, address: ObjectAddress) -> Option<&PendingValue> {
        self.waiting.get(&address)
    }

    /// All values that take effect later.
    pub fn all_waiting(&self) -> impl Iterator<Item = (ObjectAddress, &PendingValue)> {
        self.waiting.iter().map(|(address, waiting)| (*address, waiting))
    }

    /// Adds a value that takes effect later; long values are not stored, because nothing depends on them.
    pub(in crate::session) fn add_waiting(&mut self, address: ObjectAddress, waiting: PendingValue) {
        let fits = self.waiting.len() < OBJECT_LIMIT / 4 || self.waiting.contains_key(&address);
        if fits && waiting.value.len() <= OBJECT_VALUE_LIMIT / 16 {
            self.waiting.insert(address, waiting);
        }
    }

    /// Removes and returns the waiting values whose effect the closure accepts.
    pub(in crate::session) fn take_waiting(
        &mut self,
        comes: impl Fn(WriteEffect) -> bool,
    ) -> Vec<(ObjectAddress, Vec<u8>)> {
        let (now, later): (BTreeMap<_, _>, _) =
            std::mem::take(&mut self.waiting).into_iter().partition(|(_, waiting)| comes(waiting.effect));
        self.waiting = later;
        now.into_iter().map(|(address, waiting)| (address, waiting.value)).collect()
    }

    /// Value in non-volatile memory; `None` if unknown.
    pub fn stored_value(&self, address: ObjectAddress) -> Option<&[u8]> {
        self.kept.get(&address).map(Vec::as_slice)
    }

    /// All values in non-volatile memory.
    pub(in crate::session) fn all_kept(&self) -> impl Iterator<Item = (ObjectAddress, &[u8])> {
        self.kept.iter().map(|(address, value)| (*address, value.as_slice()))
    }

    /// Sets the value of an object in non-volatile memory; long values are not stored.
    pub(in crate::session) fn set_kept(&mut self, address: ObjectAddress, value: Vec<u8>) {
        let fits = self.kept.len() < OBJECT_LIMIT || self.kept.contains_key(&address);
        if fits && value.len() <= OBJECT_VALUE_LIMIT / 16 {
            self.kept.insert(address, value);
        }
    }

    /// Marks all objects selected by `picks` as stored in non-volatile memory.
    pub(in crate::session) fn mark_stored(&mut self, picks: impl Fn(ObjectAddress) -> bool) {
        for (address, entry) in &self.entries {
            if entry.value.len() <= OBJECT_VALUE_LIMIT / 16 && picks(*address) {
                self.kept.insert(*address, entry.value.clone());
            }
        }
    }

    /// Forgets the non-volatile values of the objects selected by `picks`.
    pub(in crate::session) fn forget_kept(&mut self, picks: impl Fn(ObjectAddress) -> bool) {
        self.kept.retain(|address, _| !picks(*address));
    }

    /// Counter of changes, without values of a device file; equal counters mean equal contents.
    #[inline]
    pub fn change_count(&self) -> u64 {
        self.changes
    }

    /// Removes a value.
    pub(in crate::session) fn remove(&mut self, address: ObjectAddress) {
        self.changes = self.changes.wrapping_add(1);
        if let Some(entry) = self.entries.remove(&address) {
            self.bytes = self.bytes.saturating_sub(entry.value.len());
        }
    }

    /// Sets a value back to the one in non-volatile memory.
    pub(in crate::session) fn fall_back(&mut self, address: ObjectAddress, kept: &[u8]) {
        if let Some(entry) = self.entries.get(&address) {
            let origin = entry.origin;
            // Cannot fail for lack of entries: it replaces an existing value.
            let _ = self.set(address, kept, origin);
        }
    }

    /// Marks a value as doubtful: it may have changed unnoticed.
    pub(in crate::session) fn mark_doubtful(&mut self, address: ObjectAddress) {
        self.changes = self.changes.wrapping_add(1);
        if let Some(entry) = self.entries.get_mut(&address) {
            entry.stale = true;
        }
    }

    /// Marks the values selected by `picks` as doubtful; returns their addresses.
    pub(in crate::session) fn doubt_all(
        &mut self,
        picks: impl Fn(ObjectAddress) -> bool,
    ) -> Vec<ObjectAddress> {
        self.changes = self.changes.wrapping_add(1);
        let mut doubted = Vec::new();
        for (address, entry) in &mut self.entries {
            if entry.origin.kind != OriginKind::BusFile && !entry.stale && picks(*address) {
                entry.stale = true;
                doubted.push(*address);
            }
        }
        doubted.sort_unstable();
        doubted
    }

    /// Replaces the values of the device file.
    pub(in crate::session) fn set_expected(
        &mut self,
        values: impl Iterator<Item = (ObjectAddress, Vec<u8>)>,
    ) {
        const ORIGIN: StoredOrigin = StoredOrigin { kind: OriginKind::DeviceFile, frame: 0, time: None };
        let entry = |(address, value): (ObjectAddress, Vec<u8>)| {
            (address, StoredObject { size: value.len() as u64, value, origin: ORIGIN, stale: true })
        };
        self.wanted = Arc::new(values.map(entry).collect());
    }

    /// Addresses of the values in the device file.
    pub(in crate::session) fn all_wanted(&self) -> Vec<ObjectAddress> {
        self.wanted.keys().copied().collect()
    }

    /// Value from messages or the bus file, otherwise from the device file.
    pub fn get(&self, address: ObjectAddress) -> Option<&StoredObject> {
        self.seen_value(address).or_else(|| self.wanted.get(&address))
    }

    /// Value from messages or the bus file.
    pub fn seen_value(&self, address: ObjectAddress) -> Option<&StoredObject> {
        self.entries.get(&address)
    }

    /// Value of up to eight bytes as a number, least significant byte first.
    pub fn number(&self, address: ObjectAddress) -> Option<u64> {
        let value = &self.get(address)?.value;
        (!value.is_empty() && value.len() <= 8).then(|| crate::profile::little_endian(value))
    }

    /// Confirms the value of an object; whether it was stale. `None` without any effect if the object has another value.
    pub(in crate::session) fn confirm_value(
        &mut self,
        address: ObjectAddress,
        value: &[u8],
        origin: StoredOrigin,
    ) -> Option<bool> {
        let known = self.entries.get_mut(&address).filter(|known| known.value == value)?;
        self.changes = self.changes.wrapping_add(1);
        (known.size, known.origin) = (value.len() as u64, origin);
        Some(std::mem::replace(&mut known.stale, false))
    }

    /// Stores a value and returns the previous one. `Err` if the limit of objects or bytes is reached.
    pub(in crate::session) fn set(
        &mut self,
        address: ObjectAddress,
        value: &[u8],
        origin: StoredOrigin,
    ) -> Result<Option<StoredObject>, StoreFull> {
        if self.entries.len() >= OBJECT_LIMIT && !self.entries.contains_key(&address) {
            return Err(StoreFull);
        }
        self.changes = self.changes.wrapping_add(1);
        let kept = value.get(..OBJECT_VALUE_LIMIT).unwrap_or(value).to_vec();
        let replaced = self.entries.get(&address).map_or(0, |entry| entry.value.len());
        if self.bytes.saturating_sub(replaced) + kept.len() > OBJECT_BYTES_LIMIT {
            return Err(StoreFull);
        }
        self.bytes += kept.len();
        let entry = StoredObject { value: kept, size: value.len() as u64, origin, stale: false };
        let before = self.entries.insert(address, entry);
        if let Some(before) = &before {
            self.bytes = self.bytes.saturating_sub(before.value.len());
        }
        Ok(before)
    }

    /// All objects, sorted by address.
    pub fn sorted(&self) -> Vec<(ObjectAddress, &StoredObject)> {
        let wanted = self.wanted.iter().filter(|(address, _)| !self.entries.contains_key(address));
        let mut all: Vec<_> =
            self.entries.iter().chain(wanted).map(|(address, entry)| (*address, entry)).collect();
        all.sort_unstable_by_key(|(address, _)| *address);
        all
    }

    /// Number of objects.
    pub fn len(&self) -> usize {
        let wanted = self.wanted.keys().filter(|address| !self.entries.contains_key(address));
        self.entries.len() + wanted.count()
    }

    /// Whether the store has no values.
    pub fn is_empty(&self) -> bool {
        self.entries.is_empty() && self.wanted.is_empty()
    }
}

/// The node has [`OBJECT_LIMIT`] objects already, or [`OBJECT_BYTES_LIMIT`] bytes of values.
#[derive(Debug, PartialEq, Eq)]
pub(in crate::session) struct StoreFull;

#[cfg(test)]
mod tests {
    use super::*;

    const ORIGIN: StoredOrigin = StoredOrigin { kind: OriginKind::Download, frame: 7, time: None };

    #[test]
    fn values_replace_each_other_and_read_as_numbers() {
        let mut store = ObjectStore::default();
        let address = ObjectAddress::new(0x1017, 0);
        assert_eq!(store.set(address, &[0xE8, 3], ORIGIN), Ok(None));
        assert_eq!(store.number(address), Some(1000));
        let later = StoredOrigin { frame: 9, ..ORIGIN };
        assert_eq!(store.confirm_value(address, &[0, 0], later), None);
        assert_eq!(store.confirm_value(address, &[0xE8, 3], later), Some(false));
        assert_eq!(store.get(address).map(|entry| entry.origin), Some(later));
        let before = store.set(address, &[0, 0], ORIGIN).unwrap().unwrap();
        assert_eq!(before.value, [0xE8, 3]);
    }

    #[test]
    fn values_of_a_file_follow_observed_values() {
        let mut store = ObjectStore::default();
        let [first, second] = [ObjectAddress::new(0x1017, 0), ObjectAddress::new(0x2000, 0)];
        store.set_expected([(first, vec![1, 0]), (second, vec![2])].into_iter());
        assert_eq!((store.number(first), store.len(), store.seen_value(first)), (Some(1), 2, None));
        assert!(store.get(first).unwrap().stale);
        // The value of the device file is not returned as the previous one.
        assert_eq!(store.set(first, &[5, 0], ORIGIN), Ok(None));
        assert_eq!((store.number(first), store.len()), (Some(5), 2));
        let origins: Vec<_> = store.sorted().iter().map(|(_, entry)| entry.origin.kind.name()).collect();
        assert_eq!(origins, ["download", "dcf"]);
        store.remove(first);
        assert_eq!(store.number(first), Some(1));
    }

    #[test]
    fn the_place_of_an_origin() {
        let place = |kind, frame| StoredOrigin { kind, frame, time: None }.origin_place();
        assert_eq!(place(OriginKind::Download, 88), " {88}");
        assert_eq!(place(OriginKind::Upload, 0), " before the capture");
        assert_eq!(place(OriginKind::BusFile, 0), "");
    }

    #[test]
    fn the_bytes_of_all_values_are_bounded() {
        let mut store = ObjectStore::default();
        let set = |store: &mut ObjectStore, index, value: &[u8]| {
            store.set(ObjectAddress::new(index, 0), value, ORIGIN)
        };
        for index in 0..64 {
            set(&mut store, index, &[0; 1024]).unwrap();
        }
        assert_eq!(set(&mut store, 64, &[0]), Err(StoreFull));
        // A value may still replace the previous one of its object.
        assert!(set(&mut store, 5, &[1; 1024]).is_ok());
        assert!(set(&mut store, 5, &[1]).is_ok());
        assert!(set(&mut store, 64, &[0; 1023]).is_ok());
    }

    #[test]
    fn the_number_of_objects_is_bounded() {
        let mut store = ObjectStore::default();
        for index in 0..u16::try_from(OBJECT_LIMIT).unwrap() {
            store.set(ObjectAddress::new(index, 0), &[0], ORIGIN).unwrap();
        }
        assert_eq!(store.set(ObjectAddress::new(0xFFFF, 0), &[0], ORIGIN), Err(StoreFull));
        assert!(store.set(ObjectAddress::new(0, 0), &[1], ORIGIN).is_ok());
    }
}
