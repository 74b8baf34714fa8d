//! A simulated gs_usb adapter on the USB of the kernel, read by the program and by the driver of Linux.

use std::fs;
use std::io;
use std::net::Shutdown;
use std::os::fd::AsRawFd as _;
use std::os::unix::net::UnixStream;
use std::path::Path;
use std::process::Command;
use std::sync::{Arc, Mutex};
use std::thread;

use cobscope_fake_drivers::gs_usb::{DEVICE, GsUsbDevice, PRODUCT, SERIAL};

use crate::harness::{Program, has_devices, ip, run, wait_until};
use crate::pair::{parse, read};

const ATTACH: &str = "/sys/devices/platform/vhci_hcd.0/attach";
const DETACH: &str = "/sys/devices/platform/vhci_hcd.0/detach";

/// Speed of USB in `attach`: full, 12 Mbit/s.
const FULL_SPEED: u32 = 2;

/// The adapter, plugged into port 0.
struct Plugged {
    device: Arc<Mutex<GsUsbDevice>>,
    served: thread::JoinHandle<()>,
}

impl Plugged {
    fn plug(device: &Arc<Mutex<GsUsbDevice>>) -> Self {
        let (kernel, ours) = UnixStream::pair().unwrap();
        let served = thread::spawn({
            let device = Arc::clone(device);
            move || {
                // An error is the end of the connection from the side of the kernel.
                let _ = device.lock().unwrap().serve_kernel(&ours);
                // The kernel discards what it has not read if it cannot write.
                let _ = ours.shutdown(Shutdown::Write);
                let _ = io::copy(&mut &ours, &mut io::sink());
            }
        });
        fs::write(ATTACH, format!("0 {} {DEVICE} {FULL_SPEED}", kernel.as_raw_fd())).unwrap();
        wait_until("the adapter is a USB device", is_present);
        Self { device: Arc::clone(device), served }
    }

    /// Waits until the adapter has unplugged itself.
    fn unplugged(self) {
        self.served.join().unwrap();
        wait_until("the USB device is gone", || !is_present());
    }

    /// Unplugs it, and returns the calls.
    fn unplug(self) -> Vec<String> {
        fs::write(DETACH, "0").unwrap();
        self.served.join().unwrap();
        wait_until("the USB device is gone", || !is_present());
        self.device.lock().unwrap().calls().to_vec()
    }
}

/// Whether the kernel has read the serial number and made the node of the device.
fn is_present() -> bool {
    let Ok(devices) = fs::read_dir("/sys/bus/usb/devices") else { return false };
    devices.flatten().any(|device| {
        let file = |name: &str| fs::read_to_string(device.path().join(name)).unwrap_or_default();
        let number = |name: &str| file(name).trim().parse::<u16>().unwrap_or(0);
        let node = format!("/dev/bus/usb/{:03}/{:03}", number("busnum"), number("devnum"));
        file("serial").trim() == SERIAL && Path::new(&node).exists()
    })
}

fn adapter(scenario: &str) -> Arc<Mutex<GsUsbDevice>> {
    Arc::new(Mutex::new(GsUsbDevice::new(scenario)))
}

fn cobscope(arguments: &[&str]) -> (String, String) {
    let output = Command::new(env!("CARGO_BIN_EXE_cobscope")).args(arguments).output().unwrap();
    let text = |bytes: &[u8]| String::from_utf8_lossy(bytes).into_owned();
    (text(&output.stdout), text(&output.stderr))
}

/// Asserts that the adapter was only listened to.
fn assert_listened(calls: &[String], times: usize) {
    let count = |what: &str| calls.iter().filter(|call| call.contains(what)).count();
    assert_eq!(count("on the bus in listen-only mode"), times, "{calls:?}");
    assert_eq!(count("normal mode") + count("transmitted"), 0, "{calls:?}");
    assert!(calls.iter().any(|call| call == "bit rate 500000"), "{calls:?}");
    assert_eq!(calls.last().map(String::as_str), Some("off the bus"), "{calls:?}");
}

/// Frames have the numbers from 0 on as their data, and times that keep their distance of 100 µs.
#[test]
fn qemu_a_gs_usb_adapter_is_recorded_without_a_lost_frame() {
    if !has_devices() {
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    let record = folder.path().join("run.log");
    let plugged = Plugged::plug(&adapter("frames=20000"));
    let (list, _) = cobscope(&["live"]);
    assert!(list.contains(&format!("gs_usb:{SERIAL}@BITRATE: {PRODUCT}, available\n")), "{list}");
    let arguments = ["gs_usb:@500k", "-n", "20000", "--record", record.to_str().unwrap()];
    let mut command = Command::new(env!("CARGO_BIN_EXE_cobscope"));
    let ended = Program::start(command.args(["live", "--print", "-f", "none"]).args(arguments)).end();
    assert!(ended.status.success(), "{}", ended.err.join("\n"));
    let recorded = read(&record);
    assert_eq!(recorded.len(), 20_000);
    for (number, recorded) in recorded.iter().enumerate() {
        assert_eq!(recorded.bus, "gs_usb");
        assert_eq!(recorded.frame, format!("181#{:016X}", (number as u64).swap_bytes()));
    }
    assert!(recorded.is_sorted_by_key(|recorded| recorded.time));
    assert_listened(&plugged.unplug(), 1);
}

#[test]
fn qemu_errors_losses_and_unplugging_of_a_gs_usb_adapter_are_events() {
    if !has_devices() {
        return;
    }
    let device = adapter("frames=40,error_every=4,overrun_at=3,bus_off_at=9,unplug_at=20");
    let plugged = Plugged::plug(&device);
    let program = Program::live([&format!("gs_usb:{SERIAL}@500k")]);
    plugged.unplugged();
    program.wait_events("link", |links| links.iter().any(|link| link["state"] == "gone"));
    let plugged = Plugged::plug(&device);
    let is_last = |frame: &serde_json::Value| frame.to_string().contains("2700000000000000");
    program.wait_line("the last frame", |line| {
        serde_json::from_str(line).is_ok_and(|event: serde_json::Value| is_last(&event))
    });
    assert_eq!(program.events("lost-frames").len(), 1);
    let ended = program.interrupt();
    let errors = ended.out.iter().filter(|line| line.contains("\"class\":\"")).collect::<Vec<_>>();
    let count = |what: &str| errors.iter().filter(|line| line.contains(what)).count();
    // Before the frames 4, 8, 12 … 36.
    assert_eq!(count("protocol,bus-error"), 9, "{errors:?}");
    // Once by its error frame; the state that the adapter states adds none.
    assert_eq!(count("bus-off"), 1, "{errors:?}");
    assert_listened(&plugged.unplug(), 2);
}

#[test]
fn qemu_a_gs_usb_adapter_without_listen_only_mode_is_refused() {
    if !has_devices() {
        return;
    }
    let plugged = Plugged::plug(&adapter("light"));
    let (list, _) = cobscope(&["live"]);
    assert!(list.contains("no listen-only mode\n"), "{list}");
    let (_, error) = cobscope(&["live", "--print", "gs_usb:@500k"]);
    assert!(error.contains("the adapter has no listen-only mode; other modes are not used"), "{error}");
    let (_, error) = cobscope(&["live", "--print", "gs_usb:0043@500k"]);
    assert!(error.contains(&format!("adapter 0043 not found; gs_usb adapters: {SERIAL}")), "{error}");
    let calls = plugged.unplug();
    assert!(calls.is_empty(), "{calls:?}");
}

/// The simulation is judged by the driver of Linux, which reads the same frames from it.
#[test]
fn qemu_the_driver_of_linux_reads_the_same_frames() {
    if !has_devices() {
        return;
    }
    let modules = std::env::var("COBSCOPE_GUEST_MODULES").unwrap();
    let busybox = Path::new(&modules).parent().unwrap().join("busybox");
    let busybox = busybox.to_str().unwrap();
    let plugged = Plugged::plug(&adapter("frames=200"));
    run(busybox, &["insmod", &format!("{modules}/gs_usb.ko")]);
    let interface = || {
        let found = fs::read_dir("/sys/class/net").unwrap().flatten();
        let mut names = found.map(|entry| entry.file_name().into_string().unwrap());
        names.find(|name| name.starts_with("can") && name != "can0" && name != "can1")
    };
    wait_until("Linux has an interface for the adapter", || interface().is_some());
    let name = interface().unwrap();

    let (list, _) = cobscope(&["live"]);
    assert!(list.contains("in use by another program or driver\n"), "{list}");
    let (_, error) = cobscope(&["live", "--print", "gs_usb:@500k"]);
    assert!(error.contains("an adapter that Linux uses is an interface of SocketCAN: open can0"), "{error}");

    // The adapter plays its frames once: the interface is set up only when candump has its socket.
    let candump = Program::candump("any");
    wait_until("candump has its socket", || {
        fs::read_to_string("/proc/net/can/rcvlist_all").is_ok_and(|text| !text.contains("(any: no entry)"))
    });
    ip(&format!("link set {name} up type can bitrate 500000 listen-only on"));
    let frame = |number: u64| format!("181#{:016X}", number.swap_bytes());
    candump.wait_line("the last frame", |line| line.contains(&frame(199)));
    let found = parse(&candump.lines().join("\n")).into_iter().filter(|found| found.bus == name);
    let frames: Vec<_> = found.map(|found| found.frame).collect();
    // Linux discards frames that arrive before the interface is up: those of its first 30 reads.
    let expected: Vec<_> = (0..200).map(frame).skip(200_usize.saturating_sub(frames.len())).collect();
    assert_eq!(frames, expected);
    assert!(frames.len() > 100, "{}", frames.len());
    ip(&format!("link set {name} down"));
    assert_listened(&plugged.unplug(), 1);
    run(busybox, &["rmmod", "gs_usb"]);
}
