//! A source with one bus that reconnects: an unplugged adapter, a restarted server.

use std::sync::Arc;
use std::time::{Duration, Instant};

use cobscope_decoder::capture::{BusNames, CapturePlace, Notice};
use cobscope_decoder::frame::{BusIndex, LinkState, Timestamp};

use super::backoff::{Attempts, ConnectError};
use super::{Arrival, Arrivals, BusStatus, ControllerMode, Source, SourceEnd, Stamps};

/// A connection to the single bus of a source.
pub trait Connection: Send + 'static {
    /// Reads once, waiting at most `wait`.
    ///
    /// # Errors
    /// The connection is lost; the text is the reason.
    fn read(&mut self, items: &mut Vec<Arrival>, wait: Duration) -> Result<(), String>;

    /// Present time in the clock of its frames.
    fn now(&self) -> Timestamp;

    /// Bit rate in bit/s, if known.
    fn bit_rate(&self) -> Option<u32>;

    /// Clock of the timestamps.
    fn stamps(&self) -> Stamps;

    /// State of the controller, if the device reports it.
    fn controller(&self) -> Option<String>;

    /// Mode of the controller.
    fn mode(&self) -> ControllerMode;

    /// Minimum number of frames lost since it was opened.
    fn lost(&self) -> u64;
}

/// Opens a connection, first and after a disconnection.
type Connect<C> = dyn Fn() -> Result<C, ConnectError> + Send + Sync;

enum Link<C> {
    Open(C),
    Gone { attempts: Attempts<C>, reason: String },
}

/// A source that reconnects.
pub struct ReconnectingSource<C> {
    names: BusNames,
    connect: Arc<Connect<C>>,
    link: Link<C>,
    lag: Duration,
    /// Notices to deliver first.
    unsaid: Vec<Notice>,
    /// Number of lost frames of the last connection.
    lost: u64,
    stamps: Stamps,
}

impl<C: Connection> ReconnectingSource<C> {
    /// Opens the first connection; `remarks` are delivered first.
    ///
    /// # Errors
    /// The first connection fails; there are no retries, so that a wrong name is reported at once.
    pub fn open(
        name: &str,
        lag: Duration,
        remarks: Vec<Notice>,
        connect: impl Fn() -> Result<C, ConnectError> + Send + Sync + 'static,
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

    /// Reads once, or tries to reconnect.
    fn step(&mut self, items: &mut Vec<Arrival>, wait: Duration) -> Result<(), SourceEnd> {
        match &mut self.link {
            Link::Open(connection) => {
                let Err(reason) = connection.read(items, wait) else { return Ok(()) };
                items.push(Arrival::Notice(link(connection, LinkState::Gone)));
                self.lost = self.lost.saturating_add(connection.lost());
                self.stamps = connection.stamps();
                let connect = Arc::clone(&self.connect);
                // The connection is dropped and thus closed before the first attempt at a new one.
                self.link = Link::Gone { attempts: Attempts::start(move || connect()), reason };
            }
            Link::Gone { attempts, .. } => {
                let Some(result) = attempts.wait(wait) else { return Ok(()) };
                let connection = result.map_err(SourceEnd::Failed)?;
                items.push(Arrival::Notice(link(&connection, LinkState::Up)));
                self.link = Link::Open(connection);
            }
        }
        Ok(())
    }
}

/// A notice about unreadable input.
pub fn unreadable(reason: String) -> Arrival {
    Arrival::Notice(Notice::Unreadable { place: CapturePlace::Now, reason })
}

fn link<C: Connection>(connection: &C, state: LinkState) -> Notice {
    let bit_rate = connection.bit_rate().filter(|_| state == LinkState::Up);
    Notice::Link { bus: BusIndex(0), time: connection.now(), state, bit_rate }
}

impl<C: Connection> Source for ReconnectingSource<C> {
    fn receive(&mut self, arrivals: &mut Arrivals, wait: Duration) -> Result<(), SourceEnd> {
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
                mode: Some(connection.mode()),
                stamps: connection.stamps(),
                lost: self.lost.saturating_add(connection.lost()),
            },
            Link::Gone { reason, .. } => BusStatus {
                name,
                state: LinkState::Gone,
                bit_rate: None,
                controller: Some(reason.clone()),
                mode: None,
                stamps: self.stamps,
                lost: self.lost,
            },
        }]
    }

    fn lag(&self) -> Duration {
        self.lag
    }
}
