//! One CAN interface: opened, watched, and reopened after it was removed.

use std::io::ErrorKind;
use std::os::fd::{AsFd, AsRawFd as _, BorrowedFd};
use std::path::Path;

use anyhow::{Context as _, anyhow};
use cobscope_decoder::capture::{BusNames, CapturePlace, Notice, kernel_frame};
use cobscope_decoder::frame::{BusIndex, Frame, FrameFlags, LinkState};
use nix::errno::Errno;
use nix::sys::socket::{TimestampingFlag, setsockopt, sockopt};
use socketcan::nl::{CanCtrlMode, CanState, InterfaceDetails};
use socketcan::{CanFdSocket, CanFilter, CanInterface, Socket as _, SocketOptions as _};

use super::super::spec::InterfaceSpec;
use super::super::{Arrival, Arrivals, BusStatus, ControllerMode, SourceClock};
use super::datagrams::{Datagram, DatagramState, now};

/// Requested size of the receive buffer: 30,000 frames, 0.7 s of two full buses. Without privileges the
/// kernel grants less.
pub(super) const BUFFER: usize = 8 * 1024 * 1024;

/// Maximum number of frames per read, so that a busy interface does not block the others.
const MOST: usize = 4_096;

/// An interface with its socket.
pub(super) struct BoundInterface {
    spec: InterfaceSpec,
    socket: Option<InterfaceBinding>,
    /// State and bit rate as last reported.
    reported: Option<(LinkState, Option<u32>)>,
    details: Option<InterfaceDetails>,
    lost: u64,
}

struct InterfaceBinding {
    socket: CanFdSocket,
    /// Index of the bound interface; a re-created interface has another one.
    index: u32,
    datagrams: DatagramState,
}

impl BoundInterface {
    /// Opens an interface, which may be down.
    ///
    /// # Errors
    /// The interface does not exist, or the kernel has no CAN or denies access.
    pub(super) fn open(spec: InterfaceSpec) -> anyhow::Result<Self> {
        let mut interface = Self::from_spec(spec);
        if !interface.query_state() {
            return Err(missing_interface(&interface.spec.name));
        }
        interface.bind_socket().map_err(|error| explain_error(&interface.spec.name, error))?;
        Ok(interface)
    }

    /// An interface without a socket, for its status only.
    pub(super) fn without_socket(name: &str) -> Self {
        let (filters, is_joined, errors) = (Vec::new(), false, 0);
        let mut interface = Self::from_spec(InterfaceSpec { name: name.into(), filters, is_joined, errors });
        interface.query_state();
        interface
    }

    fn from_spec(spec: InterfaceSpec) -> Self {
        Self { spec, socket: None, reported: None, details: None, lost: 0 }
    }

    pub(super) fn name(&self) -> &str {
        &self.spec.name
    }

    /// Socket of the interface, while it is open.
    pub(super) fn socket(&self) -> Option<BorrowedFd<'_>> {
        self.socket.as_ref().map(|socket| socket.socket.as_fd())
    }

    fn bind_socket(&mut self) -> std::io::Result<()> {
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
        self.socket = Some(InterfaceBinding { socket, index, datagrams: DatagramState::default() });
        Ok(())
    }

    /// Queries the state from the kernel; `false` if the interface is gone.
    fn query_state(&mut self) -> bool {
        self.details = CanInterface::open(&self.spec.name).and_then(|interface| interface.details()).ok();
        self.details.is_some()
    }

    /// Checks whether the interface was removed or has returned, and reports changes.
    pub(super) fn watch_interface(&mut self, arrivals: &mut Arrivals) {
        let is_there = self.query_state();
        let index = self.details.as_ref().map(|details| details.index);
        let is_same = self.socket.as_ref().is_some_and(|socket| Some(socket.index) == index);
        if !is_same {
            self.socket = None;
            if is_there && let Err(error) = self.bind_socket() {
                report_text(format!("{}: cannot be opened again: {error}", self.spec.name), arrivals);
            }
        }
        let state = match (&self.details, &self.socket) {
            (Some(details), Some(_)) if details.is_up => LinkState::Up,
            (Some(_), _) => LinkState::Down,
            (None, _) => LinkState::Gone,
        };
        let reported = (state, self.bit_rate());
        if self.reported.replace(reported) != Some(reported) {
            let (state, bit_rate) = reported;
            if let Some(bus) = self.bus_index(&mut arrivals.names) {
                arrivals.items.push(Arrival::Notice(Notice::Link { bus, time: now(), state, bit_rate }));
            }
        }
    }

    /// Reads the received frames.
    pub(super) fn receive(&mut self, arrivals: &mut Arrivals) {
        let Some(bus) = self.bus_index(&mut arrivals.names) else { return };
        let Some(InterfaceBinding { socket, datagrams, .. }) = &mut self.socket else { return };
        let mut newly = 0u64;
        let items = &mut arrivals.items;
        let read = datagrams.read(socket.as_raw_fd(), MOST, |datagram| {
            newly = newly.saturating_add(datagram.lost.into());
            take_datagram(&datagram, bus, items);
        });
        self.lost = self.lost.saturating_add(newly);
        match read {
            // Reported once when the interface is removed; `watch` checks its state.
            Ok(()) => {}
            Err(Errno::ENETDOWN | Errno::ENODEV | Errno::ENXIO) => self.watch_interface(arrivals),
            Err(error) => {
                self.socket = None;
                report_text(format!("{}: reading failed: {}", self.spec.name, error.desc()), arrivals);
            }
        }
    }

    fn bus_index(&self, names: &mut BusNames) -> Option<BusIndex> {
        names.index_of(self.spec.name.as_bytes())
    }

    fn bit_rate(&self) -> Option<u32> {
        let timing = self.details.as_ref()?.can.bit_timing?;
        (timing.bitrate > 0).then_some(timing.bitrate)
    }

    /// Status, as of the last call of [`BoundInterface::watch_interface`].
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
            controller: self.details.as_ref().and_then(controller_text),
            mode: self.details.as_ref().and_then(|details| controller_mode(&self.spec.name, details)),
            stamps: if has_hardware { SourceClock::Hardware } else { SourceClock::Kernel },
            lost: self.lost,
        }
    }
}

/// Enables timestamps, of the hardware too if possible, and the count of lost frames.
pub(super) fn set_stamps(socket: &impl AsFd) -> nix::Result<()> {
    setsockopt(socket, sockopt::RxqOvfl, &1)?;
    let stamps = TimestampingFlag::SOF_TIMESTAMPING_RX_SOFTWARE
        | TimestampingFlag::SOF_TIMESTAMPING_SOFTWARE
        | TimestampingFlag::SOF_TIMESTAMPING_RX_HARDWARE
        | TimestampingFlag::SOF_TIMESTAMPING_RAW_HARDWARE;
    setsockopt(socket, sockopt::Timestamping, &stamps)
}

fn report_text(text: String, arrivals: &mut Arrivals) {
    arrivals.items.push(Arrival::Notice(Notice::Assumption(text)));
}

/// Adds a frame, after a notice about losses before it.
pub(super) fn take_datagram(datagram: &Datagram<'_>, bus: BusIndex, items: &mut Vec<Arrival>) {
    let place = CapturePlace::Now;
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

/// `error passive, rx 135 tx 0`, if the driver reports it.
fn controller_text(details: &InterfaceDetails) -> Option<String> {
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

/// Mode of the controller of an interface that is up, unless it is virtual.
fn controller_mode(name: &str, details: &InterfaceDetails) -> Option<ControllerMode> {
    if !details.is_up || is_virtual(name) {
        return None;
    }
    let Some(modes) = details.can.ctrl_mode else { return Some(ControllerMode::Unreported) };
    let is_listening = modes.has_mode(CanCtrlMode::ListenOnly);
    Some(if is_listening { ControllerMode::ListenOnly } else { ControllerMode::Normal })
}

/// Whether an interface has the name of virtual ones (vcan0, vxcan0), which have neither controller nor bit rate.
fn is_virtual(name: &str) -> bool {
    name.starts_with("vcan") || name.starts_with("vxcan")
}

/// Names of all CAN interfaces.
pub(super) fn interface_names() -> Vec<String> {
    /// Type of CAN network interfaces (ARPHRD_CAN, linux/if_arp.h).
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

fn missing_interface(name: &str) -> anyhow::Error {
    let known = interface_names();
    if known.is_empty() {
        return anyhow!(
            "{name}: there is no CAN interface on this computer. Is the adapter plugged in, and its driver loaded \
             (dmesg)? Serial adapters: slcan:/dev/ttyACM0@500000; a bus of another machine: \
             ssh MACHINE candump -L any | cobscope live -"
        );
    }
    anyhow!("{name}: unknown interface; available: {}", known.join(", "))
}

fn explain_error(name: &str, error: std::io::Error) -> anyhow::Error {
    let hint = match (error.kind(), error.raw_os_error().map(Errno::from_raw)) {
        (_, Some(Errno::EAFNOSUPPORT | Errno::EPROTONOSUPPORT)) => {
            "the kernel has no CAN support loaded: sudo modprobe can_raw"
        }
        (ErrorKind::PermissionDenied, _) => {
            "no permission to open CAN sockets; run a container with --network host and CAP_NET_RAW"
        }
        _ => "the interface cannot be opened",
    };
    anyhow::Error::from(error).context(format!("{name}: {hint}"))
}

/// Bit rate of the command if the system has none, in bit/s: the usual one of mobile machines.
const EXAMPLE_RATE: u32 = 250_000;

/// Message with the command that brings an interface up, without a part in the traffic of the bus.
pub fn how_to_bring_up(name: &str, bit_rate: Option<u32>) -> String {
    let command = format!("{name} is down; waiting for it: sudo ip link set {name} up");
    if is_virtual(name) {
        return command;
    }
    let rate = bit_rate.unwrap_or(EXAMPLE_RATE);
    format!(
        "{command} type can bitrate {rate} listen-only on (listen-only off if there is only one other node on the bus: its \
         frames need an acknowledgement)"
    )
}

/// All interfaces, or the reason why there are none.
pub(super) fn all_interfaces(spec: &InterfaceSpec) -> anyhow::Result<Vec<BoundInterface>> {
    let names = interface_names();
    if names.is_empty() {
        return Err(missing_interface(&spec.name));
    }
    let open = |name: String| BoundInterface::open(InterfaceSpec { name, ..spec.clone() });
    names.into_iter().map(open).collect::<anyhow::Result<_>>().context("any")
}

#[cfg(test)]
mod tests {
    use socketcan::nl::CanCtrlModes;

    use super::*;

    /// Mode of `name`; flags as in CAN_CTRLMODE_* of linux/can/netlink.h, None without control modes.
    fn mode_of(name: &str, is_up: bool, flags: Option<u32>) -> Option<ControllerMode> {
        let mut details = InterfaceDetails { is_up, ..InterfaceDetails::new(3) };
        // The kernel reports the mask as 0.
        details.can.ctrl_mode = flags.map(|flags| CanCtrlModes::new(0, flags));
        controller_mode(name, &details)
    }

    #[test]
    fn the_mode_is_the_one_of_the_system() {
        // CAN_CTRLMODE_LISTENONLY is 02h, CAN_CTRLMODE_BERR_REPORTING 10h.
        for (flags, expected) in [
            (Some(0x00), ControllerMode::Normal),
            (Some(0x10), ControllerMode::Normal),
            (Some(0x02), ControllerMode::ListenOnly),
            (Some(0x12), ControllerMode::ListenOnly),
            (None, ControllerMode::Unreported),
        ] {
            assert_eq!(mode_of("can0", true, flags), Some(expected), "{flags:?}");
            assert_eq!(mode_of("can0", false, flags), None, "{flags:?}");
        }
        assert_eq!((mode_of("vcan0", true, None), mode_of("vxcan1", true, None)), (None, None));
    }

    #[test]
    fn the_command_brings_an_interface_up_in_listen_only_mode() {
        let reason = "(listen-only off if there is only one other node on the bus: its frames need an acknowledgement)";
        assert_eq!(
            how_to_bring_up("can0", Some(125_000)),
            format!(
                "can0 is down; waiting for it: sudo ip link set can0 up type can bitrate 125000 listen-only on {reason}"
            )
        );
        assert!(how_to_bring_up("can1", None).contains("can1 up type can bitrate 250000 listen-only on"));
        for name in ["vcan0", "vxcan0"] {
            let expected = format!("{name} is down; waiting for it: sudo ip link set {name} up");
            assert_eq!(how_to_bring_up(name, None), expected);
        }
    }
}
