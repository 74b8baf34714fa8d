//! Serial adapters with the slcan protocol (Lawicel), opened in listen-only mode.
//!
//! An adapter without listen-only mode is refused: in any other mode its controller acknowledges frames and
//! thus takes part in the bus. A CAN232 sends frames unasked only if `X1` is stored in it.

mod milliseconds;
mod port;
#[cfg(test)]
#[cfg(target_os = "linux")]
mod tests;

use std::time::{Duration, Instant};

use anyhow::anyhow;
use cobscope_decoder::capture::adapter::slcan::{SlcanBitRate, SlcanCommand, SlcanReply};
use cobscope_decoder::capture::{CapturePlace, Notice};
use cobscope_decoder::frame::{BusIndex, Frame, FrameFlags, Timestamp};

use super::backoff::ConnectError;
use super::returning::{ReconnectingSource, SourceConnection, unreadable_notice};
use super::{Arrival, ControllerMode, LiveSource, SourceClock, clock};
use milliseconds::MillisecondClock;
use port::{BAUD_RATE, CommandResult, OpenPort};

/// Maximum delay of a frame: the buffers of the serial line.
const LAG: Duration = Duration::from_millis(50);

/// Time limit for a response.
const ANSWER: Duration = Duration::from_millis(500);

/// Number of close commands before an adapter counts as unresponsive: some boards restart when they are
/// opened.
const ATTEMPTS: usize = 6;

/// Silence after the close command that proves that no other response is under way.
const SETTLED: Duration = Duration::from_millis(50);

/// Interval between two requests for the status flags.
const FLAGS_EVERY: Duration = Duration::from_secs(1);

/// Number of unanswered requests for flags. After that an adapter that never responded is not asked any more,
/// and an adapter that responded before is disconnected.
const UNANSWERED: u32 = 5;

/// Opens the adapter at the serial port `device`; without a bit rate, in bit/s, the adapter keeps its own.
///
/// # Errors
/// Bit rate not available in slcan; port missing or in use; adapter unresponsive or without listen-only mode.
pub fn open(device: &str, bit_rate: Option<u32>) -> anyhow::Result<Box<dyn LiveSource>> {
    let rate =
        bit_rate.map(|rate| SlcanBitRate::for_rate(rate).ok_or_else(|| unknown_rate(rate))).transpose()?;
    let name = device.rsplit(['/', '\\']).next().unwrap_or(device).to_owned();
    let mut remarks = Vec::new();
    if bit_rate.is_none() {
        remarks.push(Notice::Assumption(format!(
            "{name}: bit rate of the adapter unchanged; slcan:{device}@500000 sets one"
        )));
    }
    let device = device.to_owned();
    let connect = move || {
        let port = ready_port(&device, bit_rate.zip(rate))?;
        Ok(SlcanAdapter::new(port, bit_rate))
    };
    Ok(Box::new(ReconnectingSource::open(&name, LAG, remarks, connect)?))
}

fn unknown_rate(rate: u32) -> anyhow::Error {
    let known: Vec<_> = SlcanBitRate::supported_rates().map(|rate| rate.to_string()).collect();
    anyhow!("slcan has no command for {rate} bit/s; it has {}", known.join(", "))
}

/// A port whose adapter is in listen-only mode, and whether the adapter sends timestamps.
fn ready_port(device: &str, rate: Option<(u32, SlcanBitRate)>) -> Result<(OpenPort, bool), ConnectError> {
    let gone = |error: std::io::Error| ConnectError::Again(not_there(device, &error));
    let mut port = OpenPort::open(device).map_err(gone)?;
    if !close_channel(&mut port).map_err(gone)? {
        return Err(ConnectError::Again(anyhow!(
            "{device}: no response to slcan command C; expected an adapter with the Lawicel protocol at \
             {BAUD_RATE} baud that no other program (slcand) uses"
        )));
    }
    if let Some((bits_per_second, rate)) = rate
        && port.ask_command(SlcanCommand::SetBitRate(rate), ANSWER).map_err(gone)? != CommandResult::Done
    {
        return Err(ConnectError::Never(anyhow!("{device}: the adapter refuses {bits_per_second} bit/s")));
    }
    let has_stamps =
        port.ask_command(SlcanCommand::TimestampsOn, ANSWER).map_err(gone)? == CommandResult::Done;
    if port.ask_command(SlcanCommand::Listen, ANSWER).map_err(gone)? != CommandResult::Done {
        let hint = match rate {
            Some(_) => "use firmware that supports this command",
            None => "its bit rate may not be set: add @500000; or use firmware that supports this command",
        };
        return Err(ConnectError::Never(anyhow!(
            "{device}: the adapter refuses listen-only mode (command L); other modes are not used because they \
             acknowledge frames; {hint}"
        )));
    }
    Ok((port, has_stamps))
}

/// Closes the channel for the configuration; returns whether the adapter responded.
fn close_channel(port: &mut OpenPort) -> std::io::Result<bool> {
    for _ in 0..ATTEMPTS {
        // An adapter whose channel is already closed may refuse; that is a response too.
        if port.ask_command(SlcanCommand::Close, ANSWER)? != CommandResult::Nothing {
            port.settle_input(SETTLED)?;
            return Ok(true);
        }
    }
    Ok(false)
}

/// Error for a port that cannot be opened, with a remedy.
fn not_there(device: &str, error: &std::io::Error) -> anyhow::Error {
    let hint = match error.kind() {
        std::io::ErrorKind::NotFound => match serial2::SerialPort::available_ports() {
            Ok(ports) if !ports.is_empty() => {
                let ports: Vec<_> = ports.iter().map(|port| port.display().to_string()).collect();
                format!("; serial ports here: {}", ports.join(", "))
            }
            _ => "; there are no serial ports here: is the adapter plugged in?".into(),
        },
        std::io::ErrorKind::PermissionDenied => {
            "; serial ports belong to the group dialout: sudo usermod -aG dialout $USER, then log in again"
                .into()
        }
        _ => String::new(),
    };
    anyhow!("{device}: the serial port cannot be used: {error}{hint}")
}

/// An adapter in listen-only mode.
struct SlcanAdapter {
    port: OpenPort,
    bit_rate: Option<u32>,
    has_stamps: bool,
    clock: MillisecondClock,
    controller: Option<String>,
    lost: u64,
    questions: StatusRequests,
}

/// State of the requests for status flags.
struct StatusRequests {
    next: Instant,
    unanswered: u32,
    /// Whether it has ever responded; `None` once it is known that it does not.
    answers: Option<bool>,
}

impl SlcanAdapter {
    fn new((port, has_stamps): (OpenPort, bool), bit_rate: Option<u32>) -> Self {
        let questions =
            StatusRequests { next: Instant::now() + FLAGS_EVERY, unanswered: 0, answers: Some(false) };
        let clock = MillisecondClock::default();
        Self { port, bit_rate, has_stamps, clock, controller: None, lost: 0, questions }
    }

    /// Requests the status flags when it is time.
    fn ask_status(&mut self) -> Result<(), String> {
        let questions = &mut self.questions;
        let Some(has_answered) = questions.answers.filter(|_| questions.next <= Instant::now()) else {
            return Ok(());
        };
        if questions.unanswered >= UNANSWERED {
            if has_answered {
                return Err("the adapter no longer responds".into());
            }
            questions.answers = None;
            return Ok(());
        }
        questions.unanswered += 1;
        questions.next = Instant::now() + FLAGS_EVERY;
        self.port.send_command(SlcanCommand::ReadFlags).map_err(|error| error.to_string())
    }

    /// Time to wait before the next request, at most `wait`.
    fn until_next(&self, wait: Duration) -> Duration {
        match self.questions.answers {
            Some(_) => wait.min(self.questions.next.saturating_duration_since(Instant::now())),
            None => wait,
        }
    }

    /// Converts a reply to an item, if it is one.
    fn take_reply(&mut self, reply: SlcanReply, arrival: Timestamp) -> Option<Arrival> {
        match reply {
            SlcanReply::Frame(frame, milliseconds) => {
                Some(Arrival::Frame(self.stamp_frame(frame, milliseconds, arrival)))
            }
            SlcanReply::State(state) => {
                self.controller = Some(state.to_string());
                None
            }
            SlcanReply::Flags(flags) => {
                (self.questions.unanswered, self.questions.answers) = (0, Some(true));
                let stated = flags.to_string();
                self.controller = (!stated.is_empty()).then_some(stated);
                flags.lost_frames().then(|| {
                    self.lost += 1;
                    Arrival::Notice(Notice::LostFrames {
                        place: CapturePlace::Now,
                        bus: BusIndex(0),
                        count: None,
                    })
                })
            }
            // The adapter does not support the command; no other command was sent.
            SlcanReply::Refused if self.questions.unanswered > 0 => {
                (self.questions.unanswered, self.questions.answers) = (0, None);
                None
            }
            SlcanReply::Refused => {
                Some(unreadable_notice("slcan: the adapter reports an error (BEL)".into()))
            }
            SlcanReply::Unreadable(reason) => Some(unreadable_notice(reason)),
            SlcanReply::Done => None,
        }
    }

    fn stamp_frame(&mut self, frame: Frame, milliseconds: Option<u16>, arrival: Timestamp) -> Frame {
        // Error frames are built from lines without a timestamp, even if frames have one.
        if !frame.flags.contains(FrameFlags::ERROR) {
            self.has_stamps = milliseconds.is_some();
        }
        let time = milliseconds.map_or(arrival, |stamp| self.clock.time_of(stamp, arrival));
        Frame { time: Some(time), ..frame }
    }
}

impl SourceConnection for SlcanAdapter {
    fn read(&mut self, items: &mut Vec<Arrival>, wait: Duration) -> Result<(), String> {
        self.ask_status()?;
        let wait = self.until_next(wait);
        let mut replies = Vec::new();
        self.port.read_replies(wait, |reply| replies.push(reply)).map_err(|error| error.to_string())?;
        let arrival = clock::now();
        items.extend(replies.into_iter().filter_map(|reply| self.take_reply(reply, arrival)));
        Ok(())
    }

    fn now(&self) -> Timestamp {
        clock::now()
    }

    fn bit_rate(&self) -> Option<u32> {
        self.bit_rate
    }

    fn timestamp_clock(&self) -> SourceClock {
        if self.has_stamps { SourceClock::Adapter } else { SourceClock::Arrival }
    }

    fn controller_state(&self) -> Option<String> {
        self.controller.clone()
    }

    fn controller_mode(&self) -> ControllerMode {
        // `ready` refuses an adapter without it.
        ControllerMode::ListenOnly
    }

    fn lost_frames(&self) -> u64 {
        self.lost
    }
}
