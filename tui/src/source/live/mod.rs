//! Buses as they are now. Nothing here transmits, ever.
//!
//! ```text
//! can0 ──a thread each──▶ ┐
//! slcan:… ───────────────▶├─ gather: in order of time ──▶ frames and notices ──▶ screen, lines, rules, record
//! socketcand://… ────────▶┘
//! ```
//!
//! A source tells of its buses what a recorder knows: frames, links that open and close, frames that were lost.
//! Where it is gone it comes back by itself.

mod backoff;
mod clock;
mod gather;
pub mod lines;
mod returning;
#[cfg(feature = "serial")]
pub mod slcan;
#[cfg(not(feature = "serial"))]
#[path = "no_slcan.rs"]
pub mod slcan;
#[cfg(all(target_os = "linux", feature = "socketcan"))]
pub mod socketcan;
#[cfg(not(all(target_os = "linux", feature = "socketcan")))]
#[path = "no_socketcan.rs"]
pub mod socketcan;
pub mod socketcand;
mod spec;
mod state;

use std::time::Duration;

use cobscope_decoder::capture::{BusNames, Notice};
use cobscope_decoder::frame::{Frame, LinkState};

pub use gather::Gather;
pub use spec::SourceSpec;
pub use state::{Live, LiveState};

/// What came of a source.
#[derive(Debug, Clone)]
pub enum Arrival {
    /// A frame with its time in nanoseconds since 1970, where the source has one; its number counts nothing.
    Frame(Frame),
    /// A link that changed, frames that were lost, what could not be read.
    Notice(Notice),
}

/// What came of a source at once, in its order.
#[derive(Debug, Default)]
pub struct Arrivals {
    /// Its buses, which frames and notices name by index; the names stay while it is open.
    pub names: BusNames,
    /// What came.
    pub items: Vec<Arrival>,
}

/// Why nothing comes of a source any more.
#[derive(Debug)]
pub enum Ended {
    /// It is at its end: standard input was closed.
    Complete,
    /// It will not come back.
    Failed(anyhow::Error),
}

/// Whose clock stamps frames.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Stamps {
    /// The controller's own.
    Hardware,
    /// The kernel's, when the frame was received.
    Kernel,
    /// The adapter's, on this computer's clock.
    Adapter,
    /// This program's, when it read the frame.
    Arrival,
    /// They stand in what is read.
    Recorded,
}

impl Stamps {
    /// Whose clock; nothing where the stamps are those of what is read.
    pub const fn whose(self) -> Option<&'static str> {
        match self {
            Self::Hardware => Some("the controller"),
            Self::Kernel => Some("the kernel"),
            Self::Adapter => Some("the adapter"),
            Self::Arrival => Some("arrival"),
            Self::Recorded => None,
        }
    }
}

/// What is known of a bus besides its frames.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct BusStatus {
    /// Its name.
    pub name: String,
    /// Whether frames can come.
    pub state: LinkState,
    /// Bit rate in bit/s.
    pub bit_rate: Option<u32>,
    /// State of the controller and its error counters, as people say it: `error passive, rx 135 tx 0`.
    pub controller: Option<String>,
    /// Whose clock.
    pub stamps: Stamps,
    /// Frames lost since it was opened.
    pub lost: u64,
}

/// One source of frames, which has a thread of its own.
pub trait Source: Send {
    /// Takes what has arrived, in batches, waiting at most `wait` for the first of it. While it is gone it waits too:
    /// it never returns with nothing before `wait` is over.
    ///
    /// # Errors
    /// When nothing more will come.
    fn receive(&mut self, arrivals: &mut Arrivals, wait: Duration) -> Result<(), Ended>;

    /// What is known of its buses now; asked about once a second.
    fn status(&mut self) -> Vec<BusStatus>;

    /// How late what happened may arrive at most while nothing is wrong.
    fn lag(&self) -> Duration;
}
