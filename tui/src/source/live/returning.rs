//! A source with one bus that may go away and come back: an adapter that is unplugged, a server that restarts.

use std::sync::Arc;
use std::time::{Duration, Instant};

use cobscope_decoder::capture::{BusNames, Notice, Place};
use cobscope_decoder::frame::{BusIndex, LinkState, Timestamp};

use super::backoff::{Attempts, Setback};
use super::{Arrival, Arrivals, BusStatus, Ended, Source, Stamps};

/// An open connection to a bus, the only one of its source.
pub trait Connection: Send + 'static {
    /// Reads once what has come, waiting at most `wait` for it.
    ///
    /// # Errors
    /// When it is lost, in words.
    fn read(&mut self, items: &mut Vec<Arrival>, wait: Duration) -> Result<(), String>;

    /// Now, on the clock of its frames.
    fn now(&self) -> Timestamp;

    /// Bit rate of the bus in bit/s, if it is known.
    fn bit_rate(&self) -> Option<u32>;

    /// Whose clock stamps frames.
    fn stamps(&self) -> Stamps;

    /// What its controller says of itself, if it does.
    fn controller(&self) -> Option<String>;

    /// Frames lost since it was opened, at least.
    fn lost(&self) -> u64;
}

/// Opens a connection, the first time and again.
type Connect<C> = dyn Fn() -> Result<C, Setback> + Send + Sync;

enum Link<C> {
    Open(C),
    Gone { attempts: Attempts<C>, reason: String },
}

/// The source.
pub struct Returning<C> {
    names: BusNames,
    connect: Arc<Connect<C>>,
    link: Link<C>,
    lag: Duration,
    /// What is to be said first.
    unsaid: Vec<Notice>,
    /// Kept while the connection is gone.
    lost: u64,
    stamps: Stamps,
}

impl<C: Connection> Returning<C> {
    /// Opens it for the first time; `remarks` are said before anything else.
    ///
    /// # Errors
    /// When it cannot be opened: whoever typed a wrong name wants to know at once.
    pub fn open(
        name: &str,
        lag: Duration,
        remarks: Vec<Notice>,
        connect: impl Fn() -> Result<C, Setback> + Send + Sync + 'static,
    ) -> anyhow::Result<Self> {
        let connection = connect()?;
        let mut names = BusNames::default();
        names.index_of(name.as_bytes());
        let mut unsaid = remarks;
        unsaid.push(link(&connection, LinkState::Up));
        let stamps = connection.stamps();
        let link = Link::Open(connection);
        Ok(Self { names, connect: Arc::new(connect), link, lag, unsaid, lost: 0, stamps })
    }

    /// One step of receiving: reads, or tries to come back.
    fn step(&mut self, items: &mut Vec<Arrival>, wait: Duration) -> Result<(), Ended> {
        match &mut self.link {
            Link::Open(connection) => {
                let Err(reason) = connection.read(items, wait) else { return Ok(()) };
                items.push(Arrival::Notice(link(connection, LinkState::Gone)));
                self.lost = self.lost.saturating_add(connection.lost());
                self.stamps = connection.stamps();
                let connect = Arc::clone(&self.connect);
                // The connection is dropped, and so closed, before the first attempt at another.
                self.link = Link::Gone { attempts: Attempts::start(move || connect()), reason };
            }
            Link::Gone { attempts, .. } => {
                let Some(result) = attempts.wait(wait) else { return Ok(()) };
                let connection = result.map_err(Ended::Failed)?;
                items.push(Arrival::Notice(link(&connection, LinkState::Up)));
                self.link = Link::Open(connection);
            }
        }
        Ok(())
    }
}

/// Says that something which came cannot be read.
pub fn unreadable(reason: String) -> Arrival {
    Arrival::Notice(Notice::Unreadable { place: Place::Now, reason })
}

fn link<C: Connection>(connection: &C, state: LinkState) -> Notice {
    let bit_rate = connection.bit_rate().filter(|_| state == LinkState::Up);
    Notice::Link { bus: BusIndex(0), time: connection.now(), state, bit_rate }
}

impl<C: Connection> Source for Returning<C> {
    fn receive(&mut self, arrivals: &mut Arrivals, wait: Duration) -> Result<(), Ended> {
        if arrivals.names != self.names {
            arrivals.names = self.names.clone();
        }
        let before = arrivals.items.len();
        arrivals.items.extend(self.unsaid.drain(..).map(Arrival::Notice));
        let begin = Instant::now();
        while arrivals.items.len() == before {
            let left = wait.saturating_sub(begin.elapsed());
            self.step(&mut arrivals.items, left)?;
            if left.is_zero() {
                break;
            }
        }
        Ok(())
    }

    fn status(&mut self) -> Vec<BusStatus> {
        let name = self.names.names().first().cloned().unwrap_or_default();
        vec![match &self.link {
            Link::Open(connection) => BusStatus {
                name,
                state: LinkState::Up,
                bit_rate: connection.bit_rate(),
                controller: connection.controller(),
                stamps: connection.stamps(),
                lost: self.lost.saturating_add(connection.lost()),
            },
            Link::Gone { reason, .. } => BusStatus {
                name,
                state: LinkState::Gone,
                bit_rate: None,
                controller: Some(reason.clone()),
                stamps: self.stamps,
                lost: self.lost,
            },
        }]
    }

    fn lag(&self) -> Duration {
        self.lag
    }
}
