//! CAN interfaces of Linux, opened for reading. Nothing is ever written to them.
//!
//! The mode of the controller is that of the system: in normal mode it acknowledges the frames of others, and sends error
//! frames at a wrong bit rate. Only a privileged program can change it, and only while the interface is down.

mod datagrams;
mod interface;
mod stand_in;

use std::time::{Duration, Instant};

use nix::poll::{PollFd, PollFlags, PollTimeout, poll};

use super::gather::PACE;
use super::spec::InterfaceSpec;
use super::{Arrivals, BusStatus, LiveSource, SourceEnd};
use interface::BoundInterface;

pub use interface::how_to_bring_up;
use interface::interface_names;
pub use stand_in::stand_in;

/// Name for all interfaces.
const ANY: &str = "any";

/// Interval between two checks of the interfaces.
const WATCH: Duration = Duration::from_millis(250);

/// CAN interfaces read by one thread.
struct Interfaces {
    all: Vec<BoundInterface>,
    /// New interfaces are opened too.
    any: Option<InterfaceSpec>,
    watched: Option<Instant>,
}

/// Opens interfaces; those that are down are opened and waited for.
///
/// # Errors
/// An interface does not exist or cannot be opened; the error contains a remedy.
pub fn open(specs: &[InterfaceSpec]) -> anyhow::Result<Box<dyn LiveSource>> {
    let (mut all, mut any) = (Vec::new(), None);
    for spec in specs {
        if spec.name == ANY {
            all.extend(interface::all_interfaces(spec)?);
            any = Some(spec.clone());
        } else {
            all.push(BoundInterface::open(spec.clone())?);
        }
    }
    Ok(Box::new(Interfaces { all, any, watched: None }))
}

/// Status of all interfaces of this computer.
pub fn all() -> Vec<BusStatus> {
    interface_names().iter().map(|name| BoundInterface::without_socket(name).status()).collect()
}

impl Interfaces {
    /// Checks the interfaces at intervals.
    fn watch_interfaces(&mut self, arrivals: &mut Arrivals) {
        if self.watched.is_some_and(|last| last.elapsed() < WATCH) {
            return;
        }
        self.watched = Some(Instant::now());
        if let Some(spec) = &self.any {
            for name in interface_names() {
                if !self.all.iter().any(|known| known.name() == name) {
                    // An interface that cannot be opened yet is retried at the next check.
                    self.all.extend(BoundInterface::open(InterfaceSpec { name, ..spec.clone() }));
                }
            }
        }
        for interface in &mut self.all {
            interface.watch_interface(arrivals);
        }
    }

    /// Waits at most `wait` for the first frame; returns the interfaces with frames.
    fn wait_ready(&self, wait: Duration) -> Vec<usize> {
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

impl LiveSource for Interfaces {
    fn receive_items(&mut self, arrivals: &mut Arrivals, wait: Duration) -> Result<(), SourceEnd> {
        self.watch_interfaces(arrivals);
        if !arrivals.items.is_empty() {
            return Ok(());
        }
        let ready = self.wait_ready(wait.min(WATCH));
        if ready.is_empty() {
            return Ok(());
        }
        for interface in &mut self.all {
            interface.receive(arrivals);
        }
        Ok(())
    }

    fn bus_status(&mut self) -> Vec<BusStatus> {
        self.all.iter().map(BoundInterface::status).collect()
    }

    fn has_local_times(&self) -> bool {
        true
    }

    fn max_lag(&self) -> Duration {
        PACE * 2
    }
}
