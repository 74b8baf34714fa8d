//! CAN interfaces of Linux. They are opened for reading; nothing is ever written to them.

mod datagrams;
mod interface;
mod stand_in;

use std::time::{Duration, Instant};

use nix::poll::{PollFd, PollFlags, PollTimeout, poll};

use super::gather::PACE;
use super::spec::InterfaceSpec;
use super::{Arrivals, BusStatus, Ended, Source};
use interface::Interface;

pub use interface::how_to_bring_up;
use interface::interfaces;
pub use stand_in::stand_in;

/// The name that stands for all interfaces.
const ANY: &str = "any";

/// How often interfaces are looked at.
const WATCH: Duration = Duration::from_millis(250);

/// CAN interfaces read by one thread.
struct Interfaces {
    all: Vec<Interface>,
    /// Every interface that appears is wanted too.
    any: Option<InterfaceSpec>,
    watched: Option<Instant>,
}

/// Opens interfaces; one that is down is waited for.
///
/// # Errors
/// When an interface does not exist or cannot be opened; with what to do.
pub fn open(specs: &[InterfaceSpec]) -> anyhow::Result<Box<dyn Source>> {
    let (mut all, mut any) = (Vec::new(), None);
    for spec in specs {
        if spec.name == ANY {
            all.extend(interface::any(spec)?);
            any = Some(spec.clone());
        } else {
            all.push(Interface::open(spec.clone())?);
        }
    }
    Ok(Box::new(Interfaces { all, any, watched: None }))
}

/// How all interfaces of this computer are.
pub fn all() -> Vec<BusStatus> {
    interfaces().iter().map(|name| Interface::named(name).status()).collect()
}

impl Interfaces {
    /// Looks at the interfaces from time to time.
    fn watch(&mut self, arrivals: &mut Arrivals) {
        if self.watched.is_some_and(|last| last.elapsed() < WATCH) {
            return;
        }
        self.watched = Some(Instant::now());
        if let Some(spec) = &self.any {
            for name in interfaces() {
                if !self.all.iter().any(|known| known.name() == name) {
                    // One that cannot be opened yet is tried again.
                    self.all.extend(Interface::open(InterfaceSpec { name, ..spec.clone() }));
                }
            }
        }
        for interface in &mut self.all {
            interface.watch(arrivals);
        }
    }

    /// Waits for the first frame, at most `wait`; which interfaces have some.
    fn ready(&self, wait: Duration) -> Vec<usize> {
        let open = self.all.iter().enumerate();
        let open: Vec<_> = open.filter_map(|(place, one)| Some((place, one.socket()?))).collect();
        let mut sockets: Vec<PollFd<'_>> =
            open.iter().map(|(_, socket)| PollFd::new(*socket, PollFlags::POLLIN)).collect();
        if sockets.is_empty() {
            std::thread::sleep(wait);
            return Vec::new();
        }
        let wait = PollTimeout::try_from(wait).unwrap_or(PollTimeout::MAX);
        if poll(&mut sockets, wait).is_err() {
            return Vec::new();
        }
        let is_ready = |socket: &PollFd<'_>| socket.any().unwrap_or(true);
        open.iter()
            .zip(&sockets)
            .filter(|(_, socket)| is_ready(socket))
            .map(|((place, _), _)| *place)
            .collect()
    }
}

impl Source for Interfaces {
    fn receive(&mut self, arrivals: &mut Arrivals, wait: Duration) -> Result<(), Ended> {
        self.watch(arrivals);
        if !arrivals.items.is_empty() {
            return Ok(());
        }
        let ready = self.ready(wait.min(WATCH));
        if ready.is_empty() {
            return Ok(());
        }
        for interface in &mut self.all {
            interface.receive(arrivals);
        }
        Ok(())
    }

    fn status(&mut self) -> Vec<BusStatus> {
        self.all.iter().map(Interface::status).collect()
    }

    fn lag(&self) -> Duration {
        PACE * 2
    }
}
