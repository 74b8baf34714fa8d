//! The buses of a capture, as observers see them.

use super::bus::Bus;
use super::decoder::BusDecoder;

/// Buses in order of appearance: a view of a slice, as cheap to copy.
#[derive(Debug, Clone, Copy, Default)]
pub struct Buses<'a>(&'a [BusDecoder]);

impl<'a> Buses<'a> {
    /// The buses of these decoders.
    pub fn new(decoders: &'a [BusDecoder]) -> Self {
        Self(decoders)
    }

    /// The bus at a place.
    pub fn get(self, place: usize) -> Option<&'a Bus> {
        self.0.get(place).map(BusDecoder::bus)
    }

    /// The first bus.
    pub fn first(self) -> Option<&'a Bus> {
        self.get(0)
    }

    /// Number of buses.
    pub fn len(self) -> usize {
        self.0.len()
    }

    /// Whether no bus appeared yet.
    pub fn is_empty(self) -> bool {
        self.0.is_empty()
    }

    /// All buses.
    pub fn iter(self) -> impl ExactSizeIterator<Item = &'a Bus> + Clone {
        self.0.iter().map(BusDecoder::bus)
    }
}

impl<'a> IntoIterator for Buses<'a> {
    type Item = &'a Bus;
    type IntoIter = std::iter::Map<std::slice::Iter<'a, BusDecoder>, fn(&'a BusDecoder) -> &'a Bus>;

    fn into_iter(self) -> Self::IntoIter {
        self.0.iter().map(BusDecoder::bus)
    }
}
