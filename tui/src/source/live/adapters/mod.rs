//! Adapters of PEAK and Kvaser with the drivers of their vendors, and gs_usb adapters, in listen-only mode.
//!
//! `cobscope_adapters` sets and checks the mode, and binds no function that transmits.

#[cfg(test)]
mod tests;

use std::time::{Duration, Instant};

use anyhow::anyhow;
use cobscope_adapters::{
    AdapterErrorFrame, AdapterKind, BusError, ChannelListener, ChannelState, ControllerStatus, ErrorCounters,
    FaultConfinement, OpenError, ReceivedFrame, ReceivedItem, ViolationKind,
};
use cobscope_decoder::capture::adapter::driver::{self, BusErrorReport, frame_of_state};
use cobscope_decoder::capture::{CapturePlace, Notice};
use cobscope_decoder::frame::{BusIndex, CanId, Frame, FrameFlags, Timestamp};

use super::backoff::ConnectError;
use super::returning::{ReconnectingSource, SourceConnection, unreadable_notice};
use super::stamps::StampClock;
use super::{AdapterSpec, Arrival, ControllerMode, LiveSource, SourceClock, clock};

/// Maximum delay of a frame: the buffers of the USB line and the pauses between reads.
const LAG: Duration = Duration::from_millis(50);

/// Interval between two requests for the state of the controller.
const STATUS_EVERY: Duration = Duration::from_millis(250);

/// Time after which the timestamps of the drivers restart at 0: 2³² µs.
const WRAP: i64 = 0x1_0000_0000 * 1_000;

/// Opens an adapter.
///
/// # Errors
/// Driver, channel, bit rate or listen-only mode are not available, or another program uses the channel.
pub fn open(spec: &AdapterSpec) -> anyhow::Result<Box<dyn LiveSource>> {
    let AdapterSpec { prefix, channel, bit_rate } = spec.clone();
    let kind = AdapterKind::ALL.into_iter().find(|kind| kind.prefix() == prefix);
    let kind = kind.ok_or_else(|| anyhow!("{prefix}: no such adapters"))?;
    let name = if channel.is_empty() { prefix.to_owned() } else { format!("{prefix}-{channel}") };
    let connect = move || {
        let listener = kind.listen(&channel, bit_rate).map_err(|error| refused(kind, &channel, &error))?;
        Ok(Adapter::new(listener, bit_rate))
    };
    Ok(Box::new(ReconnectingSource::open(&name, LAG, Vec::new(), connect)?))
}

fn refused(kind: AdapterKind, channel: &str, error: &OpenError) -> ConnectError {
    let colon = if channel.is_empty() { "" } else { ":" };
    let message = anyhow!("{}{colon}{channel}: {error}", kind.prefix());
    if error.is_temporary() { ConnectError::Again(message) } else { ConnectError::Never(message) }
}

/// One line per channel of the adapters that are plugged in, `pcan:USB1@BITRATE: PCAN-USB FD, channel 1, available`.
/// Vendors without an installed driver have none.
pub fn all() -> Vec<String> {
    AdapterKind::ALL.into_iter().flat_map(channels).collect()
}

fn channels(kind: AdapterKind) -> Vec<String> {
    let prefix = kind.prefix();
    match kind.channels() {
        Ok(channels) => {
            let line = |channel: cobscope_adapters::AdapterChannel| {
                format!("{prefix}:{}@BITRATE: {}, {}", channel.name, channel.device, state(channel.state))
            };
            channels.into_iter().map(line).collect()
        }
        Err(OpenError::NoDriver { .. }) => Vec::new(),
        Err(error) => vec![format!("{prefix}: {error}")],
    }
}

const fn state(state: ChannelState) -> &'static str {
    match state {
        ChannelState::Available => "available",
        ChannelState::InUse => "in use by another program or driver",
        ChannelState::NotListenOnly => "no listen-only mode",
        ChannelState::Unavailable => "not available",
    }
}

/// An open adapter.
struct Adapter {
    listener: Box<dyn ChannelListener>,
    bit_rate: u32,
    clock: StampClock,
    status: Option<ControllerStatus>,
    next_status: Instant,
    lost: u64,
    /// Kept from call to call for its memory.
    readings: Vec<ReceivedItem>,
}

impl Adapter {
    fn new(listener: Box<dyn ChannelListener>, bit_rate: u32) -> Self {
        Self {
            listener,
            bit_rate,
            clock: StampClock::default(),
            status: None,
            next_status: Instant::now(),
            lost: 0,
            readings: Vec::new(),
        }
    }

    /// Reads the state of the controller when it is time; a change of it is an error frame.
    fn watch(&mut self, items: &mut Vec<Arrival>) -> Result<(), String> {
        let now = Instant::now();
        if now < self.next_status {
            return Ok(());
        }
        self.next_status = now + STATUS_EVERY;
        let status = self.listener.status().map_err(|error| error.0)?;
        let last = self.status.map_or(FaultConfinement::Active, |status| status.confinement);
        if status.confinement != last {
            let frame = frame_of_state(confinement(status.confinement), status.counters.map(counters));
            items.push(Arrival::Frame(Frame { time: Some(clock::now()), ..frame }));
        }
        self.status = Some(status);
        Ok(())
    }

    fn take(&mut self, reading: &ReceivedItem, arrival: Timestamp) -> Option<Arrival> {
        match reading {
            ReceivedItem::Frame(received) => {
                let time = self.time(received.stamp, arrival);
                Some(Arrival::Frame(Frame { time: Some(time), ..frame(received) }))
            }
            ReceivedItem::Error(error) => {
                let time = self.time(error.stamp, arrival);
                report(error).to_frame().map(|frame| Arrival::Frame(Frame { time: Some(time), ..frame }))
            }
            ReceivedItem::ErrorFrame(error) => {
                let time = self.time(error.stamp, arrival);
                if let Some(confinement) = error.confinement {
                    // The adapter reports it itself: `watch` must not report it again.
                    let counters = self.status.and_then(|status| status.counters);
                    self.status = Some(ControllerStatus { confinement, counters });
                }
                Some(Arrival::Frame(Frame { time: Some(time), ..error_frame(error) }))
            }
            ReceivedItem::Lost => {
                self.lost = self.lost.saturating_add(1);
                let (place, bus) = (CapturePlace::Now, BusIndex(0));
                Some(Arrival::Notice(Notice::LostFrames { place, bus, count: None }))
            }
            ReceivedItem::Invalid(reason) => Some(unreadable_notice(reason.clone())),
        }
    }

    fn time(&mut self, microseconds: u32, arrival: Timestamp) -> Timestamp {
        self.clock.time_of(i64::from(microseconds).saturating_mul(1_000), WRAP, arrival)
    }
}

fn frame(received: &ReceivedFrame) -> Frame {
    let id = if received.is_extended {
        CanId::from_extended(received.id)
    } else {
        CanId::from_standard(u16::try_from(received.id).unwrap_or(u16::MAX))
    };
    if received.is_remote {
        return Frame { id, flags: FrameFlags::REMOTE, length: received.length, ..Frame::EMPTY };
    }
    Frame::data_frame(id, received.data.get(..usize::from(received.length)).unwrap_or(&received.data))
}

fn error_frame(error: &AdapterErrorFrame) -> Frame {
    let frame = Frame::data_frame(CanId::from_extended(error.class), &error.data);
    Frame { flags: FrameFlags::ERROR, ..frame }
}

fn report(error: &BusError) -> BusErrorReport {
    let violation = error.violation.map(|violation| match violation {
        ViolationKind::Bit => driver::Violation::Bit,
        ViolationKind::Form => driver::Violation::Form,
        ViolationKind::Stuff => driver::Violation::Stuff,
        ViolationKind::Checksum => driver::Violation::Checksum,
        ViolationKind::Other => driver::Violation::Other,
    });
    BusErrorReport {
        violation,
        is_transmitting: error.is_transmitting,
        place: error.place,
        counters: error.counters.map(counters),
    }
}

const fn counters(ErrorCounters { receive, transmit }: ErrorCounters) -> driver::Counters {
    driver::Counters { receive, transmit }
}

const fn confinement(state: FaultConfinement) -> driver::SlcanConfinement {
    match state {
        FaultConfinement::Active => driver::SlcanConfinement::Active,
        FaultConfinement::Warning => driver::SlcanConfinement::Warning,
        FaultConfinement::Passive => driver::SlcanConfinement::Passive,
        FaultConfinement::BusOff => driver::SlcanConfinement::BusOff,
    }
}

impl SourceConnection for Adapter {
    fn read(&mut self, items: &mut Vec<Arrival>, wait: Duration) -> Result<(), String> {
        let wait = wait.min(self.next_status.saturating_duration_since(Instant::now()));
        let mut readings = std::mem::take(&mut self.readings);
        let result = self.listener.read(&mut readings, wait);
        let arrival = clock::now();
        items.extend(readings.drain(..).filter_map(|reading| self.take(&reading, arrival)));
        self.readings = readings;
        result.map_err(|error| error.0)?;
        // A new state has the present time, which is later than the frames that were waiting.
        self.watch(items)
    }

    fn now(&self) -> Timestamp {
        clock::now()
    }

    fn bit_rate(&self) -> Option<u32> {
        Some(self.bit_rate)
    }

    fn timestamp_clock(&self) -> SourceClock {
        if self.listener.has_stamps() { SourceClock::Adapter } else { SourceClock::Arrival }
    }

    fn controller_state(&self) -> Option<String> {
        let status = self.status?;
        let name = confinement(status.confinement).name();
        Some(match status.counters {
            Some(ErrorCounters { receive, transmit }) => {
                format!("{name}, rx {receive} tx {transmit}")
            }
            None => name.to_owned(),
        })
    }

    fn controller_mode(&self) -> ControllerMode {
        // `cobscope_adapters` refuses a channel without it.
        ControllerMode::ListenOnly
    }

    fn lost_frames(&self) -> u64 {
        self.lost
    }
}
