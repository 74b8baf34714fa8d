//! Serial adapters that speak slcan (Lawicel), opened to listen only.
//!
//! An adapter that is no listener is refused: in any other mode its controller acknowledges frames, and so
//! takes part in the bus. A CAN232 hands frames over by itself only where `X1` is stored in it.

mod port;
mod stamps;
#[cfg(test)]
#[cfg(target_os = "linux")]
mod tests;

use std::time::{Duration, Instant};

use anyhow::anyhow;
use cobscope_decoder::capture::adapter::slcan::{BitRate, Command, Reply};
use cobscope_decoder::capture::{Notice, Place};
use cobscope_decoder::frame::{BusIndex, Frame, FrameFlags, Timestamp};

use super::backoff::Setback;
use super::returning::{Connection, Returning, unreadable};
use super::{Arrival, Source, Stamps, clock};
use port::{Answer, BAUD_RATE, Port};
use stamps::StampClock;

/// How late a frame may come: the serial line's own buffers.
const LAG: Duration = Duration::from_millis(50);

/// Time for an answer.
const ANSWER: Duration = Duration::from_millis(500);

/// How often "close" is said before an adapter counts as mute: some boards start anew when they are opened.
const ATTEMPTS: usize = 6;

/// Silence after "close" that shows that nothing else is under way.
const SETTLED: Duration = Duration::from_millis(50);

/// How often status flags are asked for.
const FLAGS_EVERY: Duration = Duration::from_secs(1);

/// Questions for flags without an answer after which an adapter that never answered is not asked any more,
/// and one that did is gone.
const UNANSWERED: u32 = 5;

/// Opens the adapter at the serial port `device`; without a bit rate, in bit/s, its own is kept.
///
/// # Errors
/// A bit rate that slcan does not know, a port that is not there or another's, an adapter that does not
/// answer or will not listen only.
pub fn open(device: &str, bit_rate: Option<u32>) -> anyhow::Result<Box<dyn Source>> {
    let rate = bit_rate.map(|rate| BitRate::of(rate).ok_or_else(|| unknown_rate(rate))).transpose()?;
    let name = device.rsplit(['/', '\\']).next().unwrap_or(device).to_owned();
    let mut remarks = Vec::new();
    if bit_rate.is_none() {
        remarks.push(Notice::Assumption(format!(
            "{name}: the adapter keeps the bit rate it has; slcan:{device}@500000 sets one"
        )));
    }
    let device = device.to_owned();
    let connect = move || {
        let port = ready(&device, bit_rate.zip(rate))?;
        Ok(Adapter::new(port, bit_rate))
    };
    Ok(Box::new(Returning::open(&name, LAG, remarks, connect)?))
}

fn unknown_rate(rate: u32) -> anyhow::Error {
    let known: Vec<_> = BitRate::all().map(|rate| rate.to_string()).collect();
    anyhow!("slcan has no command for {rate} bit/s; it has {}", known.join(", "))
}

/// A port whose adapter listens, and whether it stamps frames.
fn ready(device: &str, rate: Option<(u32, BitRate)>) -> Result<(Port, bool), Setback> {
    let gone = |error: std::io::Error| Setback::Again(not_there(device, &error));
    let mut port = Port::open(device).map_err(gone)?;
    if !close(&mut port).map_err(gone)? {
        return Err(Setback::Again(anyhow!(
            "{device}: no answer to slcan's command C; expected an adapter that speaks Lawicel's protocol, on a \
             serial line at {BAUD_RATE} baud, and no other program (slcand) at it"
        )));
    }
    if let Some((bits_per_second, rate)) = rate
        && port.ask(Command::SetBitRate(rate), ANSWER).map_err(gone)? != Answer::Done
    {
        return Err(Setback::Never(anyhow!("{device}: the adapter refuses {bits_per_second} bit/s")));
    }
    let has_stamps = port.ask(Command::TimestampsOn, ANSWER).map_err(gone)? == Answer::Done;
    if port.ask(Command::Listen, ANSWER).map_err(gone)? != Answer::Done {
        let hint = match rate {
            Some(_) => "use firmware that knows this command",
            None => {
                "it may have no bit rate yet: give one as in @500000; or use firmware that knows this command"
            }
        };
        return Err(Setback::Never(anyhow!(
            "{device}: the adapter refuses to listen only (command L), and this program opens adapters in no \
             other mode, as they would acknowledge frames; {hint}"
        )));
    }
    Ok((port, has_stamps))
}

/// Closes the channel, so that it can be set up; whether the adapter answers.
fn close(port: &mut Port) -> std::io::Result<bool> {
    for _ in 0..ATTEMPTS {
        // One whose channel is closed already may refuse: an answer all the same.
        if port.ask(Command::Close, ANSWER)? != Answer::Nothing {
            port.settle(SETTLED)?;
            return Ok(true);
        }
    }
    Ok(false)
}

/// Why a port cannot be opened, and what to do.
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

/// An adapter that listens.
struct Adapter {
    port: Port,
    bit_rate: Option<u32>,
    has_stamps: bool,
    clock: StampClock,
    controller: Option<String>,
    lost: u64,
    questions: Questions,
}

/// Asking for status flags.
struct Questions {
    next: Instant,
    unanswered: u32,
    /// It has ever answered; `None` once it is known that it does not.
    answers: Option<bool>,
}

impl Adapter {
    fn new((port, has_stamps): (Port, bool), bit_rate: Option<u32>) -> Self {
        let questions = Questions { next: Instant::now() + FLAGS_EVERY, unanswered: 0, answers: Some(false) };
        let clock = StampClock::default();
        Self { port, bit_rate, has_stamps, clock, controller: None, lost: 0, questions }
    }

    /// Asks for status flags where it is time to.
    fn ask(&mut self) -> Result<(), String> {
        let questions = &mut self.questions;
        let Some(has_answered) = questions.answers.filter(|_| questions.next <= Instant::now()) else {
            return Ok(());
        };
        if questions.unanswered >= UNANSWERED {
            if has_answered {
                return Err("the adapter does not answer any more".into());
            }
            questions.answers = None;
            return Ok(());
        }
        questions.unanswered += 1;
        questions.next = Instant::now() + FLAGS_EVERY;
        self.port.say(Command::ReadFlags).map_err(|error| error.to_string())
    }

    /// Until something is to be done besides reading.
    fn until_next(&self, wait: Duration) -> Duration {
        match self.questions.answers {
            Some(_) => wait.min(self.questions.next.saturating_duration_since(Instant::now())),
            None => wait,
        }
    }

    /// What a reply is to the program, if anything.
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
                    Arrival::Notice(Notice::LostFrames { place: Place::Now, bus: BusIndex(0), count: None })
                })
            }
            // It does not know the command; nothing else was said to it.
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
        // Error frames are made of lines without a stamp, whatever the frames of the bus have.
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

    fn lost(&self) -> u64 {
        self.lost
    }
}
