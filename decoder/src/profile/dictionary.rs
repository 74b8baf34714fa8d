//! Objects by address, from the device profile and the standards that it extends.

use std::sync::Arc;

use super::data_type::DataType;
use super::entry::{ObjectEntry, SubEntry};
use super::error_texts::ErrorTexts;
use super::layer::DocumentLayer;
use super::object::{RawScale, VariantFilter};
use super::reference::ObjectReference;
use crate::wire::canopen::ObjectAddress;

/// Objects of one or several documents; the first definition of an address takes precedence.
#[derive(Debug, Clone, Default)]
pub struct Dictionary {
    pub(super) layers: Vec<Arc<DocumentLayer>>,
    /// Texts of the device's error codes.
    pub(super) errors: ErrorTexts,
}

/// Definition of an address: object, entry if the sub-index is described, repeat number.
#[derive(Debug, Clone, Copy)]
pub struct ResolvedObject<'a> {
    /// Requested address.
    pub address: ObjectAddress,
    /// Object with this index.
    pub object: &'a ObjectEntry,
    /// Sub-entry; `None` if the sub-index is not described.
    pub entry: Option<&'a SubEntry>,
    /// Repeat number, from 0.
    pub nth: u16,
}

impl Dictionary {
    /// Definition of an address.
    pub fn find_object(&self, address: ObjectAddress) -> Option<ResolvedObject<'_>> {
        let mut index_only = None;
        for (object, nth) in self.layers.iter().flat_map(|layer| layer.objects_at(address.index)) {
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
        self.layers.iter().position(|layer| layer.has_object(address))
    }

    /// Addresses with sub-index 0 or 1 that have a default and that `picks` accepts, ascending.
    pub fn defaults(&self, picks: impl Fn(ObjectAddress) -> bool) -> Vec<ObjectAddress> {
        let mut found = Vec::new();
        for layer in &self.layers {
            layer.collect_defaults(&picks, &mut found);
        }
        found.sort_unstable();
        found.dedup();
        found
    }

    /// Data type of an address.
    pub fn data_type(&self, address: ObjectAddress) -> Option<DataType> {
        self.find_object(address)?.entry?.data_type
    }

    /// Whether the device profile itself describes an address, rather than a standard it extends.
    pub fn is_own(&self, address: ObjectAddress) -> bool {
        self.layers.first().is_some_and(|own| own.has_object(address))
    }

    /// Objects of the device profile itself.
    pub fn own_objects(&self) -> &[ObjectEntry] {
        self.layers.first().map_or(&[], |layer| layer.objects())
    }
}

impl ResolvedObject<'_> {
    /// Copy of the entry for this sub-index alone, with references that do not move with repeats.
    pub(super) fn lone_entry(&self) -> Option<SubEntry> {
        let (nth, stride) = (self.nth, self.object.repeat.stride);
        let mut entry = self.entry?.clone();
        (entry.sub, entry.to) = (self.address.sub, self.address.sub);
        entry.channel = self.channel();
        entry.only = VariantFilter::default();
        entry.save = entry.save.map(|save| save.pin_repeat(nth, stride));
        entry.invalidates = entry.invalidates.iter().map(|range| range.pin_repeat(nth, stride)).collect();
        for (when, _) in &mut entry.modes {
            when.object = when.object.pin_repeat(nth, stride);
        }
        let modes = entry.modes.iter_mut().map(|(_, look)| look);
        for look in modes.chain([&mut entry.look]) {
            for name in [&mut look.name, &mut look.short].into_iter().flatten() {
                *name = self.number_name(name);
            }
            look.of = look.of.map(|of| of.pin_repeat(nth, stride));
            if let Some(RawScale::ByObject { object, .. }) = &mut look.scale {
                *object = object.pin_repeat(nth, stride);
            }
        }
        Some(entry)
    }

    /// Name of the object, with its repeat number.
    pub fn object_name(&self) -> String {
        self.number_name(&self.object.name)
    }

    /// Full name: `Producer heartbeat time`, `Identity object, Vendor-ID`.
    pub fn name(&self) -> String {
        let entry = self.entry.filter(|_| self.object.is_record).and_then(|entry| entry.look.name.as_deref());
        match entry {
            Some(entry) if entry != self.object.name => {
                let mut name = self.object_name();
                name.push_str(", ");
                name.push_str(&self.number_name(entry));
                name
            }
            _ => self.object_name(),
        }
    }

    /// Channel that the entry belongs to.
    pub fn channel(&self) -> Option<u8> {
        let own = self.entry.and_then(|entry| entry.channel);
        let of_repeat = || u8::try_from(self.object.repeat_number(self.nth)).ok();
        own.or_else(|| self.object.repeat.channel.then(of_repeat).flatten())
    }

    /// Replaces `{n}` in a name by the repeat number.
    pub fn number_name(&self, name: &str) -> String {
        // Most names have no number; a single byte is found faster.
        if name.as_bytes().contains(&b'{') && name.contains("{n}") {
            name.replace("{n}", &self.object.repeat_number(self.nth).to_string())
        } else {
            name.to_owned()
        }
    }

    /// Object that a reference in this entry addresses.
    pub fn shift_reference(&self, reference: ObjectReference) -> ObjectAddress {
        reference.shift_object(self.nth, self.object.repeat.stride)
    }
}
