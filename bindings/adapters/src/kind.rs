//! The kinds of adapters, and the interface that they have in common.

use std::time::Duration;

use crate::{ControllerStatus, Disconnected, OpenError, ReceivedItem, gs_usb, kvaser, pcan};

/// A kind of adapters.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum AdapterKind {
    /// PEAK-System, through PCAN-Basic.
    Pcan,
    /// Kvaser, through CANlib.
    Kvaser,
    /// candleLight, CANable 2 and others, over USB without a driver.
    GsUsb,
}

/// An adapter channel that a driver reports.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct AdapterChannel {
    /// Name for [`AdapterKind::listen`]: `USB1`, `0`, a serial number.
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
pub trait ChannelListener: Send {
    /// Appends received items in order, waiting at most `wait` for the first one.
    ///
    /// # Errors
    /// The adapter is unplugged, or the driver closed the channel.
    fn read(&mut self, readings: &mut Vec<ReceivedItem>, wait: Duration) -> Result<(), Disconnected>;

    /// State of the controller.
    ///
    /// # Errors
    /// The adapter is unplugged, or the driver closed the channel.
    fn status(&mut self) -> Result<ControllerStatus, Disconnected>;

    /// Whether timestamps are those of the adapter; otherwise of this computer at reading.
    fn has_stamps(&self) -> bool {
        true
    }
}

impl AdapterKind {
    /// All kinds.
    pub const ALL: [Self; 3] = [Self::Pcan, Self::Kvaser, Self::GsUsb];

    /// Start of a source on the command line: `pcan` in `pcan:USB1@500k`.
    pub const fn prefix(self) -> &'static str {
        match self {
            Self::Pcan => "pcan",
            Self::Kvaser => "kvaser",
            Self::GsUsb => "gs_usb",
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
            Self::GsUsb => "update its firmware, or use another adapter",
        }
    }

    /// Channels of the adapters that are plugged in.
    ///
    /// # Errors
    /// The driver is missing or fails.
    pub fn channels(self) -> Result<Vec<AdapterChannel>, OpenError> {
        match self {
            Self::Pcan => pcan::channels(),
            Self::Kvaser => kvaser::channels(),
            Self::GsUsb => gs_usb::channels(),
        }
    }

    /// Opens a channel in listen-only mode, `bit_rate` in bit/s.
    ///
    /// # Errors
    /// Driver, channel, bit rate or listen-only mode are not available, or another program uses the channel.
    pub fn listen(self, channel: &str, bit_rate: u32) -> Result<Box<dyn ChannelListener>, OpenError> {
        match self {
            Self::Pcan => Ok(Box::new(pcan::PcanListener::open(channel, bit_rate)?)),
            Self::Kvaser => Ok(Box::new(kvaser::KvaserListener::open(channel, bit_rate)?)),
            Self::GsUsb => Ok(Box::new(gs_usb::GsUsbListener::open(channel, bit_rate)?)),
        }
    }
}
