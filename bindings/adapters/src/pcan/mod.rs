//! PEAK adapters through PCAN-Basic (`PCANBasic.dll`, `libpcanbasic.so`).
//!
//! Signatures, constants and structures: `PCANBasic.h` of PCAN-Basic 4 and 5 (PEAK-System), compared with python-can,
//! `can/interfaces/pcan/basic.py`. Contents of error frames: PCAN-Basic documentation, "Error Frames".
//! `PCAN_LISTEN_ONLY` may be set before a channel is initialised: "PCAN-Parameters", group "Pre-Initialized Parameters".
//!
//! Classic CAN only. `CAN_InitializeFD` needs a clock and segments for both phases, which the bit rate alone does not state.

mod api;
mod message;
mod names;

use std::sync::OnceLock;
use std::thread;
use std::time::{Duration, Instant};

use crate::reading::MAX_READINGS;
use crate::{
    AdapterChannel, AdapterKind, ChannelListener, ChannelState, ControllerStatus, Disconnected,
    ErrorCounters, FaultConfinement, OpenError, ReceivedItem,
};
use api::{Handle, PcanFunctions, PcanParameter, PcanSwitch};

/// Bit rates with the values of the timing registers BTR0 and BTR1 (`PCAN_BAUD_…`). The names of the header are rounded;
/// these are the rates that the registers give with the 8 MHz of an SJA1000.
const BIT_RATES: &[(u32, u16)] = &[
    (5_000, 0x7F7F),
    (10_000, 0x672F),
    (20_000, 0x532F),
    (33_333, 0x8B2F),
    (47_619, 0x1414),
    (50_000, 0x472F),
    (83_333, 0x852B),
    (95_238, 0xC34E),
    (100_000, 0x432F),
    (125_000, 0x031C),
    (250_000, 0x011C),
    (500_000, 0x001C),
    (800_000, 0x0016),
    (1_000_000, 0x0014),
];

/// Pause between two looks into an empty queue. The queue of the driver has 32,768 places, and the timestamps are made by the
/// adapter, so that the pause costs only delay.
const POLL: Duration = Duration::from_millis(4);

// Status bits (`PCAN_ERROR_…`).
const OVERRUN: u32 = 0x2;
const BUS_LIGHT: u32 = 0x4;
const BUS_HEAVY: u32 = 0x8;
const BUS_OFF: u32 = 0x10;
const QUEUE_EMPTY: u32 = 0x20;
const QUEUE_OVERRUN: u32 = 0x40;
const BUS_PASSIVE: u32 = 0x4_0000;

/// Status bits of a channel that still works.
const WORKING: u32 = OVERRUN | BUS_LIGHT | BUS_HEAVY | BUS_OFF | QUEUE_EMPTY | QUEUE_OVERRUN | BUS_PASSIVE;

/// Conditions of a channel (`PCAN_CHANNEL_…`), as bits.
const CONDITION_AVAILABLE: u32 = 1;
const CONDITION_OCCUPIED: u32 = 2;

/// The library, loaded once and kept: the library of a vendor may have threads that do not survive unloading.
fn load_library() -> Result<&'static PcanFunctions, OpenError> {
    static LIBRARY: OnceLock<PcanFunctions> = OnceLock::new();
    if let Some(api) = LIBRARY.get() {
        return Ok(api);
    }
    let api = PcanFunctions::load()?;
    Ok(LIBRARY.get_or_init(|| api))
}

/// Channels of the adapters that are plugged in.
///
/// # Errors
/// The driver is missing or fails.
pub fn channels() -> Result<Vec<AdapterChannel>, OpenError> {
    let attached = load_library()?.attached_channels()?;
    Ok(attached
        .iter()
        .map(|found| AdapterChannel {
            name: names::handle_name(found.handle),
            device: names::device_text(found),
            state: channel_state(found.condition),
        })
        .collect())
}

fn channel_state(condition: u32) -> ChannelState {
    match (condition & CONDITION_AVAILABLE != 0, condition & CONDITION_OCCUPIED != 0) {
        (true, false) => ChannelState::Available,
        (_, true) => ChannelState::InUse,
        (false, false) => ChannelState::Unavailable,
    }
}

/// A channel in listen-only mode.
pub struct PcanListener {
    api: &'static PcanFunctions,
    handle: Handle,
    counters: Option<ErrorCounters>,
    /// The last status had an overrun bit, which the driver may repeat.
    was_overrun: bool,
}

impl PcanListener {
    /// Opens `channel`, such as `USB1`.
    ///
    /// # Errors
    /// Driver, channel, bit rate or listen-only mode are not available, or another program uses the channel.
    pub fn open(channel: &str, bit_rate: u32) -> Result<Self, OpenError> {
        let no_rate =
            || OpenError::BitRate { bit_rate, available: BIT_RATES.iter().map(|(rate, _)| *rate).collect() };
        let registers = BIT_RATES.iter().find(|(rate, _)| *rate == bit_rate).ok_or_else(no_rate)?.1;
        let api = load_library()?;
        let handle = find_channel(api, channel)?;
        // The mode must be set while the channel is off the bus: CAN_Initialize joins the bus.
        let is_set = api.switch_on(handle, PcanSwitch::ListenOnly).is_ok()
            && api.is_on(handle, PcanSwitch::ListenOnly);
        if !is_set {
            return Err(not_listen_only(channel));
        }
        api.initialize(handle, registers)?;
        // From here on, dropping the listener closes the channel.
        let listener = Self { api, handle, counters: None, was_overrun: false };
        if !api.is_on(handle, PcanSwitch::ListenOnly) {
            return Err(not_listen_only(channel));
        }
        // Older adapters have no error frames; bus errors are then visible in the status only.
        let _ = api.switch_on(handle, PcanSwitch::ErrorFrames);
        Ok(listener)
    }

    /// Reads the queue until it is empty.
    fn drain_queue(&mut self, readings: &mut Vec<ReceivedItem>) -> Result<(), Disconnected> {
        for _ in 0..MAX_READINGS {
            let (status, message, time) = self.api.read(self.handle);
            if status & !WORKING != 0 {
                return Err(Disconnected(self.api.status_text(status)));
            }
            self.on_overrun(status & (OVERRUN | QUEUE_OVERRUN) != 0, readings);
            if status & QUEUE_EMPTY != 0 {
                return Ok(());
            }
            let Some(message) = message else { return Ok(()) };
            match message.message_content(time) {
                message::PcanContent::Reading(reading) => {
                    if let ReceivedItem::Error(error) = &reading {
                        self.counters = error.counters.or(self.counters);
                    }
                    readings.push(reading);
                }
                message::PcanContent::Status(status) => {
                    if status & (OVERRUN | QUEUE_OVERRUN) != 0 {
                        readings.push(ReceivedItem::Lost);
                    }
                }
                message::PcanContent::None => {}
            }
        }
        Ok(())
    }

    fn on_overrun(&mut self, is_overrun: bool, readings: &mut Vec<ReceivedItem>) {
        if is_overrun && !self.was_overrun {
            readings.push(ReceivedItem::Lost);
        }
        self.was_overrun = is_overrun;
    }
}

fn not_listen_only(channel: &str) -> OpenError {
    OpenError::NotListenOnly { kind: AdapterKind::Pcan, channel: channel.into() }
}

/// The handle of an available channel.
fn find_channel(api: &PcanFunctions, channel: &str) -> Result<Handle, OpenError> {
    let present = || {
        let attached = api.attached_channels().unwrap_or_default();
        attached.iter().map(|found| names::handle_name(found.handle)).collect()
    };
    let missing =
        || OpenError::NoChannel { kind: AdapterKind::Pcan, channel: channel.into(), present: present() };
    let handle = names::parse_handle(channel).ok_or_else(missing)?;
    match channel_state(api.read_parameter(handle, PcanParameter::Condition)?) {
        ChannelState::Available => Ok(handle),
        ChannelState::InUse => Err(OpenError::InUse { channel: channel.into() }),
        _ => Err(missing()),
    }
}

/// The most severe state among the bits of a status.
fn worst_confinement(status: u32) -> FaultConfinement {
    if status & BUS_OFF != 0 {
        FaultConfinement::BusOff
    } else if status & BUS_PASSIVE != 0 {
        FaultConfinement::Passive
    } else if status & (BUS_LIGHT | BUS_HEAVY) != 0 {
        FaultConfinement::Warning
    } else {
        FaultConfinement::Active
    }
}

impl ChannelListener for PcanListener {
    fn read(&mut self, readings: &mut Vec<ReceivedItem>, wait: Duration) -> Result<(), Disconnected> {
        let (begin, before) = (Instant::now(), readings.len());
        loop {
            self.drain_queue(readings)?;
            let left = wait.saturating_sub(begin.elapsed());
            if readings.len() > before || left.is_zero() {
                return Ok(());
            }
            thread::sleep(left.min(POLL));
        }
    }

    fn status(&mut self) -> Result<ControllerStatus, Disconnected> {
        let status = self.api.status(self.handle);
        if status & !WORKING != 0 {
            return Err(Disconnected(self.api.status_text(status)));
        }
        Ok(ControllerStatus { confinement: worst_confinement(status), counters: self.counters })
    }
}

impl Drop for PcanListener {
    fn drop(&mut self) {
        self.api.uninitialize(self.handle);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_most_severe_state_counts() {
        assert_eq!(worst_confinement(0), FaultConfinement::Active);
        assert_eq!(worst_confinement(QUEUE_EMPTY | BUS_LIGHT), FaultConfinement::Warning);
        assert_eq!(worst_confinement(BUS_HEAVY), FaultConfinement::Warning);
        assert_eq!(worst_confinement(BUS_HEAVY | BUS_PASSIVE), FaultConfinement::Passive);
        assert_eq!(worst_confinement(BUS_HEAVY | BUS_PASSIVE | BUS_OFF), FaultConfinement::BusOff);
    }

    /// BTR0 bits 0 to 5 are the prescaler minus 1, BTR1 bits 0 to 3 and 4 to 6 both segments minus 1 (SJA1000 data sheet 6.5),
    /// from a clock of 8 MHz in time quanta of two periods of 16 MHz.
    #[test]
    fn registers_give_their_bit_rates() {
        for (bit_rate, registers) in BIT_RATES {
            let [btr0, btr1] = registers.to_be_bytes();
            let prescaler = u32::from(btr0 & 0x3F) + 1;
            let quanta = 1 + u32::from(btr1 & 0x0F) + 1 + u32::from(btr1 >> 4 & 7) + 1;
            assert_eq!(8_000_000 / (prescaler * quanta), *bit_rate, "{registers:04X}");
        }
    }

    #[test]
    fn conditions_are_bits() {
        use ChannelState::{Available, InUse, Unavailable};
        assert_eq!([0, 1, 2, 3].map(channel_state), [Unavailable, Available, InUse, InUse]);
    }
}
