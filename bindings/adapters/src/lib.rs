//! CAN adapters of PEAK (PCAN-Basic), Kvaser (CANlib) and with the gs_usb protocol in listen-only mode.
//!
//! The libraries of the vendors are loaded at run time. Functions that transmit are not bound. Listen-only mode is
//! set and read back before the channel joins the bus, and read back once more afterwards. gs_usb adapters need no
//! library; their protocol sets the mode in the request that joins the bus, and their endpoint for frames to transmit is
//! not opened. An adapter without the mode is refused.
//!
//! ```no_run
//! use std::time::Duration;
//! use cobscope_adapters::AdapterKind;
//!
//! let mut listener = AdapterKind::Pcan.listen("USB1", 500_000)?;
//! let mut readings = Vec::new();
//! listener.read(&mut readings, Duration::from_millis(100))?;
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```
//!
//! Published crates were examined in November 2026. can-hal-pcan 0.4.3 defines `PCAN_LISTEN_ONLY` and never sets it.
//! peak-can 0.2.0 sets it on an open channel, which has then been on the bus in normal mode. Both can transmit.

#![allow(unsafe_code, reason = "functions in C; each block states why its call is sound")]

mod driver_text;
mod error;
pub mod gs_usb;
mod kind;
pub mod kvaser;
mod library;
pub mod pcan;
mod reading;
mod vendor;

pub use error::{Disconnected, OpenError};
pub use kind::{AdapterChannel, AdapterKind, ChannelListener, ChannelState};
pub use reading::{
    AdapterErrorFrame, BusError, ControllerStatus, ErrorCounters, FaultConfinement, ReceivedFrame,
    ReceivedItem, ViolationKind,
};
pub use vendor::Vendor;
