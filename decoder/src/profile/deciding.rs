//! Objects whose values decide the meaning of other objects or PDOs.

use std::ops::Deref;
use std::sync::{Arc, OnceLock};

use super::dictionary::Dictionary;
use super::layer::DocumentLayer;
use crate::wire::canopen::ObjectAddress;

/// Objects that modes, scales and PDO layouts depend on, ascending. Those of the dictionary are collected on
/// first use, because this reads objects that may never be needed otherwise.
#[derive(Debug, Clone, Default)]
pub struct DecidingObjects {
    layers: Vec<Arc<DocumentLayer>>,
    of_pdos: Vec<ObjectAddress>,
    all: OnceLock<Vec<ObjectAddress>>,
}

impl DecidingObjects {
    pub(super) fn new(dictionary: &Dictionary, of_pdos: Vec<ObjectAddress>) -> Self {
        Self { layers: dictionary.layers.clone(), of_pdos, all: OnceLock::new() }
    }
}

impl Deref for DecidingObjects {
    type Target = [ObjectAddress];

    fn deref(&self) -> &[ObjectAddress] {
        self.all.get_or_init(|| {
            let mut all = self.of_pdos.clone();
            self.layers.iter().for_each(|layer| layer.collect_deciding(&mut all));
            all.sort_unstable();
            all.dedup();
            all
        })
    }
}
