//! Objects by address, from a device's own file and the standards it extends.

use std::ops::{Deref, Range};
use std::sync::Arc;

use super::data_type::DataType;
use super::formula::formula;
use super::object::{Access, Effect, Format, Given, Look, Only, Repeat, Scale, Storage, When};
use super::reference::{ObjectRange, Reference};
use crate::wire::canopen::ObjectAddress;

/// One object of a file, or several at a distance.
#[derive(Debug, Clone)]
pub struct Object {
    /// Index of the first.
    pub index: u16,
    /// How often, how far.
    pub repeat: Repeat,
    /// Name; `{n}` stands for the number of the repeat.
    pub name: String,
    /// Sub-entries; of a variable one with sub-index 0.
    pub entries: Vec<Entry>,
    /// Whether entries have names of their own.
    pub is_record: bool,
    /// Variants it belongs to.
    pub only: Only,
    /// Section.
    pub source: String,
    pub(super) span: Range<usize>,
}

/// One sub-entry, or equal ones from `sub` to `to`.
#[derive(Debug, Clone)]
pub struct Entry {
    /// First sub-index.
    pub sub: u8,
    /// Last sub-index.
    pub to: u8,
    /// Data type.
    pub data_type: Option<DataType>,
    /// Access by SDO.
    pub access: Option<Access>,
    /// How people read it.
    pub format: Format,
    /// How it is read.
    pub look: Look,
    /// How it is read instead, the first that fits; what one of them leaves out is as above.
    pub modes: Vec<(When, Look)>,
    /// As delivered.
    pub default: Option<Given>,
    /// What keeps it.
    pub storage: Storage,
    /// Store object that keeps it.
    pub save: Option<Reference>,
    /// When a write acts.
    pub effect: Effect,
    /// Objects whose known value is void after a write.
    pub invalidates: Vec<ObjectRange>,
    pub(super) channel: Option<u8>,
    /// Raw values of a mode in which measured values do not follow set points.
    pub open_loop: Vec<i64>,
    /// Variants it belongs to.
    pub only: Only,
    /// Section.
    pub source: String,
    /// An assumption or a defect of the manual.
    pub note: String,
    pub(super) span: Range<usize>,
}

/// Repeats followed where an object decides how others are read, or on which identifiers.
const MOST_REPEATS: u16 = 1024;

/// Objects of one or more documents: the first that has an address counts.
#[derive(Debug, Clone, Default)]
pub struct Dictionary {
    pub(super) layers: Vec<Arc<Layer>>,
}

/// Objects of one document, in its order.
#[derive(Debug, Clone, Default)]
pub(super) struct Layer {
    objects: Vec<Object>,
    /// First and last index of each: looked through for each transfer, so they lie side by side.
    spans: Vec<(u16, u16)>,
}

impl Layer {
    pub(super) fn new(objects: Vec<Object>) -> Self {
        let spans = objects.iter().map(|object| (object.index, object.last_index())).collect();
        Self { objects, spans }
    }

    /// Objects with this index, and which repeat of each it is.
    fn at(&self, index: u16) -> impl Iterator<Item = (&Object, u16)> {
        let near = self.spans.iter().zip(&self.objects);
        let near = near.filter(move |((first, last), _)| (*first..=*last).contains(&index));
        near.filter_map(move |(_, object)| Some((object, object.nth(index)?)))
    }

    /// Whether it describes an entry.
    pub(super) fn has(&self, address: ObjectAddress) -> bool {
        self.at(address.index).any(|(object, _)| object.entry(address.sub).is_some())
    }
}

impl Deref for Layer {
    type Target = [Object];

    fn deref(&self) -> &[Object] {
        &self.objects
    }
}

/// What is known of an address: the object, the entry if the object has that sub-index, and which repeat.
#[derive(Debug, Clone, Copy)]
pub struct Found<'a> {
    /// The address asked for.
    pub address: ObjectAddress,
    /// Object.
    pub object: &'a Object,
    /// Sub-entry.
    pub entry: Option<&'a Entry>,
    /// Number of the repeat, from 0.
    pub nth: u16,
}

impl Dictionary {
    /// What is known of an address.
    pub fn find(&self, address: ObjectAddress) -> Option<Found<'_>> {
        let mut index_only = None;
        for (object, nth) in self.layers.iter().flat_map(|layer| layer.at(address.index)) {
            if let Some(entry) = object.entry(address.sub) {
                return Some(Found { address, object, entry: Some(entry), nth });
            }
            if index_only.is_none() && object.is_record {
                index_only = Some(Found { address, object, entry: None, nth });
            }
        }
        index_only
    }

    /// Place of the layer that describes an entry.
    pub(super) fn layer_of(&self, address: ObjectAddress) -> Option<usize> {
        self.layers.iter().position(|layer| layer.has(address))
    }

    /// Addresses with sub-index 0 or 1 that `picks` and that have a default, ascending.
    pub fn defaults(&self, picks: impl Fn(ObjectAddress) -> bool) -> Vec<ObjectAddress> {
        let mut found = Vec::new();
        for object in self.layers.iter().flat_map(|layer| layer.iter()) {
            let delivered = |sub: &u8| object.entry(*sub).is_some_and(|entry| entry.default.is_some());
            for sub in [0, 1].into_iter().filter(delivered) {
                let indexes = (0..object.repeat.count.min(MOST_REPEATS))
                    .map(|nth| object.index.wrapping_add(nth.wrapping_mul(object.repeat.stride)));
                found.extend(indexes.map(|index| ObjectAddress::new(index, sub)).filter(|it| picks(*it)));
            }
        }
        found.sort_unstable();
        found.dedup();
        found
    }

    /// Type of an address.
    pub fn data_type(&self, address: ObjectAddress) -> Option<DataType> {
        self.find(address)?.entry?.data_type
    }

    /// Whether the device's own file describes an address, not only a standard it extends.
    pub fn is_own(&self, address: ObjectAddress) -> bool {
        self.layers.first().is_some_and(|own| own.has(address))
    }

    /// Objects of the device's own file.
    pub fn own(&self) -> &[Object] {
        self.layers.first().map_or(&[], |layer| layer)
    }
}

impl Object {
    /// Which repeat an index is, from 0.
    pub fn nth(&self, index: u16) -> Option<u16> {
        let distance = index.checked_sub(self.index)?;
        if distance == 0 {
            return Some(0);
        }
        let Repeat { count, stride, .. } = self.repeat;
        let nth = distance.checked_div(stride)?;
        (distance % stride == 0 && nth < count).then_some(nth)
    }

    /// Index of the last repeat.
    fn last_index(&self) -> u16 {
        let Repeat { count, stride, .. } = self.repeat;
        self.index.saturating_add(count.saturating_sub(1).saturating_mul(stride))
    }

    /// The entry of a sub-index.
    pub fn entry(&self, sub: u8) -> Option<&Entry> {
        self.entries.iter().find(|entry| (entry.sub..=entry.to).contains(&sub))
    }

    /// Objects that decide how entries of this one are read, in all repeats.
    pub(super) fn deciding(&self, all: &mut Vec<ObjectAddress>) {
        for entry in &self.entries {
            let looks = std::iter::once(&entry.look).chain(entry.modes.iter().map(|(_, look)| look));
            let scales = looks.filter_map(|look| match look.scale {
                Some(Scale::ByObject { object, .. }) => Some(object),
                _ => None,
            });
            let modes = entry.modes.iter().map(|(when, _)| when.object);
            for reference in scales.chain(modes) {
                all.extend(
                    (0..self.repeat.count.min(MOST_REPEATS))
                        .map(|nth| reference.shifted(nth, self.repeat.stride)),
                );
            }
        }
    }

    /// Number of a repeat as people count, from 1.
    pub fn number(&self, nth: u16) -> u16 {
        self.repeat.first.saturating_add(nth)
    }

    /// Entries after repeats.
    pub fn count(&self) -> usize {
        let subs = self.entries.iter().map(|entry| usize::from(entry.to - entry.sub) + 1);
        subs.sum::<usize>() * usize::from(self.repeat.count)
    }
}

impl Entry {
    /// When a write acts and whether it stays, where the device tells. A signature is a command, no value.
    pub(crate) fn consequence(&self) -> (Option<Effect>, Option<&'static str>) {
        if self.format == Format::Ascii {
            return (None, None);
        }
        let effect = Some(self.effect).filter(|effect| *effect != Effect::Unknown);
        let storage = Some(self.storage).filter(|storage| *storage != Storage::Unknown);
        (effect, storage.map(Storage::persists))
    }

    /// The raw number it holds as delivered; `$NODEID+0x200` is one where the node-ID is known.
    pub fn default_number(&self, node: Option<u8>) -> Option<i64> {
        match self.default.as_ref()? {
            Given::Number(number) => Some(*number),
            Given::Text(text) if self.data_type.is_none_or(DataType::is_integer) => {
                i64::try_from(formula(text, node)?).ok()
            }
            Given::Text(_) | Given::Real(_) => None,
        }
    }
}

impl Found<'_> {
    /// The entry as one of its own: a single sub-index, without repeat, with references that do not move.
    pub(super) fn alone(&self) -> Option<Entry> {
        let (nth, stride) = (self.nth, self.object.repeat.stride);
        let mut entry = self.entry?.clone();
        (entry.sub, entry.to) = (self.address.sub, self.address.sub);
        entry.channel = self.channel();
        entry.only = Only::default();
        entry.save = entry.save.map(|save| save.pinned(nth, stride));
        entry.invalidates = entry.invalidates.iter().map(|range| range.pinned(nth, stride)).collect();
        for (when, _) in &mut entry.modes {
            when.object = when.object.pinned(nth, stride);
        }
        let modes = entry.modes.iter_mut().map(|(_, look)| look);
        for look in modes.chain([&mut entry.look]) {
            for name in [&mut look.name, &mut look.short].into_iter().flatten() {
                *name = self.numbered(name);
            }
            look.of = look.of.map(|of| of.pinned(nth, stride));
            if let Some(Scale::ByObject { object, .. }) = &mut look.scale {
                *object = object.pinned(nth, stride);
            }
        }
        Some(entry)
    }

    /// Name of the object.
    pub fn object_name(&self) -> String {
        self.numbered(&self.object.name)
    }

    /// `Producer heartbeat time`, `Identity object, Vendor-ID`.
    pub fn name(&self) -> String {
        let entry = self.entry.filter(|_| self.object.is_record).and_then(|entry| entry.look.name.as_deref());
        match entry {
            Some(entry) if entry != self.object.name => {
                format!("{}, {}", self.object_name(), self.numbered(entry))
            }
            _ => self.object_name(),
        }
    }

    /// The output of the device it belongs to.
    pub fn channel(&self) -> Option<u8> {
        let own = self.entry.and_then(|entry| entry.channel);
        let of_repeat = || u8::try_from(self.object.number(self.nth)).ok();
        own.or_else(|| self.object.repeat.channel.then(of_repeat).flatten())
    }

    /// A name with the number of the repeat in the place of `{n}`.
    pub fn numbered(&self, name: &str) -> String {
        if name.contains("{n}") {
            name.replace("{n}", &self.object.number(self.nth).to_string())
        } else {
            name.to_owned()
        }
    }

    /// The object a reference in this entry means.
    pub fn shifted(&self, reference: Reference) -> ObjectAddress {
        reference.shifted(self.nth, self.object.repeat.stride)
    }
}
