//! UDP datagrams that contain one frame each, for benchmarks on kernels without CAN. They get timestamps, are
//! counted when lost, and are read like frames.

use std::net::UdpSocket;
use std::os::fd::{AsFd as _, AsRawFd as _, BorrowedFd};
use std::time::Duration;

use cobscope_decoder::frame::LinkState;
use nix::poll::{PollFd, PollFlags, PollTimeout, poll};
use nix::sys::socket::{setsockopt, sockopt};

use super::super::gather::PACE;
use super::super::{Arrivals, BusStatus, LiveSource, SourceClock, SourceEnd};
use super::datagrams::DatagramState;
use crate::source::live::socketcan::interface::{BUFFER, set_stamps, take_datagram};

/// Name of the bus.
const NAME: &str = "datagrams";

struct StandIn {
    socket: UdpSocket,
    datagrams: DatagramState,
    lost: u64,
}

/// A source of the datagrams that `socket` receives.
///
/// # Errors
/// The socket cannot be configured.
pub fn stand_in(socket: UdpSocket) -> anyhow::Result<Box<dyn LiveSource>> {
    setsockopt(&socket, sockopt::RcvBuf, &BUFFER)?;
    set_stamps(&socket)?;
    Ok(Box::new(StandIn { socket, datagrams: DatagramState::default(), lost: 0 }))
}

impl LiveSource for StandIn {
    fn receive_items(&mut self, arrivals: &mut Arrivals, wait: Duration) -> Result<(), SourceEnd> {
        let bus = arrivals.names.index_of(NAME.as_bytes()).unwrap_or_default();
        if is_readable(self.socket.as_fd(), wait) {
            let (lost, items) = (&mut self.lost, &mut arrivals.items);
            let read = self.datagrams.read(self.socket.as_raw_fd(), usize::MAX, |datagram| {
                *lost = lost.saturating_add(datagram.lost.into());
                take_datagram(&datagram, bus, items);
            });
            read.map_err(|error| SourceEnd::Failed(error.into()))?;
        }
        Ok(())
    }

    fn bus_status(&mut self) -> Vec<BusStatus> {
        let (name, state, stamps) = (NAME.to_owned(), LinkState::Up, SourceClock::Kernel);
        let (bit_rate, controller, mode, lost) = (None, None, None, self.lost);
        vec![BusStatus { name, state, bit_rate, controller, mode, stamps, lost }]
    }

    fn max_lag(&self) -> Duration {
        PACE * 2
    }
}

/// Waits at most `wait` until a socket is readable.
fn is_readable(socket: BorrowedFd<'_>, wait: Duration) -> bool {
    let wait = PollTimeout::try_from(wait).unwrap_or(PollTimeout::MAX);
    poll(&mut [PollFd::new(socket, PollFlags::POLLIN)], wait).is_ok_and(|count| count > 0)
}
