//! Read access to all buses of a capture, for observers.

use super::bus::Bus;
use super::decoder::BusDecoder;

/// Buses in order of appearance; a borrowed slice that is cheap to copy.
#[derive(Debug, Clone, Copy, Default)]
pub struct Buses<'a>(&'a [BusDecoder]);

impl<'a> Buses<'a> {
    /// Buses of these decoders, in their order.
    pub fn new(decoders: &'a [BusDecoder]) -> Self {
        Self(decoders)
    }

    /// Bus number `place`, counted from 0.
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

    /// Iterator over all buses.
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
