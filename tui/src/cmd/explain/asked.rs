//! Look-ups for `explain`: in the profile of `--device`, else in all profiles.

use std::sync::Arc;

use cobscope_decoder::profile::{self, Catalogue, DeviceProfile};
use cobscope_decoder::wire::canopen::ObjectAddress;

/// All profiles, and the device of `--device`.
pub(super) struct LookupScope {
    pub catalogue: Catalogue,
    pub device: Option<Arc<DeviceProfile>>,
}

impl LookupScope {
    /// Whether the device, or CiA 301 without `--device`, defines an object with this index.
    pub fn knows_index(&self, index: u16) -> bool {
        let device = self.device.as_ref().unwrap_or_else(|| profile::plain_device());
        let is_own = device.dictionary.own_objects().iter().any(|object| object.repeat_of(index).is_some());
        is_own || device.dictionary.find_object(ObjectAddress::new(index, 0)).is_some()
    }

    /// Results of all devices, as `rexroth-sydfec: result`; variants with equal results are merged.
    pub fn every_device(&self, ask: impl Fn(&DeviceProfile) -> Option<String>) -> Vec<String> {
        let mut lines = Vec::new();
        for id in self.catalogue.ids() {
            // Invalid profiles were reported when they were read.
            let Ok(device) = self.catalogue.device(&id) else { continue };
            let answer = ask(&device);
            let variants = device.variants.iter();
            let others = variants.filter_map(|it| self.catalogue.device(&format!("{id}:{}", it.id)).ok());
            let others: Vec<_> = others.map(|device| (device.full_id.clone(), ask(&device))).collect();
            if others.iter().all(|(_, other)| *other == answer) {
                lines.extend(answer.map(|answer| format!("{id}: {answer}")));
            } else {
                let entries =
                    others.into_iter().filter_map(|(id, answer)| Some(format!("{id}: {}", answer?)));
                lines.extend(entries);
            }
        }
        lines
    }
}
