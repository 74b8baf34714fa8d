//! A source with one bus that reconnects: an unplugged adapter, a restarted server.

use std::sync::Arc;
use std::time::{Duration, Instant};

use cobscope_decoder::capture::{BusNames, CapturePlace, Notice};
use cobscope_decoder::frame::{BusIndex, LinkState, Timestamp};

use super::backoff::{ConnectAttempts, ConnectError};
use super::{Arrival, Arrivals, BusStatus, ControllerMode, LiveSource, SourceClock, SourceEnd};

/// A connection to the single bus of a source.
pub trait SourceConnection: Send + 'static {
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
    fn timestamp_clock(&self) -> SourceClock;

    /// State of the controller, if the device reports it.
    fn controller_state(&self) -> Option<String>;

    /// Mode of the controller.
    fn controller_mode(&self) -> ControllerMode;

    /// Minimum number of frames lost since it was opened.
    fn lost_frames(&self) -> u64;
}

/// Opens a connection, first and after a disconnection.
type Connect<C> = dyn Fn() -> Result<C, ConnectError> + Send + Sync;

enum ConnectionLink<C> {
    Open(C),
    Gone { attempts: ConnectAttempts<C>, reason: String },
}

/// A source that reconnects.
pub struct ReconnectingSource<C> {
    names: BusNames,
    connect: Arc<Connect<C>>,
    link: ConnectionLink<C>,
    lag: Duration,
    /// Notices to deliver first.
    unsaid: Vec<Notice>,
    /// Number of lost frames of the last connection.
    lost: u64,
    stamps: SourceClock,
}

impl<C: SourceConnection> ReconnectingSource<C> {
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
        unsaid.push(link_notice(&connection, LinkState::Up));
        let stamps = connection.timestamp_clock();
        let link = ConnectionLink::Open(connection);
        Ok(Self { names, connect: Arc::new(connect), link, lag, unsaid, lost: 0, stamps })
    }

    /// Reads once, or tries to reconnect.
    fn read_or_reconnect(&mut self, items: &mut Vec<Arrival>, wait: Duration) -> Result<(), SourceEnd> {
        match &mut self.link {
            ConnectionLink::Open(connection) => {
                let Err(reason) = connection.read(items, wait) else { return Ok(()) };
                items.push(Arrival::Notice(link_notice(connection, LinkState::Gone)));
                self.lost = self.lost.saturating_add(connection.lost_frames());
                self.stamps = connection.timestamp_clock();
                let connect = Arc::clone(&self.connect);
                // The connection is dropped and thus closed before the first attempt at a new one.
                self.link =
                    ConnectionLink::Gone { attempts: ConnectAttempts::start(move || connect()), reason };
            }
            ConnectionLink::Gone { attempts, .. } => {
                let Some(result) = attempts.wait_for(wait) else { return Ok(()) };
                let connection = result.map_err(SourceEnd::Failed)?;
                items.push(Arrival::Notice(link_notice(&connection, LinkState::Up)));
                self.link = ConnectionLink::Open(connection);
            }
        }
        Ok(())
    }
}

/// A notice about unreadable input.
pub fn unreadable_notice(reason: String) -> Arrival {
    Arrival::Notice(Notice::Unreadable { place: CapturePlace::Now, reason })
}

fn link_notice<C: SourceConnection>(connection: &C, state: LinkState) -> Notice {
    let bit_rate = connection.bit_rate().filter(|_| state == LinkState::Up);
    Notice::Link { bus: BusIndex(0), time: connection.now(), state, bit_rate }
}

impl<C: SourceConnection> LiveSource for ReconnectingSource<C> {
    fn receive_items(&mut self, arrivals: &mut Arrivals, wait: Duration) -> Result<(), SourceEnd> {
        if arrivals.names != self.names {
            arrivals.names = self.names.clone();
        }
        let before = arrivals.items.len();
        arrivals.items.extend(self.unsaid.drain(..).map(Arrival::Notice));
        let begin = Instant::now();
        while arrivals.items.len() == before {
            let left = wait.saturating_sub(begin.elapsed());
            self.read_or_reconnect(&mut arrivals.items, left)?;
            if left.is_zero() {
                break;
            }
        }
        Ok(())
    }

    fn bus_status(&mut self) -> Vec<BusStatus> {
        let name = self.names.names().first().cloned().unwrap_or_default();
        vec![match &self.link {
            ConnectionLink::Open(connection) => BusStatus {
                name,
                state: LinkState::Up,
                bit_rate: connection.bit_rate(),
                controller: connection.controller_state(),
                mode: Some(connection.controller_mode()),
                stamps: connection.timestamp_clock(),
                lost: self.lost.saturating_add(connection.lost_frames()),
            },
            ConnectionLink::Gone { reason, .. } => BusStatus {
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

    fn max_lag(&self) -> Duration {
        self.lag
    }
}
