//! One CAN interface: opened, watched, opened again when it comes back.

use std::io::ErrorKind;
use std::os::fd::{AsFd, AsRawFd as _, BorrowedFd};
use std::path::Path;

use anyhow::{Context as _, anyhow};
use cobscope_decoder::capture::{BusNames, Notice, Place, kernel_frame};
use cobscope_decoder::frame::{BusIndex, Frame, FrameFlags, LinkState};
use nix::errno::Errno;
use nix::sys::socket::{TimestampingFlag, setsockopt, sockopt};
use socketcan::nl::{CanState, InterfaceDetails};
use socketcan::{CanFdSocket, CanFilter, CanInterface, Socket as _, SocketOptions as _};

use super::super::spec::InterfaceSpec;
use super::super::{Arrival, Arrivals, BusStatus, Stamps};
use super::datagrams::{Datagram, Datagrams, now};

/// Bytes asked of the kernel for frames that wait: 30,000 of them, 0.7 s of two full buses. Without rights the kernel
/// gives less.
pub(super) const BUFFER: usize = 8 * 1024 * 1024;

/// Frames taken at once, so that a flood on one interface does not starve the others.
const MOST: usize = 4_096;

/// An interface and its socket.
pub(super) struct Interface {
    spec: InterfaceSpec,
    socket: Option<Bound>,
    /// As told last.
    told: Option<(LinkState, Option<u32>)>,
    details: Option<InterfaceDetails>,
    lost: u64,
}

struct Bound {
    socket: CanFdSocket,
    /// Number of the interface it is bound to: one that comes back has another.
    index: u32,
    datagrams: Datagrams,
}

impl Interface {
    /// Opens the interface `spec` names, which may be down.
    ///
    /// # Errors
    /// When there is none of this name, or the kernel knows no CAN or permits none.
    pub(super) fn open(spec: InterfaceSpec) -> anyhow::Result<Self> {
        let mut interface = Self::of(spec);
        if !interface.look() {
            return Err(missing(&interface.spec.name));
        }
        interface.bind().map_err(|error| explained(&interface.spec.name, error))?;
        Ok(interface)
    }

    /// The interface of this name, only looked at.
    pub(super) fn named(name: &str) -> Self {
        let (filters, is_joined, errors) = (Vec::new(), false, 0);
        let mut interface = Self::of(InterfaceSpec { name: name.into(), filters, is_joined, errors });
        interface.look();
        interface
    }

    fn of(spec: InterfaceSpec) -> Self {
        Self { spec, socket: None, told: None, details: None, lost: 0 }
    }

    pub(super) fn name(&self) -> &str {
        &self.spec.name
    }

    /// Its socket, while there is one.
    pub(super) fn socket(&self) -> Option<BorrowedFd<'_>> {
        self.socket.as_ref().map(|socket| socket.socket.as_fd())
    }

    fn bind(&mut self) -> std::io::Result<()> {
        let socket = CanFdSocket::open(&self.spec.name)?;
        socket.set_nonblocking(true)?;
        let filters: Vec<CanFilter> =
            self.spec.filters.iter().map(|filter| CanFilter::new(filter.id, filter.mask)).collect();
        if !filters.is_empty() {
            socket.set_filters(&filters)?;
            socket.set_join_filters(self.spec.is_joined)?;
        }
        socket.set_error_filter(self.spec.errors)?;
        if setsockopt(&socket, sockopt::RcvBufForce, &BUFFER).is_err() {
            setsockopt(&socket, sockopt::RcvBuf, &BUFFER)?;
        }
        set_stamps(&socket)?;
        let index = self.details.as_ref().map_or(0, |details| details.index);
        self.socket = Some(Bound { socket, index, datagrams: Datagrams::default() });
        Ok(())
    }

    /// Asks the kernel how it is; `false` where it is gone.
    fn look(&mut self) -> bool {
        self.details = CanInterface::open(&self.spec.name).and_then(|interface| interface.details()).ok();
        self.details.is_some()
    }

    /// Looks whether it went away or came back, and tells what changed.
    pub(super) fn watch(&mut self, arrivals: &mut Arrivals) {
        let is_there = self.look();
        let index = self.details.as_ref().map(|details| details.index);
        let is_same = self.socket.as_ref().is_some_and(|socket| Some(socket.index) == index);
        if !is_same {
            self.socket = None;
            if is_there && let Err(error) = self.bind() {
                say(format!("{}: cannot be opened again: {error}", self.spec.name), arrivals);
            }
        }
        let state = match (&self.details, &self.socket) {
            (Some(details), Some(_)) if details.is_up => LinkState::Up,
            (Some(_), _) => LinkState::Down,
            (None, _) => LinkState::Gone,
        };
        let told = (state, self.bit_rate());
        if self.told.replace(told) != Some(told) {
            let (state, bit_rate) = told;
            if let Some(bus) = self.bus(&mut arrivals.names) {
                arrivals.items.push(Arrival::Notice(Notice::Link { bus, time: now(), state, bit_rate }));
            }
        }
    }

    /// Takes what came.
    pub(super) fn receive(&mut self, arrivals: &mut Arrivals) {
        let Some(bus) = self.bus(&mut arrivals.names) else { return };
        let Some(Bound { socket, datagrams, .. }) = &mut self.socket else { return };
        let mut newly = 0u64;
        let items = &mut arrivals.items;
        let read = datagrams.read(socket.as_raw_fd(), MOST, |datagram| {
            newly = newly.saturating_add(datagram.lost.into());
            take(&datagram, bus, items);
        });
        self.lost = self.lost.saturating_add(newly);
        match read {
            // Told once when the interface goes; what became of it is looked at.
            Ok(()) => {}
            Err(Errno::ENETDOWN | Errno::ENODEV | Errno::ENXIO) => self.watch(arrivals),
            Err(error) => {
                self.socket = None;
                say(format!("{}: reading failed: {}", self.spec.name, error.desc()), arrivals);
            }
        }
    }

    fn bus(&self, names: &mut BusNames) -> Option<BusIndex> {
        names.index_of(self.spec.name.as_bytes())
    }

    fn bit_rate(&self) -> Option<u32> {
        let timing = self.details.as_ref()?.can.bit_timing?;
        (timing.bitrate > 0).then_some(timing.bitrate)
    }

    /// What is known of it; the kernel was asked last by [`Interface::watch`].
    pub(super) fn status(&self) -> BusStatus {
        let has_hardware = self.socket.as_ref().is_some_and(|socket| socket.datagrams.has_hardware_stamps());
        BusStatus {
            name: self.spec.name.clone(),
            state: match &self.details {
                Some(details) if details.is_up => LinkState::Up,
                Some(_) => LinkState::Down,
                None => LinkState::Gone,
            },
            bit_rate: self.bit_rate(),
            controller: self.details.as_ref().and_then(controller),
            stamps: if has_hardware { Stamps::Hardware } else { Stamps::Kernel },
            lost: self.lost,
        }
    }
}

/// Has frames stamped, by the hardware too where it can, and losses counted.
pub(super) fn set_stamps(socket: &impl AsFd) -> nix::Result<()> {
    setsockopt(socket, sockopt::RxqOvfl, &1)?;
    let stamps = TimestampingFlag::SOF_TIMESTAMPING_RX_SOFTWARE
        | TimestampingFlag::SOF_TIMESTAMPING_SOFTWARE
        | TimestampingFlag::SOF_TIMESTAMPING_RX_HARDWARE
        | TimestampingFlag::SOF_TIMESTAMPING_RAW_HARDWARE;
    setsockopt(socket, sockopt::Timestamping, &stamps)
}

fn say(text: String, arrivals: &mut Arrivals) {
    arrivals.items.push(Arrival::Notice(Notice::Assumption(text)));
}

/// Takes a frame, and tells first what was lost before it.
pub(super) fn take(datagram: &Datagram<'_>, bus: BusIndex, items: &mut Vec<Arrival>) {
    let place = Place::Now;
    if datagram.lost > 0 {
        let count = Some(datagram.lost.into());
        items.push(Arrival::Notice(Notice::LostFrames { place, bus, count }));
    }
    items.push(match kernel_frame(datagram.bytes) {
        Ok(frame) => {
            let direction = if datagram.is_own { FrameFlags::TRANSMITTED } else { FrameFlags::default() };
            let flags = frame.flags.with(direction);
            Arrival::Frame(Frame { bus, flags, time: Some(datagram.time), ..frame })
        }
        Err(reason) => Arrival::Notice(Notice::Unreadable { place, reason }),
    });
}

/// `error passive, rx 135 tx 0`, where the driver tells.
fn controller(details: &InterfaceDetails) -> Option<String> {
    let state = match details.can.state? {
        CanState::ErrorActive => "error active",
        CanState::ErrorWarning => "error warning",
        CanState::ErrorPassive => "error passive",
        CanState::BusOff => "bus off",
        CanState::Stopped => "stopped",
        CanState::Sleeping => "sleeping",
    };
    let counters = details.can.berr_counter;
    Some(counters.map_or(state.to_owned(), |count| format!("{state}, rx {} tx {}", count.rxerr, count.txerr)))
}

/// Names of all CAN interfaces there are.
pub(super) fn interfaces() -> Vec<String> {
    /// Type of a network interface that is CAN (ARPHRD_CAN, linux/if_arp.h).
    const CAN: &str = "280";
    let Ok(folder) = std::fs::read_dir("/sys/class/net") else { return Vec::new() };
    let is_can =
        |path: &Path| std::fs::read_to_string(path.join("type")).is_ok_and(|kind| kind.trim() == CAN);
    let found = folder.flatten().filter(|entry| is_can(&entry.path()));
    let mut names: Vec<String> =
        found.map(|entry| entry.file_name().to_string_lossy().into_owned()).collect();
    names.sort();
    names
}

fn missing(name: &str) -> anyhow::Error {
    let known = interfaces();
    if known.is_empty() {
        return anyhow!(
            "{name}: there is no CAN interface on this computer. Is the adapter plugged in, and its driver loaded \
             (dmesg)? Serial adapters: slcan:/dev/ttyACM0@500000; a bus of another machine: \
             ssh MACHINE candump -L any | cobscope live -"
        );
    }
    anyhow!("{name}: there is no such interface; there are {}", known.join(", "))
}

fn explained(name: &str, error: std::io::Error) -> anyhow::Error {
    let hint = match (error.kind(), error.raw_os_error().map(Errno::from_raw)) {
        (_, Some(Errno::EAFNOSUPPORT | Errno::EPROTONOSUPPORT)) => {
            "this kernel has no CAN, or may not load it: sudo modprobe can_raw"
        }
        (ErrorKind::PermissionDenied, _) => {
            "this user may not open CAN sockets here; in a container run it with --network host and CAP_NET_RAW"
        }
        _ => "the interface cannot be opened",
    };
    anyhow::Error::from(error).context(format!("{name}: {hint}"))
}

/// What to do about an interface that is down.
pub fn how_to_bring_up(name: &str, bit_rate: Option<u32>) -> String {
    let settings = if name.starts_with("vcan") {
        String::new()
    } else {
        format!(" type can bitrate {}", bit_rate.map_or("250000".to_owned(), |rate| rate.to_string()))
    };
    format!("{name} is down; waiting for it: sudo ip link set {name} up{settings}")
}

/// All interfaces there are, or why there are none.
pub(super) fn any(spec: &InterfaceSpec) -> anyhow::Result<Vec<Interface>> {
    let names = interfaces();
    if names.is_empty() {
        return Err(missing(&spec.name));
    }
    let open = |name: String| Interface::open(InterfaceSpec { name, ..spec.clone() });
    names.into_iter().map(open).collect::<anyhow::Result<_>>().context("any")
}
