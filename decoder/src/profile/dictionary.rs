//! Objects by address, from the device profile and the standards that it extends.

use std::ops::Range;
use std::sync::Arc;

use super::data_type::DataType;
use super::error_texts::ErrorTexts;
use super::formula::formula;
use super::layer::Layer;
use super::object::{
    Access, DefaultValue, Effect, Format, Interpretation, ObjectCondition, Repeat, Scale, Storage,
    VariantFilter,
};
use super::reference::{ObjectRange, Reference};
use crate::wire::canopen::ObjectAddress;

/// An object, or several equal objects at a constant distance.
#[derive(Debug, Clone)]
pub struct Object {
    /// Index of the first repeat.
    pub index: u16,
    /// Number of repeats and distance of their indexes.
    pub repeat: Repeat,
    /// Name; `{n}` is replaced by the repeat number.
    pub name: String,
    /// Sub-entries; a variable has one with sub-index 0.
    pub entries: Vec<Entry>,
    /// Whether the entries have separate names.
    pub is_record: bool,
    /// Variants it applies to; all if empty.
    pub only: VariantFilter,
    /// Section of the manual.
    pub source: String,
    pub(super) span: Range<usize>,
}

/// A sub-entry, or equal ones from `sub` to `to`.
#[derive(Debug, Clone)]
pub struct Entry {
    /// First sub-index.
    pub sub: u8,
    /// Last sub-index.
    pub to: u8,
    /// Data type; `None` if unknown.
    pub data_type: Option<DataType>,
    /// Access by SDO.
    pub access: Option<Access>,
    /// Number format in output.
    pub format: Format,
    /// Interpretation of the value.
    pub look: Interpretation,
    /// Interpretations by mode; the first match is used, missing keys are taken from `look`.
    pub modes: Vec<(ObjectCondition, Interpretation)>,
    /// Factory default.
    pub default: Option<DefaultValue>,
    /// Persistence of a written value.
    pub storage: Storage,
    /// Object that stores the value.
    pub save: Option<Reference>,
    /// Time at which a write takes effect.
    pub effect: Effect,
    /// Objects whose known value becomes invalid after a write.
    pub invalidates: Vec<ObjectRange>,
    pub(super) channel: Option<u8>,
    /// Raw values of a mode in which actual values do not follow set points.
    pub open_loop: Vec<i64>,
    /// Variants it applies to; all if empty.
    pub only: VariantFilter,
    /// Section of the manual.
    pub source: String,
    /// Assumption or defect of the manual.
    pub note: String,
    pub(super) span: Range<usize>,
}

/// Max repeats expanded for objects that decide the meaning or the identifiers of others.
pub(super) const MOST_REPEATS: u16 = 1024;

/// Objects of one or several documents; the first definition of an address takes precedence.
#[derive(Debug, Clone, Default)]
pub struct Dictionary {
    pub(super) layers: Vec<Arc<Layer>>,
    /// Texts of the device's error codes.
    pub(super) errors: ErrorTexts,
}

/// Definition of an address: object, entry if the sub-index is described, repeat number.
#[derive(Debug, Clone, Copy)]
pub struct ResolvedObject<'a> {
    /// Requested address.
    pub address: ObjectAddress,
    /// Object with this index.
    pub object: &'a Object,
    /// Sub-entry; `None` if the sub-index is not described.
    pub entry: Option<&'a Entry>,
    /// Repeat number, from 0.
    pub nth: u16,
}

impl Dictionary {
    /// Definition of an address.
    pub fn find(&self, address: ObjectAddress) -> Option<ResolvedObject<'_>> {
        let mut index_only = None;
        for (object, nth) in self.layers.iter().flat_map(|layer| layer.at(address.index)) {
            if let Some(entry) = object.entry(address.sub) {
                return Some(ResolvedObject { address, object, entry: Some(entry), nth });
            }
            if index_only.is_none() && object.is_record {
                index_only = Some(ResolvedObject { address, object, entry: None, nth });
            }
        }
        index_only
    }

    /// Index of the layer that describes an entry.
    pub(super) fn layer_of(&self, address: ObjectAddress) -> Option<usize> {
        self.layers.iter().position(|layer| layer.has(address))
    }

    /// Addresses with sub-index 0 or 1 that have a default and that `picks` accepts, ascending.
    pub fn defaults(&self, picks: impl Fn(ObjectAddress) -> bool) -> Vec<ObjectAddress> {
        let mut found = Vec::new();
        for layer in &self.layers {
            layer.defaults(&picks, &mut found);
        }
        found.sort_unstable();
        found.dedup();
        found
    }

    /// Data type of an address.
    pub fn data_type(&self, address: ObjectAddress) -> Option<DataType> {
        self.find(address)?.entry?.data_type
    }

    /// Whether the device profile itself describes an address, rather than a standard it extends.
    pub fn is_own(&self, address: ObjectAddress) -> bool {
        self.layers.first().is_some_and(|own| own.has(address))
    }

    /// Objects of the device profile itself.
    pub fn own(&self) -> &[Object] {
        self.layers.first().map_or(&[], |layer| layer.objects())
    }
}

impl Object {
    /// Repeat number of an index, from 0.
    pub fn nth(&self, index: u16) -> Option<u16> {
        let distance = index.checked_sub(self.index)?;
        if distance == 0 {
            return Some(0);
        }
        let Repeat { count, stride, .. } = self.repeat;
        let nth = distance.checked_div(stride)?;
        (distance % stride == 0 && nth < count).then_some(nth)
    }

    /// Entry with a sub-index.
    pub fn entry(&self, sub: u8) -> Option<&Entry> {
        self.entries.iter().find(|entry| (entry.sub..=entry.to).contains(&sub))
    }

    /// Collects the objects that decide the meaning of this object's entries, in all repeats.
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

    /// Repeat number for output.
    pub fn number(&self, nth: u16) -> u16 {
        self.repeat.first.saturating_add(nth)
    }

    /// Number of entries, including repeats.
    pub fn count(&self) -> usize {
        let subs = self.entries.iter().map(|entry| usize::from(entry.to - entry.sub) + 1);
        subs.sum::<usize>() * usize::from(self.repeat.count)
    }
}

impl Entry {
    /// Effect and persistence of a write, if known; none for signatures, which are commands rather than
    /// values.
    pub(crate) fn consequence(&self) -> (Option<Effect>, Option<&'static str>) {
        if self.format == Format::Ascii {
            return (None, None);
        }
        let effect = Some(self.effect).filter(|effect| *effect != Effect::Unknown);
        let storage = Some(self.storage).filter(|storage| *storage != Storage::Unknown);
        (effect, storage.map(Storage::persists))
    }

    /// Factory default as a raw number; formulas such as `$NODEID+0x200` require the node-ID.
    pub fn default_number(&self, node: Option<u8>) -> Option<i64> {
        match self.default.as_ref()? {
            DefaultValue::Number(number) => Some(*number),
            DefaultValue::Text(text) if self.data_type.is_none_or(DataType::is_integer) => {
                i64::try_from(formula(text, node)?).ok()
            }
            DefaultValue::Text(_) | DefaultValue::Real(_) => None,
        }
    }
}

impl ResolvedObject<'_> {
    /// Copy of the entry for this sub-index alone, with references that do not move with repeats.
    pub(super) fn alone(&self) -> Option<Entry> {
        let (nth, stride) = (self.nth, self.object.repeat.stride);
        let mut entry = self.entry?.clone();
        (entry.sub, entry.to) = (self.address.sub, self.address.sub);
        entry.channel = self.channel();
        entry.only = VariantFilter::default();
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

    /// Name of the object, with its repeat number.
    pub fn object_name(&self) -> String {
        self.numbered(&self.object.name)
    }

    /// Full name: `Producer heartbeat time`, `Identity object, Vendor-ID`.
    pub fn name(&self) -> String {
        let entry = self.entry.filter(|_| self.object.is_record).and_then(|entry| entry.look.name.as_deref());
        match entry {
            Some(entry) if entry != self.object.name => {
                format!("{}, {}", self.object_name(), self.numbered(entry))
            }
            _ => self.object_name(),
        }
    }

    /// Channel that the entry belongs to.
    pub fn channel(&self) -> Option<u8> {
        let own = self.entry.and_then(|entry| entry.channel);
        let of_repeat = || u8::try_from(self.object.number(self.nth)).ok();
        own.or_else(|| self.object.repeat.channel.then(of_repeat).flatten())
    }

    /// Replaces `{n}` in a name by the repeat number.
    pub fn numbered(&self, name: &str) -> String {
        if name.contains("{n}") {
            name.replace("{n}", &self.object.number(self.nth).to_string())
        } else {
            name.to_owned()
        }
    }

    /// Object that a reference in this entry addresses.
    pub fn shifted(&self, reference: Reference) -> ObjectAddress {
        reference.shifted(self.nth, self.object.repeat.stride)
    }
}
