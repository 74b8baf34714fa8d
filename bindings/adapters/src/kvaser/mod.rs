//! Kvaser adapters through CANlib (`canlib32.dll`, `libcanlib.so`).
//!
//! Signatures and constants: `canlib.h` and `canstat.h` of the CANlib SDK, compared with python-can,
//! `can/interfaces/kvaser/constants.py`, and linuxcan, `canlib/linux/canlib.c`.
//!
//! Classic CAN only: a channel opened for FD needs segments for both phases.

mod api;
mod message;

use std::sync::OnceLock;
use std::time::Duration;

use crate::reading::MAX_READINGS;
use crate::{
    AdapterChannel, AdapterKind, ChannelListener, ChannelState, ControllerStatus, Disconnected,
    ErrorCounters, FaultConfinement, OpenError, ReceivedItem,
};
use api::{CanlibFunctions, CanlibMessage, ChannelHandle};

/// Bit rates. CANlib has no constant for two rates of CiA 301: these sample at 87.5 and 80 % of a bit, and need a clock that
/// is a multiple of 8 MHz. The driver refuses them for an adapter with another clock.
const BIT_RATES: &[(u32, CanlibTiming)] = &[
    (10_000, CanlibTiming::constant(-9)),
    (20_000, CanlibTiming { bit_rate: 20_000, segment_1: 13, segment_2: 2, jump_width: 1, samples: 1 }),
    (50_000, CanlibTiming::constant(-7)),
    (62_500, CanlibTiming::constant(-6)),
    (83_333, CanlibTiming::constant(-8)),
    (100_000, CanlibTiming::constant(-5)),
    (125_000, CanlibTiming::constant(-4)),
    (250_000, CanlibTiming::constant(-3)),
    (500_000, CanlibTiming::constant(-2)),
    (800_000, CanlibTiming { bit_rate: 800_000, segment_1: 7, segment_2: 2, jump_width: 1, samples: 1 }),
    (1_000_000, CanlibTiming::constant(-1)),
];

/// Arguments of `canSetBusParams`.
#[derive(Debug, Clone, Copy)]
struct CanlibTiming {
    /// Bit rate in bit/s, or a constant (`canBITRATE_…`), which leaves the others to the driver.
    bit_rate: i32,
    /// Time quanta before the sample, without the first one.
    segment_1: u8,
    /// Time quanta after the sample.
    segment_2: u8,
    /// Time quanta by which a bit may be lengthened or shortened.
    jump_width: u8,
    /// Samples of a bit.
    samples: u8,
}

impl CanlibTiming {
    const fn constant(bit_rate: i32) -> Self {
        Self { bit_rate, segment_1: 0, segment_2: 0, jump_width: 0, samples: 0 }
    }
}

/// Capability of a channel (`canCHANNEL_CAP_SILENT_MODE`).
const SILENT_MODE: u32 = 0x0020_0000;

// Flags of `canReadStatus` (`canSTAT_…`).
const ERROR_PASSIVE: u64 = 0x1;
const BUS_OFF: u64 = 0x2;
const ERROR_WARNING: u64 = 0x4;

/// The library, loaded and initialised once and kept.
fn load_library() -> Result<&'static CanlibFunctions, OpenError> {
    static LIBRARY: OnceLock<CanlibFunctions> = OnceLock::new();
    if let Some(api) = LIBRARY.get() {
        return Ok(api);
    }
    let api = CanlibFunctions::load()?;
    Ok(LIBRARY.get_or_init(|| {
        api.initialize();
        api
    }))
}

/// Channels of the adapters that are plugged in, and virtual channels.
///
/// # Errors
/// The driver is missing or fails.
pub fn channels() -> Result<Vec<AdapterChannel>, OpenError> {
    let api = load_library()?;
    let channel = |number: i32| AdapterChannel {
        name: number.to_string(),
        device: api.device_text(number),
        state: match api.capabilities(number) {
            Some(capabilities) if capabilities & SILENT_MODE != 0 => ChannelState::Available,
            Some(_) => ChannelState::NotListenOnly,
            None => ChannelState::Unavailable,
        },
    };
    Ok((0..api.channel_count()?).map(channel).collect())
}

/// A channel in listen-only mode.
pub struct KvaserListener {
    api: &'static CanlibFunctions,
    handle: ChannelHandle,
    /// Length of a unit of the timestamps in µs.
    scale: u32,
    /// `canBusOn` has succeeded.
    is_on_bus: bool,
}

impl KvaserListener {
    /// Opens a channel by its number, such as `0`.
    ///
    /// # Errors
    /// Driver, channel, bit rate or listen-only mode are not available, or another program uses the channel.
    pub fn open(channel: &str, bit_rate: u32) -> Result<Self, OpenError> {
        let no_rate =
            || OpenError::BitRate { bit_rate, available: BIT_RATES.iter().map(|(rate, _)| *rate).collect() };
        let timing = BIT_RATES.iter().find(|(rate, _)| *rate == bit_rate).ok_or_else(no_rate)?.1;
        let api = load_library()?;
        let number = find_channel(api, channel)?;
        if api.capabilities(number).is_none_or(|capabilities| capabilities & SILENT_MODE == 0) {
            return Err(not_listen_only(channel));
        }
        let handle = api.open(number)?;
        // From here on, dropping the listener closes the channel.
        let mut listener = Self { api, handle, scale: 1, is_on_bus: false };
        api.set_timing(handle, timing)?;
        // The mode must be set while the channel is off the bus.
        if api.set_silent(handle).is_err() || !api.is_silent(handle) {
            return Err(not_listen_only(channel));
        }
        listener.scale = api.set_microseconds(handle);
        api.bus_on(handle)?;
        listener.is_on_bus = true;
        if !api.is_silent(handle) {
            return Err(not_listen_only(channel));
        }
        Ok(listener)
    }

    /// Appends a message.
    fn take_message(&self, received: &CanlibMessage, readings: &mut Vec<ReceivedItem>) {
        if message::is_overrun(received) {
            readings.push(ReceivedItem::Lost);
        }
        readings.extend(message::to_item(received, self.scale));
    }
}

fn not_listen_only(channel: &str) -> OpenError {
    OpenError::NotListenOnly { kind: AdapterKind::Kvaser, channel: channel.into() }
}

/// The number of an existing channel.
fn find_channel(api: &CanlibFunctions, channel: &str) -> Result<i32, OpenError> {
    let count = api.channel_count()?;
    let is_number = channel.bytes().all(|byte| byte.is_ascii_digit());
    let number = channel.parse().ok().filter(|number| is_number && (0..count).contains(number));
    number.ok_or_else(|| OpenError::NoChannel {
        kind: AdapterKind::Kvaser,
        channel: channel.into(),
        present: (0..count).map(|number| number.to_string()).collect(),
    })
}

/// The most severe state among the flags of a status.
fn worst_confinement(flags: u64) -> FaultConfinement {
    if flags & BUS_OFF != 0 {
        FaultConfinement::BusOff
    } else if flags & ERROR_PASSIVE != 0 {
        FaultConfinement::Passive
    } else if flags & ERROR_WARNING != 0 {
        FaultConfinement::Warning
    } else {
        FaultConfinement::Active
    }
}

impl ChannelListener for KvaserListener {
    fn read(&mut self, readings: &mut Vec<ReceivedItem>, wait: Duration) -> Result<(), Disconnected> {
        // Only the first message is waited for.
        let mut wait = wait;
        for _ in 0..MAX_READINGS {
            match self.api.read(self.handle, wait) {
                Ok(Some(received)) => self.take_message(&received, readings),
                Ok(None) => return Ok(()),
                Err(reason) => return Err(Disconnected(reason)),
            }
            wait = Duration::ZERO;
        }
        Ok(())
    }

    fn status(&mut self) -> Result<ControllerStatus, Disconnected> {
        let flags = self.api.status(self.handle).map_err(Disconnected)?;
        let counters = self.api.error_counters(self.handle).map(|(transmit, receive)| {
            let byte = |count: u32| u8::try_from(count).unwrap_or(u8::MAX);
            ErrorCounters { receive: byte(receive), transmit: byte(transmit) }
        });
        Ok(ControllerStatus { confinement: worst_confinement(flags), counters })
    }
}

impl Drop for KvaserListener {
    fn drop(&mut self) {
        if self.is_on_bus {
            self.api.bus_off(self.handle);
        }
        self.api.close(self.handle);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_most_severe_state_counts() {
        assert_eq!(worst_confinement(0x8), FaultConfinement::Active);
        assert_eq!(worst_confinement(0x28 | ERROR_WARNING), FaultConfinement::Warning);
        assert_eq!(worst_confinement(ERROR_WARNING | ERROR_PASSIVE), FaultConfinement::Passive);
        assert_eq!(worst_confinement(ERROR_PASSIVE | BUS_OFF), FaultConfinement::BusOff);
    }
}
