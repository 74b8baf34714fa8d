//! Who is on a bus, how often, how late: counted in one pass, in bounded memory.

mod bits;
mod bus;
mod distribution;
mod identifiers;
mod intervals;
mod j1939;
mod load;
mod node;
mod quality;

pub use bits::frame_bits;
pub use bus::{BusStatistics, IdStatistics, MasterStatistics};
pub use distribution::Distribution;
pub use identifiers::{IdentifierRow, Identifiers, MOST_ROWS};
pub use intervals::Intervals;
pub use j1939::{AddressStatistics, dtc_key, dtc_of_key};
pub use load::Load;
pub use node::NodeStatistics;
pub use quality::{Quality, span};

use crate::event::Event;
use crate::frame::Frame;

/// Identifiers of a bus that are counted one by one.
pub const MOST_IDS: usize = 4096;

/// Codes counted one by one of each kind and node.
pub const MOST_CODES: usize = 64;

/// Figures of one capture.
#[derive(Debug, Clone, Default)]
pub struct Statistics {
    /// The capture itself.
    pub quality: Quality,
    /// Its buses, in order of appearance.
    pub buses: Vec<BusStatistics>,
}

impl Statistics {
    /// Takes a frame, before its events.
    pub fn frame(&mut self, frame: &Frame) {
        self.quality.frame(frame);
        self.bus(frame.bus.0).frame(frame);
    }

    /// Takes an event.
    pub fn event(&mut self, event: &Event) {
        self.quality.event(event);
        self.bus(event.bus.0).event(event);
    }

    fn bus(&mut self, index: u8) -> &mut BusStatistics {
        let place = usize::from(index);
        while self.buses.len() <= place {
            self.buses.push(BusStatistics::default());
        }
        // There is one of this index now.
        #[expect(clippy::indexing_slicing, reason = "the loop above made it")]
        &mut self.buses[place]
    }
}

/// Counts of codes, the first [`MOST_CODES`] of them apart.
#[derive(Debug, Clone, Default)]
pub struct CodeCounts {
    /// Code and how often.
    pub codes: Vec<(u32, u64)>,
    /// How often any further code came.
    pub others: u64,
}

impl CodeCounts {
    /// Counts one.
    pub fn add(&mut self, code: u32) {
        let has_room = self.codes.len() < MOST_CODES;
        match self.codes.iter_mut().find(|(known, _)| *known == code) {
            Some((_, count)) => *count += 1,
            None if has_room => self.codes.push((code, 1)),
            None => self.others += 1,
        }
    }

    /// How often any code came.
    pub fn total(&self) -> u64 {
        self.codes.iter().map(|(_, count)| count).sum::<u64>().saturating_add(self.others)
    }

    /// Codes, the most frequent first.
    pub fn sorted(&self) -> Vec<(u32, u64)> {
        let mut codes = self.codes.clone();
        codes.sort_by_key(|(code, count)| (std::cmp::Reverse(*count), *code));
        codes
    }
}
