//! The vendors, and the interface that their drivers have in common.

use std::time::Duration;

use crate::{ControllerStatus, Disconnected, OpenError, Reading, kvaser, pcan};

/// A vendor of adapters.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Vendor {
    /// PEAK-System, PCAN-Basic.
    Pcan,
    /// Kvaser, CANlib.
    Kvaser,
}

/// An adapter channel that a driver reports.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Channel {
    /// Name for [`Vendor::listen`]: `USB1`, `0`.
    pub name: String,
    /// Device with its channel: `PCAN-USB Pro FD, channel 2`.
    pub device: String,
    /// Availability.
    pub state: ChannelState,
}

/// Availability of a channel.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ChannelState {
    /// It can be opened.
    Available,
    /// Another program uses it.
    InUse,
    /// It has no listen-only mode.
    NotListenOnly,
    /// The driver does not state it, or states that it is not available.
    Unavailable,
}

/// A channel in listen-only mode. Dropping it takes the channel off the bus and closes it.
pub trait Listener: Send {
    /// Appends received items in order, waiting at most `wait` for the first one.
    ///
    /// # Errors
    /// The adapter is unplugged, or the driver closed the channel.
    fn read(&mut self, readings: &mut Vec<Reading>, wait: Duration) -> Result<(), Disconnected>;

    /// State of the controller.
    ///
    /// # Errors
    /// The adapter is unplugged, or the driver closed the channel.
    fn status(&mut self) -> Result<ControllerStatus, Disconnected>;
}

impl Vendor {
    /// All vendors.
    pub const ALL: [Self; 2] = [Self::Pcan, Self::Kvaser];

    /// Start of a source on the command line: `pcan` in `pcan:USB1@500k`.
    pub const fn prefix(self) -> &'static str {
        match self {
            Self::Pcan => "pcan",
            Self::Kvaser => "kvaser",
        }
    }

    /// Name of the company.
    pub const fn maker(self) -> &'static str {
        match self {
            Self::Pcan => "PEAK",
            Self::Kvaser => "Kvaser",
        }
    }

    /// Environment variable with the path of a library in place of the installed one.
    pub const fn variable(self) -> &'static str {
        match self {
            Self::Pcan => "COBSCOPE_PCAN_LIBRARY",
            Self::Kvaser => "COBSCOPE_KVASER_LIBRARY",
        }
    }

    /// Package of the vendor that contains the library.
    pub const fn package(self) -> &'static str {
        match (self, cfg!(windows)) {
            (Self::Pcan, true) => "\"PEAK-System Device Driver Setup\" with the PCAN-Basic API",
            (Self::Pcan, false) => "\"PCAN-Basic API for Linux\" and its driver pcan (peak-system.com)",
            (Self::Kvaser, true) => "\"Kvaser Drivers for Windows\"",
            (Self::Kvaser, false) => "\"Kvaser Linux Drivers and SDK\" (linuxcan, kvaser.com)",
        }
    }

    pub(crate) const fn windows_library(self) -> &'static str {
        match self {
            Self::Pcan => "PCANBasic.dll",
            Self::Kvaser => "canlib32.dll",
        }
    }

    pub(crate) const fn linux_library(self) -> &'static str {
        match self {
            Self::Pcan => "libpcanbasic.so",
            Self::Kvaser => "libcanlib.so",
        }
    }

    /// Firmware and devices with listen-only mode. Linux, drivers/net/can/usb/peak_usb/pcan_usb.c: silent mode needs a
    /// device revision above 3. Kvaser, developer blog of 2022-01-26: the Pro series has silent mode, the Light series has
    /// not.
    pub(crate) const fn listen_only_remedy(self) -> &'static str {
        match self {
            Self::Pcan => {
                "update the driver to PCAN-Basic 4, and the firmware of a PCAN-USB to version 4 or later; close other \
                 programs that use the channel"
            }
            Self::Kvaser => {
                "use an adapter with silent mode (Leaf Pro HS v2, U100; the Leaf Light series has none) and a recent \
                 driver"
            }
        }
    }

    /// Channels of the adapters that are plugged in.
    ///
    /// # Errors
    /// The driver is missing or fails.
    pub fn channels(self) -> Result<Vec<Channel>, OpenError> {
        match self {
            Self::Pcan => pcan::channels(),
            Self::Kvaser => kvaser::channels(),
        }
    }

    /// Opens a channel in listen-only mode, `bit_rate` in bit/s.
    ///
    /// # Errors
    /// Driver, channel, bit rate or listen-only mode are not available, or another program uses the channel.
    pub fn listen(self, channel: &str, bit_rate: u32) -> Result<Box<dyn Listener>, OpenError> {
        match self {
            Self::Pcan => Ok(Box::new(pcan::PcanListener::open(channel, bit_rate)?)),
            Self::Kvaser => Ok(Box::new(kvaser::KvaserListener::open(channel, bit_rate)?)),
        }
    }
}
