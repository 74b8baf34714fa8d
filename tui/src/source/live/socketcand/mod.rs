//! Buses that a socketcand serves over TCP.
//!
//! Frames carry the server's times. A server that was configured to may switch the interface on when it is
//! opened; nothing is ever sent to a bus.

use std::collections::VecDeque;
use std::io::{ErrorKind, Read as _, Write as _};
use std::net::{TcpStream, ToSocketAddrs as _};
use std::time::{Duration, Instant};

use anyhow::{anyhow, bail};
use cobscope_decoder::capture::adapter::socketcand::{BusName, LONGEST_NAME, Reader, Reply, Request};
use cobscope_decoder::frame::Timestamp;

use super::backoff::Setback;
use super::returning::{Connection, Returning, unreadable};
use super::{Arrival, Source, Stamps, clock};

/// The port socketcand listens at unless it is told another.
const DEFAULT_PORT: u16 = 29_536;

/// How late frames may come over a network.
const LAG: Duration = Duration::from_secs(1);

/// Time for an address to accept the connection, and for the server to hand over the bus.
const CONNECTING: Duration = Duration::from_secs(3);

/// How long a server may be silent: a cable that is pulled ends no connection.
#[derive(Debug, Clone, Copy)]
struct Patience {
    /// Silence after which it is asked whether it is there…
    quiet: Duration,
    /// …and after which it is not.
    dead: Duration,
}

const PATIENCE: Patience = Patience { quiet: Duration::from_secs(5), dead: Duration::from_secs(10) };

/// Bytes taken at a time.
const CHUNK: usize = 64 * 1024;

/// Opens `bus` at the server `address`: a host and perhaps a port, `machine`, `machine:29536`, `[::1]:29536`.
///
/// # Errors
/// A name that cannot be one of a bus, a server that cannot be reached, or that refuses the bus.
pub fn open(address: &str, bus: &str) -> anyhow::Result<Box<dyn Source>> {
    open_with(address, bus, PATIENCE)
}

fn open_with(address: &str, bus: &str, patience: Patience) -> anyhow::Result<Box<dyn Source>> {
    let Some(name) = BusName::new(bus) else {
        bail!(
            "{bus:?} is no name of a bus; expected 1 to {LONGEST_NAME} characters without blanks and brackets, \
             as in socketcand://{address}/can0"
        );
    };
    let address = with_port(address);
    let connect = move || Server::open(&address, &name, patience).map_err(Setback::Again);
    Ok(Box::new(Returning::open(bus, LAG, Vec::new(), connect)?))
}

/// The address with the port it has or the usual one.
fn with_port(address: &str) -> String {
    let is_bare_ipv6 = address.parse::<std::net::Ipv6Addr>().is_ok();
    match address.rsplit_once(':') {
        _ if is_bare_ipv6 => format!("[{address}]:{DEFAULT_PORT}"),
        Some((_, port)) if port.parse::<u16>().is_ok() => address.to_owned(),
        _ => format!("{address}:{DEFAULT_PORT}"),
    }
}

/// A connection to a server that hands over frames.
struct Server {
    stream: TcpStream,
    reader: Reader,
    buffer: Vec<u8>,
    /// Read already, not yet given on.
    replies: VecDeque<Reply>,
    heard: Instant,
    patience: Patience,
    has_asked: bool,
    /// How far the server's clock is ahead of ours, in nanoseconds, as far as frames showed.
    ahead: i64,
}

impl Server {
    fn open(address: &str, bus: &BusName, patience: Patience) -> anyhow::Result<Self> {
        let stream = connect(address)?;
        let mut server = Self {
            stream,
            reader: Reader::default(),
            buffer: vec![0; CHUNK],
            replies: VecDeque::new(),
            heard: Instant::now(),
            patience,
            has_asked: false,
            ahead: 0,
        };
        let deadline = Instant::now() + CONNECTING;
        server.expect(&Reply::Hi, deadline).map_err(|error| anyhow!("{address}: {error}"))?;
        for request in [Request::Open(bus.clone()), Request::RawMode] {
            let result = server.say(&request).and_then(|()| server.expect(&Reply::Ok, deadline));
            result.map_err(|error| anyhow!("{address}: {}: {error}", request.text()))?;
        }
        Ok(server)
    }

    fn say(&mut self, request: &Request) -> Result<(), String> {
        self.stream.write_all(request.text().as_bytes()).map_err(|error| error.to_string())
    }

    /// Waits for the one reply that lets it go on; what comes behind it stays.
    fn expect(&mut self, expected: &Reply, deadline: Instant) -> Result<(), String> {
        loop {
            match self.replies.pop_front() {
                Some(reply) if reply == *expected => return Ok(()),
                Some(Reply::Error(text)) => return Err(format!("the server says {text:?}")),
                Some(Reply::Unreadable(reason)) => return Err(format!("this is no socketcand: {reason}")),
                Some(_) => {}
                None => {
                    let left = deadline.saturating_duration_since(Instant::now());
                    if left.is_zero() {
                        return Err(format!(
                            "no answer within {} s; is this a socketcand?",
                            CONNECTING.as_secs()
                        ));
                    }
                    self.fill(left)?;
                }
            }
        }
    }

    /// Reads once, waiting at most `wait`.
    fn fill(&mut self, wait: Duration) -> Result<(), String> {
        // No time at all would mean to wait for ever.
        let wait = wait.max(Duration::from_millis(1));
        self.stream.set_read_timeout(Some(wait)).map_err(|error| error.to_string())?;
        match self.stream.read(&mut self.buffer) {
            Ok(0) => Err("the server ended the connection".into()),
            Ok(count) => {
                let replies = &mut self.replies;
                let input = self.buffer.get(..count).unwrap_or_default();
                self.reader.read(input, |reply| replies.push_back(reply));
                (self.heard, self.has_asked) = (Instant::now(), false);
                Ok(())
            }
            Err(error) => match error.kind() {
                ErrorKind::TimedOut | ErrorKind::WouldBlock | ErrorKind::Interrupted => Ok(()),
                _ => Err(error.to_string()),
            },
        }
    }

    /// Asks a silent server whether it is there; how long to wait for it at most.
    fn watch(&mut self, wait: Duration) -> Result<Duration, String> {
        let Patience { quiet, dead } = self.patience;
        let silence = self.heard.elapsed();
        if silence >= dead {
            return Err("the server does not answer any more".into());
        }
        if silence >= quiet && !self.has_asked {
            self.has_asked = true;
            self.say(&Request::Echo)?;
        }
        let next = if self.has_asked { dead } else { quiet };
        Ok(wait.min(next.saturating_sub(silence)))
    }
}

/// Connects to the first of a name's addresses that accepts.
fn connect(address: &str) -> anyhow::Result<TcpStream> {
    let addresses = address.to_socket_addrs().map_err(|error| anyhow!("{address}: {error}"))?;
    let mut failed = anyhow!("{address}: the name has no address");
    for candidate in addresses {
        match TcpStream::connect_timeout(&candidate, CONNECTING) {
            Ok(stream) => {
                // Requests are short and wait for answers.
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

impl Connection for Server {
    fn read(&mut self, items: &mut Vec<Arrival>, wait: Duration) -> Result<(), String> {
        if self.replies.is_empty() {
            let wait = self.watch(wait)?;
            self.fill(wait)?;
        }
        let mut last = None;
        items.extend(self.replies.drain(..).filter_map(|reply| match reply {
            Reply::Frame(frame) => {
                last = frame.time;
                Some(Arrival::Frame(frame))
            }
            Reply::Unreadable(reason) => Some(unreadable(reason)),
            Reply::Error(text) => Some(unreadable(format!("socketcand: the server says \"{text}\""))),
            Reply::Hi | Reply::Ok | Reply::Echo => None,
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

    fn stamps(&self) -> Stamps {
        Stamps::Recorded
    }

    fn controller(&self) -> Option<String> {
        None
    }

    fn lost(&self) -> u64 {
        0
    }
}

#[cfg(test)]
mod tests;
