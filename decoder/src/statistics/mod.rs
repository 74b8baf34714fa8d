//! Who is on a bus, how often, how late: counted in one pass, in bounded memory.

mod bits;
mod bus;
mod codes;
mod distribution;
mod identifiers;
mod intervals;
mod j1939;
mod load;
mod node;
mod quality;

pub use bits::frame_bits;
pub use bus::{BusStatistics, IdStatistics, MasterStatistics};

pub use codes::{CodeCounts, dtc_of_key};
pub use codes::{MOST_CODES, dtc_key};
pub use distribution::Distribution;
pub use identifiers::{IdentifierRow, Identifiers, MOST_ROWS};
pub use intervals::Intervals;
pub use j1939::AddressStatistics;
pub use load::Load;
pub use node::NodeStatistics;
pub use quality::{Quality, span};

use crate::event::Event;
use crate::frame::Frame;

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
