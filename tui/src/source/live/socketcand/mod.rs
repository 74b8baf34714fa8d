//! Buses of a socketcand server over TCP.
//!
//! Frames carry the times of the server. Depending on its configuration, opening a bus may bring its
//! interface up. Nothing is ever sent to a bus; the server decides whether its interface acknowledges frames.

use std::collections::VecDeque;
use std::io::{ErrorKind, Read as _, Write as _};
use std::net::{TcpStream, ToSocketAddrs as _};
use std::time::{Duration, Instant};

use anyhow::{anyhow, bail};
use cobscope_decoder::capture::adapter::socketcand::{
    BusName, LONGEST_NAME, SocketcandReader, SocketcandReply, SocketcandRequest,
};
use cobscope_decoder::frame::Timestamp;

use super::backoff::ConnectError;
use super::returning::{ReconnectingSource, SourceConnection, unreadable_notice};
use super::{Arrival, ControllerMode, LiveSource, SourceClock, clock};

/// Default port of socketcand.
const DEFAULT_PORT: u16 = 29_536;

/// Maximum delay of frames over a network.
const LAG: Duration = Duration::from_secs(1);

/// Time limit for the connection, and for the start of the frames.
const CONNECTING: Duration = Duration::from_secs(3);

/// Time limits for a silent server: an unplugged cable does not end a connection.
#[derive(Debug, Clone, Copy)]
struct SilenceLimits {
    /// Silence after which the server is queried…
    quiet: Duration,
    /// …and after which it counts as disconnected.
    dead: Duration,
}

const PATIENCE: SilenceLimits =
    SilenceLimits { quiet: Duration::from_secs(5), dead: Duration::from_secs(10) };

/// Number of bytes per read.
const CHUNK: usize = 64 * 1024;

/// Opens `bus` at the server `address`: a host with an optional port, `machine`, `machine:29536`,
/// `[::1]:29536`.
///
/// # Errors
/// Invalid bus name; server unreachable; bus refused.
pub fn open(address: &str, bus: &str) -> anyhow::Result<Box<dyn LiveSource>> {
    open_with(address, bus, PATIENCE)
}

fn open_with(address: &str, bus: &str, patience: SilenceLimits) -> anyhow::Result<Box<dyn LiveSource>> {
    let Some(name) = BusName::new(bus) else {
        bail!(
            "{bus:?} is not a valid bus name; expected 1 to {LONGEST_NAME} characters without blanks and brackets, \
             as in socketcand://{address}/can0"
        );
    };
    let address = with_port(address);
    let connect = move || SocketcandConnection::open(&address, &name, patience).map_err(ConnectError::Again);
    Ok(Box::new(ReconnectingSource::open(bus, LAG, Vec::new(), connect)?))
}

/// The address with its port or the default port.
fn with_port(address: &str) -> String {
    let is_bare_ipv6 = address.parse::<std::net::Ipv6Addr>().is_ok();
    match address.rsplit_once(':') {
        _ if is_bare_ipv6 => format!("[{address}]:{DEFAULT_PORT}"),
        Some((_, port)) if port.parse::<u16>().is_ok() => address.to_owned(),
        _ => format!("{address}:{DEFAULT_PORT}"),
    }
}

/// A connection to a server.
struct SocketcandConnection {
    stream: TcpStream,
    reader: SocketcandReader,
    buffer: Vec<u8>,
    /// Replies that are read but not yet processed.
    replies: VecDeque<SocketcandReply>,
    received: Instant,
    patience: SilenceLimits,
    has_asked: bool,
    /// Difference between the clock of the server and ours in ns, as shown by frames.
    ahead: i64,
}

impl SocketcandConnection {
    fn open(address: &str, bus: &BusName, patience: SilenceLimits) -> anyhow::Result<Self> {
        let stream = connect_to(address)?;
        let mut server = Self {
            stream,
            reader: SocketcandReader::default(),
            buffer: vec![0; CHUNK],
            replies: VecDeque::new(),
            received: Instant::now(),
            patience,
            has_asked: false,
            ahead: 0,
        };
        let deadline = Instant::now() + CONNECTING;
        server.expect_reply(&SocketcandReply::Hi, deadline).map_err(|error| anyhow!("{address}: {error}"))?;
        for request in [SocketcandRequest::Open(bus.clone()), SocketcandRequest::RawMode] {
            let result = server
                .send_request(&request)
                .and_then(|()| server.expect_reply(&SocketcandReply::Ok, deadline));
            result.map_err(|error| anyhow!("{address}: {}: {error}", request.to_text()))?;
        }
        Ok(server)
    }

    fn send_request(&mut self, request: &SocketcandRequest) -> Result<(), String> {
        self.stream.write_all(request.to_text().as_bytes()).map_err(|error| error.to_string())
    }

    /// Waits for the reply required to continue; replies after it stay in the queue.
    fn expect_reply(&mut self, expected: &SocketcandReply, deadline: Instant) -> Result<(), String> {
        loop {
            match self.replies.pop_front() {
                Some(reply) if reply == *expected => return Ok(()),
                Some(SocketcandReply::Error(text)) => return Err(format!("server reports {text:?}")),
                Some(SocketcandReply::Unreadable(reason)) => {
                    return Err(format!("not a socketcand server: {reason}"));
                }
                Some(_) => {}
                None => {
                    let left = deadline.saturating_duration_since(Instant::now());
                    if left.is_zero() {
                        return Err(format!(
                            "no response within {} s; is this a socketcand server?",
                            CONNECTING.as_secs()
                        ));
                    }
                    self.fill_buffer(left)?;
                }
            }
        }
    }

    /// Reads once, waiting at most `wait`.
    fn fill_buffer(&mut self, wait: Duration) -> Result<(), String> {
        // A timeout of zero would mean no timeout.
        let wait = wait.max(Duration::from_millis(1));
        self.stream.set_read_timeout(Some(wait)).map_err(|error| error.to_string())?;
        match self.stream.read(&mut self.buffer) {
            Ok(0) => Err("the server closed the connection".into()),
            Ok(count) => {
                let replies = &mut self.replies;
                let input = self.buffer.get(..count).unwrap_or_default();
                self.reader.read_input(input, |reply| replies.push_back(reply));
                (self.received, self.has_asked) = (Instant::now(), false);
                Ok(())
            }
            Err(error) => match error.kind() {
                ErrorKind::TimedOut | ErrorKind::WouldBlock | ErrorKind::Interrupted => Ok(()),
                _ => Err(error.to_string()),
            },
        }
    }

    /// Queries a silent server; returns the maximum time to wait for it.
    fn watch_silence(&mut self, wait: Duration) -> Result<Duration, String> {
        let SilenceLimits { quiet, dead } = self.patience;
        let silence = self.received.elapsed();
        if silence >= dead {
            return Err("the server no longer responds".into());
        }
        if silence >= quiet && !self.has_asked {
            self.has_asked = true;
            self.send_request(&SocketcandRequest::Echo)?;
        }
        let next = if self.has_asked { dead } else { quiet };
        Ok(wait.min(next.saturating_sub(silence)))
    }
}

/// Connects to the first address of a host that accepts.
fn connect_to(address: &str) -> anyhow::Result<TcpStream> {
    let addresses = address.to_socket_addrs().map_err(|error| anyhow!("{address}: {error}"))?;
    let mut failed = anyhow!("{address}: host name not found");
    for candidate in addresses {
        match TcpStream::connect_timeout(&candidate, CONNECTING) {
            Ok(stream) => {
                // Requests are short and wait for responses.
                let _ = stream.set_nodelay(true);
                stream.set_write_timeout(Some(CONNECTING))?;
                return Ok(stream);
            }
            Err(error) => {
                failed = anyhow!(
                    "{address}: cannot connect: {error}; is socketcand running there, and the port open?"
                );
            }
        }
    }
    Err(failed)
}

impl SourceConnection for SocketcandConnection {
    fn read(&mut self, items: &mut Vec<Arrival>, wait: Duration) -> Result<(), String> {
        if self.replies.is_empty() {
            let wait = self.watch_silence(wait)?;
            self.fill_buffer(wait)?;
        }
        let mut last = None;
        items.extend(self.replies.drain(..).filter_map(|reply| match reply {
            SocketcandReply::Frame(frame) => {
                last = frame.time;
                Some(Arrival::Frame(frame))
            }
            SocketcandReply::Unreadable(reason) => Some(unreadable_notice(reason)),
            SocketcandReply::Error(text) => {
                Some(unreadable_notice(format!("socketcand: server reports \"{text}\"")))
            }
            SocketcandReply::Hi | SocketcandReply::Ok | SocketcandReply::Echo => None,
        }));
        if let Some(time) = last {
            self.ahead = time.since(clock::now());
        }
        Ok(())
    }

    fn now(&self) -> Timestamp {
        clock::now().plus(self.ahead)
    }

    fn bit_rate(&self) -> Option<u32> {
        None
    }

    fn timestamp_clock(&self) -> SourceClock {
        SourceClock::Recorded
    }

    fn controller_state(&self) -> Option<String> {
        None
    }

    fn controller_mode(&self) -> ControllerMode {
        ControllerMode::OfServer
    }

    fn lost_frames(&self) -> u64 {
        0
    }
}

#[cfg(test)]
mod tests;
