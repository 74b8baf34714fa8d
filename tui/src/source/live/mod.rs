//! Live buses. Nothing here transmits.
//!
//! ```text
//! can0 ──one thread each──▶ ┐
//! slcan:… pcan:… gs_usb:… ─▶├─ gather: in time order ──▶ frames and notices ──▶ screen, text, rules, capture
//! socketcand://… ──────────▶┘
//! ```
//!
//! A source reports frames, link states and lost frames of its buses. It reconnects automatically after a
//! disconnection.

#[cfg(feature = "adapters")]
pub mod adapters;
#[cfg(not(feature = "adapters"))]
#[path = "no_adapters.rs"]
pub mod adapters;
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
#[cfg(any(feature = "serial", feature = "adapters"))]
mod stamps;
mod state;

use std::time::Duration;

use cobscope_decoder::capture::{BusNames, Notice};
use cobscope_decoder::frame::{Frame, LinkState};

pub use gather::SourceGather;
pub use spec::{AdapterSpec, SERIAL_EXAMPLE, SourceSpec};
pub use state::{LiveBusState, SharedLiveState};

/// An item of a source.
#[derive(Debug, Clone)]
pub enum Arrival {
    /// A frame with its time in ns since 1970, if the source has one; its number is not used.
    Frame(Frame),
    /// A change of a link, lost frames or unreadable input.
    Notice(Notice),
}

/// Items received together, in order.
#[derive(Debug, Default)]
pub struct Arrivals {
    /// Buses of the source. Frames and notices refer to them by index; they stay while it is open.
    pub names: BusNames,
    /// The items.
    pub items: Vec<Arrival>,
}

/// End of a source.
#[derive(Debug)]
pub enum SourceEnd {
    /// The input is complete: standard input was closed.
    Complete,
    /// A failure without reconnection.
    Failed(anyhow::Error),
}

/// Clock of the timestamps.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum SourceClock {
    /// Clock of the CAN controller.
    Hardware,
    /// Clock of the kernel at reception.
    Kernel,
    /// Clock of the adapter, mapped to this computer.
    Adapter,
    /// Clock of this program at reading.
    Arrival,
    /// Timestamps contained in the input.
    Recorded,
}

impl SourceClock {
    /// Name of the clock; None for timestamps contained in the input.
    pub const fn clock_name(self) -> Option<&'static str> {
        match self {
            Self::Hardware => Some("the controller"),
            Self::Kernel => Some("the kernel"),
            Self::Adapter => Some("the adapter"),
            Self::Arrival => Some("arrival"),
            Self::Recorded => None,
        }
    }
}

/// Part that the controller of a bus takes in the traffic while it is read; this program sends no frame in any mode.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ControllerMode {
    /// The controller neither acknowledges frames nor sends error frames.
    ListenOnly,
    /// Normal mode, which the system has set.
    Normal,
    /// The driver does not report the mode.
    Unreported,
    /// The mode is set by the server of the bus.
    OfServer,
}

impl ControllerMode {
    /// Whether the controller certainly takes no part in the traffic.
    pub const fn is_listen_only(self) -> bool {
        matches!(self, Self::ListenOnly)
    }

    /// The mode with its effect on the bus.
    pub const fn mode_text(self) -> &'static str {
        match self {
            Self::ListenOnly => "listen-only",
            Self::Normal => "acknowledges frames (listen-only off)",
            Self::Unreported => "may acknowledge frames (listen-only not reported by the driver)",
            Self::OfServer => "may acknowledge frames (listen-only set by the server)",
        }
    }
}

/// Status of a bus.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct BusStatus {
    /// Name of the bus.
    pub name: String,
    /// State of the link.
    pub state: LinkState,
    /// Bit rate in bit/s.
    pub bit_rate: Option<u32>,
    /// State of the controller with its error counters: `error passive, rx 135 tx 0`.
    pub controller: Option<String>,
    /// Mode of the controller; None for an interface that is not up, a virtual one, and text.
    pub mode: Option<ControllerMode>,
    /// Clock of the timestamps.
    pub stamps: SourceClock,
    /// Number of frames lost since it was opened.
    pub lost: u64,
}

/// A source of frames, read in its own thread.
pub trait LiveSource: Send {
    /// Appends received items, waiting at most `wait` for the first one. While disconnected it waits too: it
    /// never returns empty before `wait` is over.
    ///
    /// # Errors
    /// The source has ended.
    fn receive_items(&mut self, arrivals: &mut Arrivals, wait: Duration) -> Result<(), SourceEnd>;

    /// Status of its buses; requested about once per second.
    fn bus_status(&mut self) -> Vec<BusStatus>;

    /// Maximum delay of an item under normal conditions.
    fn max_lag(&self) -> Duration;

    /// Whether the clock of this computer gives the frames their times.
    fn has_local_times(&self) -> bool {
        false
    }
}
