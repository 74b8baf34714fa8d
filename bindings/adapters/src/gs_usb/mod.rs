//! Adapters with the gs_usb protocol (candleLight, CANable 2, and others) over USB, without a driver of their own.
//!
//! The protocol joins the bus and sets listen-only mode in one request, so that the mode is in force before the channel is on
//! the bus. It cannot be read back.
//!
//! Only classic CAN is started. An adapter with several channels is opened for one of them at a time.

mod protocol;
mod timing;
mod usb;

use std::time::{Duration, Instant};

use crate::reading::MAX_READINGS;
use crate::{
    AdapterChannel, AdapterKind, ChannelListener, ChannelState, ControllerStatus, Disconnected,
    FaultConfinement, OpenError, ReceivedItem,
};
use protocol::{
    AdapterCommand, AdapterQuestion, ChannelConstants, channel_count, parse_counters, read_transfer,
};
use usb::UsbTransport;

/// Channels of an adapter; more are not looked for.
const MAX_CHANNELS: u16 = 16;

/// A plugged-in adapter.
#[derive(Debug, Clone, PartialEq, Eq)]
struct UsbAdapter {
    /// Serial number, or place on the USB.
    name: String,
    /// Name of the product.
    product: String,
}

/// Transfers of an adapter. None of them carries a frame to it.
trait AdapterTransport: Send {
    /// Answer to a question.
    fn ask_question(&mut self, question: AdapterQuestion) -> Result<Vec<u8>, Disconnected>;

    /// Carries out a command.
    fn send_command(&mut self, command: AdapterCommand) -> Result<(), Disconnected>;

    /// Lends the next transfer with frames; false if none arrives within `wait`.
    fn read_transfer(&mut self, wait: Duration, take: &mut dyn FnMut(&[u8])) -> Result<bool, Disconnected>;
}

/// Channels of the adapters that are plugged in. An adapter that cannot be opened is listed with its first channel.
///
/// # Errors
/// The operating system does not list devices.
pub fn channels() -> Result<Vec<AdapterChannel>, OpenError> {
    let devices = usb::list_devices()?;
    Ok(devices
        .iter()
        .flat_map(|(device, info)| match UsbTransport::open(info, &device.name, 0) {
            Ok(transport) => channels_of(device, transport),
            Err(OpenError::Claimed { .. }) => vec![describe_channel(device, 0, 1, ChannelState::InUse)],
            Err(_) => vec![describe_channel(device, 0, 1, ChannelState::Unavailable)],
        })
        .collect())
}

fn channels_of(device: &UsbAdapter, mut transport: impl AdapterTransport) -> Vec<AdapterChannel> {
    let constants = transport
        .ask_question(AdapterQuestion::Constants)
        .ok()
        .and_then(|answer| ChannelConstants::parse(&answer));
    let state = match constants {
        Some(constants) if constants.has_listen_only() => ChannelState::Available,
        Some(_) => ChannelState::NotListenOnly,
        None => ChannelState::Unavailable,
    };
    let count =
        transport.ask_question(AdapterQuestion::Device).ok().and_then(|answer| channel_count(&answer));
    let count = count.unwrap_or(1).min(MAX_CHANNELS);
    (0..count).map(|number| describe_channel(device, number, count, state)).collect()
}

fn describe_channel(device: &UsbAdapter, number: u16, count: u16, state: ChannelState) -> AdapterChannel {
    let UsbAdapter { name, product } = device;
    if count == 1 {
        return AdapterChannel { name: name.clone(), device: product.clone(), state };
    }
    AdapterChannel { name: format!("{name}/{number}"), device: format!("{product}, channel {number}"), state }
}

/// A channel in listen-only mode.
pub struct GsUsbListener {
    transport: Box<dyn AdapterTransport>,
    channel: u8,
    constants: ChannelConstants,
    /// State from error frames, counters from the adapter.
    status: ControllerStatus,
    /// Start of timestamps by the clock of this computer.
    begin: Instant,
}

impl GsUsbListener {
    /// Opens `channel`: the serial number of the adapter, with `/1` for a further channel; empty for the only adapter.
    ///
    /// # Errors
    /// Adapter, bit rate or listen-only mode are not available, or another program or driver uses the adapter.
    pub fn open(channel: &str, bit_rate: u32) -> Result<Self, OpenError> {
        let devices = usb::list_devices()?;
        let names: Vec<&str> = devices.iter().map(|(device, _)| device.name.as_str()).collect();
        let (at, number) = choose_adapter(&names, channel)?;
        let missing = || no_channel(channel, &names);
        let (device, info) = devices.get(at).ok_or_else(missing)?;
        let transport = UsbTransport::open(info, &device.name, number)?;
        Self::start_channel(Box::new(transport), channel, number, bit_rate)
    }

    fn start_channel(
        mut transport: Box<dyn AdapterTransport>,
        name: &str,
        channel: u8,
        bit_rate: u32,
    ) -> Result<Self, OpenError> {
        let failed = |Disconnected(reason)| OpenError::Driver { function: "gs_usb", reason };
        transport.send_command(AdapterCommand::ByteOrder).map_err(failed)?;
        let answer = transport.ask_question(AdapterQuestion::Device).map_err(failed)?;
        let count = channel_count(&answer).unwrap_or(1);
        if u16::from(channel) >= count {
            let device = name.rsplit_once('/').map_or(name, |(device, _)| device);
            let present: Vec<_> = (0..count).map(|number| format!("{device}/{number}")).collect();
            return Err(no_channel(name, &present));
        }
        let answer = transport.ask_question(AdapterQuestion::Constants).map_err(failed)?;
        let constants = ChannelConstants::parse(&answer).ok_or_else(|| OpenError::Driver {
            function: "gs_usb",
            reason: format!(
                "{} bytes of bit timing limits; expected {}",
                answer.len(),
                AdapterQuestion::Constants.length()
            ),
        })?;
        if !constants.has_listen_only() {
            return Err(OpenError::NotListenOnly { kind: AdapterKind::GsUsb, channel: name.into() });
        }
        let timing = timing::find_timing(&constants, bit_rate)
            .ok_or(OpenError::Clock { bit_rate, clock: constants.clock })?;
        // A program that crashed may have left the channel on the bus in another mode.
        transport.send_command(AdapterCommand::Reset).map_err(failed)?;
        transport.send_command(AdapterCommand::Timing(timing)).map_err(failed)?;
        let (has_stamps, has_bus_errors) = (constants.has_stamps(), constants.has_bus_errors());
        let status = ControllerStatus { confinement: FaultConfinement::Active, counters: None };
        // From here on, dropping the listener takes the channel off the bus.
        let mut listener = Self { transport, channel, constants, status, begin: Instant::now() };
        listener
            .transport
            .send_command(AdapterCommand::Listen { has_stamps, has_bus_errors })
            .map_err(failed)?;
        Ok(listener)
    }

    /// Reads one transfer; false if none arrived within `wait`.
    fn take_transfer(
        &mut self,
        readings: &mut Vec<ReceivedItem>,
        wait: Duration,
    ) -> Result<bool, Disconnected> {
        let (before, begin) = (readings.len(), self.begin);
        let (channel, has_stamps) = (self.channel, self.constants.has_stamps());
        let is_taken = self.transport.read_transfer(wait, &mut |bytes| {
            let arrival = to_microseconds(begin.elapsed());
            read_transfer(bytes, channel, has_stamps, arrival, readings);
        })?;
        for reading in readings.get(before..).unwrap_or_default() {
            if let ReceivedItem::ErrorFrame(frame) = reading {
                self.status.confinement = frame.confinement.unwrap_or(self.status.confinement);
            }
        }
        Ok(is_taken)
    }
}

/// The lower 32 bits: timestamps restart at 0, as those of the adapters do.
fn to_microseconds(time: Duration) -> u32 {
    u32::try_from(time.as_micros() & u128::from(u32::MAX)).unwrap_or(u32::MAX)
}

/// Index of the adapter, and number of its channel.
fn choose_adapter(names: &[&str], channel: &str) -> Result<(usize, u8), OpenError> {
    let missing = || no_channel(channel, names);
    let (name, number) = match channel.rsplit_once('/') {
        Some((name, number)) if number.bytes().all(|byte| byte.is_ascii_digit()) => {
            (name, number.parse().map_err(|_| missing())?)
        }
        Some(_) => return Err(missing()),
        None => (channel, 0),
    };
    if !name.is_empty() {
        return names.iter().position(|present| *present == name).map(|at| (at, number)).ok_or_else(missing);
    }
    if names.len() == 1 { Ok((0, number)) } else { Err(missing()) }
}

fn no_channel(channel: &str, present: &[impl ToString]) -> OpenError {
    OpenError::NoChannel {
        kind: AdapterKind::GsUsb,
        channel: channel.into(),
        present: present.iter().map(ToString::to_string).collect(),
    }
}

impl ChannelListener for GsUsbListener {
    fn read(&mut self, readings: &mut Vec<ReceivedItem>, wait: Duration) -> Result<(), Disconnected> {
        let (begin, before) = (Instant::now(), readings.len());
        loop {
            let left = wait.saturating_sub(begin.elapsed());
            let wait = if readings.len() > before { Duration::ZERO } else { left };
            let is_taken = self.take_transfer(readings, wait)?;
            let is_full = readings.len().saturating_sub(before) >= MAX_READINGS;
            if is_full || (!is_taken && (readings.len() > before || left.is_zero())) {
                return Ok(());
            }
        }
    }

    fn status(&mut self) -> Result<ControllerStatus, Disconnected> {
        // An adapter that does not answer is unplugged: `read` reports it after the frames that have arrived. The state itself
        // comes with error frames, in order with the frames; asked for, it would be reported a second time.
        let answer = if self.constants.has_state() {
            self.transport.ask_question(AdapterQuestion::State).ok()
        } else {
            None
        };
        self.status.counters = answer.and_then(|answer| parse_counters(&answer)).or(self.status.counters);
        Ok(self.status)
    }

    fn has_stamps(&self) -> bool {
        self.constants.has_stamps()
    }
}

impl Drop for GsUsbListener {
    fn drop(&mut self) {
        // Without an answer the adapter is unplugged.
        let _ = self.transport.send_command(AdapterCommand::Reset);
    }
}

#[cfg(test)]
mod tests;
