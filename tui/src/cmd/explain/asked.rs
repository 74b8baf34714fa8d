//! Whom `explain` asks: the device that was named, else every manual.

use std::sync::Arc;

use cobscope_decoder::profile::{self, Catalogue, Device};
use cobscope_decoder::wire::canopen::ObjectAddress;

/// All profiles, and the device of `--device`.
pub(super) struct Asked {
    pub catalogue: Catalogue,
    pub device: Option<Arc<Device>>,
}

impl Asked {
    /// Whether the device, or CiA 301 where none is named, has an object of this index.
    pub fn knows_index(&self, index: u16) -> bool {
        let device = self.device.as_ref().unwrap_or_else(|| profile::plain_device());
        let is_own = device.dictionary.own().iter().any(|object| object.nth(index).is_some());
        is_own || device.dictionary.find(ObjectAddress::new(index, 0)).is_some()
    }

    /// What each device answers, as `rexroth-sydfec: answer`; variants that agree are one.
    pub fn every_device(&self, ask: impl Fn(&Device) -> Option<String>) -> Vec<String> {
        let mut lines = Vec::new();
        for id in self.catalogue.ids() {
            // A broken profile was said when it was read.
            let Ok(device) = self.catalogue.device(&id) else { continue };
            let answer = ask(&device);
            let variants = device.variants.iter();
            let others = variants.filter_map(|it| self.catalogue.device(&format!("{id}:{}", it.id)).ok());
            let others: Vec<_> = others.map(|device| (device.full_id.clone(), ask(&device))).collect();
            if others.iter().all(|(_, other)| *other == answer) {
                lines.extend(answer.map(|answer| format!("{id}: {answer}")));
            } else {
                let told = others.into_iter().filter_map(|(id, answer)| Some(format!("{id}: {}", answer?)));
                lines.extend(told);
            }
        }
        lines
    }
}
