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
use cobscope_decoder::capture::adapter::slcan::{BitRate, Command, Reply};
use cobscope_decoder::capture::{CapturePlace, Notice};
use cobscope_decoder::frame::{BusIndex, Frame, FrameFlags, Timestamp};

use super::backoff::ConnectError;
use super::returning::{Connection, ReconnectingSource, unreadable};
use super::{Arrival, ControllerMode, Source, Stamps, clock};
use milliseconds::MillisecondClock;
use port::{Answer, BAUD_RATE, Port};

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
pub fn open(device: &str, bit_rate: Option<u32>) -> anyhow::Result<Box<dyn Source>> {
    let rate = bit_rate.map(|rate| BitRate::of(rate).ok_or_else(|| unknown_rate(rate))).transpose()?;
    let name = device.rsplit(['/', '\\']).next().unwrap_or(device).to_owned();
    let mut remarks = Vec::new();
    if bit_rate.is_none() {
        remarks.push(Notice::Assumption(format!(
            "{name}: bit rate of the adapter unchanged; slcan:{device}@500000 sets one"
        )));
    }
    let device = device.to_owned();
    let connect = move || {
        let port = ready(&device, bit_rate.zip(rate))?;
        Ok(Adapter::new(port, bit_rate))
    };
    Ok(Box::new(ReconnectingSource::open(&name, LAG, remarks, connect)?))
}

fn unknown_rate(rate: u32) -> anyhow::Error {
    let known: Vec<_> = BitRate::all().map(|rate| rate.to_string()).collect();
    anyhow!("slcan has no command for {rate} bit/s; it has {}", known.join(", "))
}

/// A port whose adapter is in listen-only mode, and whether the adapter sends timestamps.
fn ready(device: &str, rate: Option<(u32, BitRate)>) -> Result<(Port, bool), ConnectError> {
    let gone = |error: std::io::Error| ConnectError::Again(not_there(device, &error));
    let mut port = Port::open(device).map_err(gone)?;
    if !close(&mut port).map_err(gone)? {
        return Err(ConnectError::Again(anyhow!(
            "{device}: no response to slcan command C; expected an adapter with the Lawicel protocol at \
             {BAUD_RATE} baud that no other program (slcand) uses"
        )));
    }
    if let Some((bits_per_second, rate)) = rate
        && port.ask(Command::SetBitRate(rate), ANSWER).map_err(gone)? != Answer::Done
    {
        return Err(ConnectError::Never(anyhow!("{device}: the adapter refuses {bits_per_second} bit/s")));
    }
    let has_stamps = port.ask(Command::TimestampsOn, ANSWER).map_err(gone)? == Answer::Done;
    if port.ask(Command::Listen, ANSWER).map_err(gone)? != Answer::Done {
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
fn close(port: &mut Port) -> std::io::Result<bool> {
    for _ in 0..ATTEMPTS {
        // An adapter whose channel is already closed may refuse; that is a response too.
        if port.ask(Command::Close, ANSWER)? != Answer::Nothing {
            port.settle(SETTLED)?;
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
struct Adapter {
    port: Port,
    bit_rate: Option<u32>,
    has_stamps: bool,
    clock: MillisecondClock,
    controller: Option<String>,
    lost: u64,
    questions: Questions,
}

/// State of the requests for status flags.
struct Questions {
    next: Instant,
    unanswered: u32,
    /// Whether it has ever responded; `None` once it is known that it does not.
    answers: Option<bool>,
}

impl Adapter {
    fn new((port, has_stamps): (Port, bool), bit_rate: Option<u32>) -> Self {
        let questions = Questions { next: Instant::now() + FLAGS_EVERY, unanswered: 0, answers: Some(false) };
        let clock = MillisecondClock::default();
        Self { port, bit_rate, has_stamps, clock, controller: None, lost: 0, questions }
    }

    /// Requests the status flags when it is time.
    fn ask(&mut self) -> Result<(), String> {
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
        self.port.send(Command::ReadFlags).map_err(|error| error.to_string())
    }

    /// Time to wait before the next request, at most `wait`.
    fn until_next(&self, wait: Duration) -> Duration {
        match self.questions.answers {
            Some(_) => wait.min(self.questions.next.saturating_duration_since(Instant::now())),
            None => wait,
        }
    }

    /// Converts a reply to an item, if it is one.
    fn take(&mut self, reply: Reply, arrival: Timestamp) -> Option<Arrival> {
        match reply {
            Reply::Frame(frame, milliseconds) => {
                Some(Arrival::Frame(self.stamped(frame, milliseconds, arrival)))
            }
            Reply::State(state) => {
                self.controller = Some(state.to_string());
                None
            }
            Reply::Flags(flags) => {
                (self.questions.unanswered, self.questions.answers) = (0, Some(true));
                let said = flags.to_string();
                self.controller = (!said.is_empty()).then_some(said);
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
            Reply::Refused if self.questions.unanswered > 0 => {
                (self.questions.unanswered, self.questions.answers) = (0, None);
                None
            }
            Reply::Refused => Some(unreadable("slcan: the adapter reports an error (BEL)".into())),
            Reply::Unreadable(reason) => Some(unreadable(reason)),
            Reply::Done => None,
        }
    }

    fn stamped(&mut self, frame: Frame, milliseconds: Option<u16>, arrival: Timestamp) -> Frame {
        // Error frames are built from lines without a timestamp, even if frames have one.
        if !frame.flags.contains(FrameFlags::ERROR) {
            self.has_stamps = milliseconds.is_some();
        }
        let time = milliseconds.map_or(arrival, |stamp| self.clock.time(stamp, arrival));
        Frame { time: Some(time), ..frame }
    }
}

impl Connection for Adapter {
    fn read(&mut self, items: &mut Vec<Arrival>, wait: Duration) -> Result<(), String> {
        self.ask()?;
        let wait = self.until_next(wait);
        let mut replies = Vec::new();
        self.port.listen(wait, |reply| replies.push(reply)).map_err(|error| error.to_string())?;
        let arrival = clock::now();
        items.extend(replies.into_iter().filter_map(|reply| self.take(reply, arrival)));
        Ok(())
    }

    fn now(&self) -> Timestamp {
        clock::now()
    }

    fn bit_rate(&self) -> Option<u32> {
        self.bit_rate
    }

    fn stamps(&self) -> Stamps {
        if self.has_stamps { Stamps::Adapter } else { Stamps::Arrival }
    }

    fn controller(&self) -> Option<String> {
        self.controller.clone()
    }

    fn mode(&self) -> ControllerMode {
        // `ready` refuses an adapter without it.
        ControllerMode::ListenOnly
    }

    fn lost(&self) -> u64 {
        self.lost
    }
}
