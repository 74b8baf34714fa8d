//! The bindings against the simulated drivers of `bindings/fake`.

#![allow(
    clippy::unwrap_used,
    clippy::panic,
    clippy::indexing_slicing,
    reason = "a test that cannot continue has failed"
)]
#![allow(unsafe_code, reason = "functions in C that set up the simulated driver")]

use std::ffi::{CString, c_char};
use std::path::PathBuf;
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

use cobscope_adapters::{
    AdapterKind, ChannelListener, ChannelState, ErrorCounters, FaultConfinement, OpenError, ReceivedFrame,
    ReceivedItem, Vendor, ViolationKind,
};

/// Time limit, far longer than any step takes.
const LIMIT: Duration = Duration::from_mins(1);

/// The library has one state per process.
static TURN: Mutex<()> = Mutex::new(());

/// Both drivers with a scenario.
struct Driver {
    library: libloading::Library,
    _turn: MutexGuard<'static, ()>,
}

/// The shared library next to this program.
fn library() -> PathBuf {
    let program = std::env::current_exe().unwrap();
    let name =
        format!("{}cobscope_fake_drivers{}", std::env::consts::DLL_PREFIX, std::env::consts::DLL_SUFFIX);
    program.parent().unwrap().join(name)
}

impl Driver {
    fn start(scenario: &str) -> Self {
        let turn = TURN.lock().unwrap_or_else(PoisonError::into_inner);
        let path = library();
        for vendor in [Vendor::Pcan, Vendor::Kvaser] {
            // SAFETY: no other thread reads the environment: each test holds the lock.
            unsafe { std::env::set_var(vendor.variable(), &path) };
        }
        let scenario = CString::new(scenario).unwrap();
        // SAFETY: the signature is that of the library in this workspace.
        let library = unsafe {
            let library = libloading::Library::new(&path).unwrap();
            library.get::<unsafe extern "C" fn(*const c_char)>("fake_reset").unwrap()(scenario.as_ptr());
            library
        };
        Self { library, _turn: turn }
    }

    /// Calls so far, one line each.
    fn calls(&self) -> String {
        let mut buffer = vec![0_u8; 1 << 20];
        // SAFETY: the signature is that of the library in this workspace, and the length is that of the buffer.
        unsafe {
            self.library.get::<unsafe extern "C" fn(*mut u8, usize)>("fake_calls").unwrap()(
                buffer.as_mut_ptr(),
                buffer.len(),
            );
        }
        let end = buffer.iter().position(|byte| *byte == 0).unwrap();
        let calls = String::from_utf8(buffer[..end].to_vec()).unwrap();
        assert!(!calls.contains("Write"), "{calls}");
        calls
    }
}

const CHANNELS: [(AdapterKind, &str); 2] = [(AdapterKind::Pcan, "USB1"), (AdapterKind::Kvaser, "0")];

fn listen(kind: AdapterKind, channel: &str) -> Box<dyn ChannelListener> {
    match kind.listen(channel, 500_000) {
        Ok(listener) => listener,
        Err(error) => panic!("{error}"),
    }
}

fn refusal(kind: AdapterKind, channel: &str, bit_rate: u32) -> OpenError {
    match kind.listen(channel, bit_rate) {
        Ok(_) => panic!("it was opened"),
        Err(error) => error,
    }
}

/// Reads until there are `count` readings.
fn read(listener: &mut dyn ChannelListener, count: usize) -> Vec<ReceivedItem> {
    let (begin, mut readings) = (Instant::now(), Vec::new());
    while readings.len() < count {
        assert!(begin.elapsed() < LIMIT, "{} readings", readings.len());
        listener.read(&mut readings, Duration::from_millis(100)).unwrap();
    }
    readings
}

/// Frame number `number` of the simulated driver, which starts at 5 s.
fn frame(number: u64) -> ReceivedItem {
    let stamp = u32::try_from(5_000_000 + number * 100).unwrap();
    ReceivedItem::Frame(ReceivedFrame {
        id: 0x181,
        is_extended: false,
        is_remote: false,
        length: 8,
        data: number.to_le_bytes(),
        stamp,
    })
}

#[test]
fn listen_only_mode_is_set_and_read_back_before_the_channel_joins_the_bus() {
    let driver = Driver::start("");
    drop(listen(AdapterKind::Pcan, "USB1"));
    let expected = "CAN_GetValue 0D\nCAN_SetValue 08 1\nCAN_GetValue 08\nCAN_Initialize 001C\n\
                    on the bus in listen-only mode\nCAN_GetValue 08\nCAN_SetValue 20 1\nCAN_Uninitialize";
    assert_eq!(driver.calls(), expected);
    drop(driver);

    let driver = Driver::start("");
    drop(listen(AdapterKind::Kvaser, "0"));
    let calls = driver.calls();
    // Initialised once per process.
    let calls = calls.strip_prefix("canInitializeLibrary\n").unwrap_or(&calls);
    let expected = "canEnumHardwareEx\ncanOpenChannel 0 A0\ncanSetBusParams -2\ncanSetBusOutputControl 1\ncanGetBusOutputControl\n\
                    canIoCtl timer scale\ncanBusOn\non the bus in listen-only mode\ncanGetBusOutputControl\n\
                    canBusOff\ncanClose";
    assert_eq!(calls, expected);
}

#[test]
fn bit_rates_without_a_constant_of_canlib_have_their_own_timing() {
    for (bit_rate, timing) in [(20_000, "20000 13 2 1 1"), (800_000, "800000 7 2 1 1")] {
        let driver = Driver::start("");
        drop(AdapterKind::Kvaser.listen("0", bit_rate).unwrap());
        assert!(driver.calls().contains(&format!("canSetBusParams {timing}\n")), "{}", driver.calls());
    }
}

#[test]
fn no_frame_of_100_000_is_lost_or_changed() {
    for (kind, channel) in CHANNELS {
        let driver = Driver::start("frames=100000,error_every=1000");
        let mut listener = listen(kind, channel);
        // 99 errors: before frames 1,000, 2,000, …, 99,000.
        let readings = read(&mut *listener, 100_099);
        let (frames, errors): (Vec<_>, Vec<_>) =
            readings.into_iter().partition(|reading| matches!(reading, ReceivedItem::Frame(_)));
        assert!(frames.iter().zip(0..).all(|(found, number)| *found == frame(number)));
        assert_eq!((frames.len(), errors.len()), (100_000, 99));
        let ReceivedItem::Error(error) = &errors[0] else { panic!("{:?}", errors[0]) };
        assert_eq!((error.violation, error.is_transmitting), (Some(ViolationKind::Stuff), false));
        assert_eq!(error.stamp, 5_100_000);
        // PCAN states position and counters, CANlib neither.
        let is_pcan = kind == AdapterKind::Pcan;
        let counters = Some(ErrorCounters { receive: 96, transmit: 0 }).filter(|_| is_pcan);
        assert_eq!((error.place, error.counters), (if is_pcan { 10 } else { 0 }, counters));
        drop(listener);
        driver.calls();
    }
}

#[test]
fn lost_frames_invalid_messages_and_bus_off_are_reported() {
    for (kind, channel) in CHANNELS {
        let _driver = Driver::start("frames=6,overrun_at=2,invalid_at=4,bus_off_at=6");
        let mut listener = listen(kind, channel);
        assert_eq!(listener.status().unwrap().confinement, FaultConfinement::Active);
        let readings = read(&mut *listener, 8);
        let ReceivedItem::Invalid(_) = &readings[5] else { panic!("{readings:?}") };
        let mut others = readings.clone();
        others.remove(5);
        assert_eq!(
            others,
            [frame(0), frame(1), ReceivedItem::Lost, frame(2), frame(3), frame(4), frame(5)],
            "{kind:?}"
        );
        let status = listener.status().unwrap();
        assert_eq!(status.confinement, FaultConfinement::BusOff);
        let counters = (kind == AdapterKind::Kvaser).then_some(ErrorCounters { receive: 255, transmit: 0 });
        assert_eq!(status.counters, counters);
    }
}

#[test]
fn an_unplugged_adapter_is_reported_and_can_be_opened_again() {
    let reasons = [
        "The value of a handle is invalid [2J (PCAN status 1400)",
        "A hardware error was detected (CANlib status -15)",
    ];
    for ((kind, channel), reason) in CHANNELS.into_iter().zip(reasons) {
        let driver = Driver::start("frames=20,unplug_at=10");
        let mut listener = listen(kind, channel);
        let mut readings = Vec::new();
        let error = loop {
            match listener.read(&mut readings, Duration::from_millis(10)) {
                Ok(()) => assert!(readings.len() <= 10),
                Err(error) => break error,
            }
        };
        assert_eq!((readings.len(), error.0.as_str()), (10, reason));
        assert_eq!(listener.status().unwrap_err().0, reason);
        drop(listener);
        let mut listener = listen(kind, channel);
        assert_eq!(read(&mut *listener, 10), (10..20).map(frame).collect::<Vec<_>>());
        drop(listener);
        assert_eq!(driver.calls().matches("on the bus in listen-only mode").count(), 2);
    }
}

#[test]
fn an_adapter_without_listen_only_mode_never_stays_on_the_bus() {
    for (kind, channel) in CHANNELS {
        for mode in ["refuse", "ignore", "cancel"] {
            let driver = Driver::start(&format!("frames=10,listen={mode}"));
            let error = refusal(kind, channel, 500_000);
            assert_eq!(error, OpenError::NotListenOnly { kind, channel: channel.into() }, "{mode}");
            assert!(!error.is_temporary());
            let text = error.to_string();
            assert!(text.contains("other modes are not used because they acknowledge frames"), "{text}");
            let calls = driver.calls();
            if mode == "cancel" {
                // Only the driver knew: the channel is closed at once.
                let last = calls.lines().last();
                assert!(matches!(last, Some("CAN_Uninitialize" | "canClose")), "{calls}");
            } else {
                assert!(!calls.contains("on the bus"), "{calls}");
            }
        }
    }
    let driver = Driver::start("light");
    let error = refusal(AdapterKind::Kvaser, "0", 500_000);
    assert!(error.to_string().contains("Leaf Light"), "{error}");
    assert!(!driver.calls().contains("canOpenChannel"));
}

#[test]
fn channels_are_listed_with_their_states() {
    use ChannelState::{Available, InUse, NotListenOnly};
    let states = |scenario: &str| {
        let _driver = Driver::start(scenario);
        CHANNELS.map(|(kind, _)| {
            let found = kind.channels().unwrap();
            found.into_iter().map(|channel| (channel.name, channel.device, channel.state)).collect::<Vec<_>>()
        })
    };
    let pcan = |state| vec![("USB1".to_owned(), "PCAN-USB FD, channel 1, device 7".to_owned(), state)];
    let kvaser = |state| vec![("0".to_owned(), "Kvaser Leaf Pro HS v2, channel 1".to_owned(), state)];
    assert_eq!(states(""), [pcan(Available), kvaser(Available)]);
    assert_eq!(states("in_use"), [pcan(InUse), kvaser(Available)]);
    assert_eq!(states("light"), [pcan(Available), kvaser(NotListenOnly)]);
    assert_eq!(states("absent"), [vec![], vec![]]);
    // 4,294,967,295 channels of PEAK, and a negative number of Kvaser.
    assert_eq!(states("hostile"), [pcan(Available), vec![]]);
}

/// The reason is that of the operating system.
#[test]
fn a_missing_library_is_reported_with_its_package() {
    // A library that is loaded stays loaded, so that this needs a process of its own: this test again.
    const LIBRARY: &str = "COBSCOPE_KVASER_LIBRARY";
    const MISSING: &str = "/no/such/library";
    let _turn = TURN.lock().unwrap_or_else(PoisonError::into_inner);
    if std::env::var_os(LIBRARY).is_some_and(|path| path == MISSING) {
        return println!("{}", refusal(AdapterKind::Kvaser, "0", 500_000));
    }
    let program = std::env::current_exe().unwrap();
    let mut command = std::process::Command::new(program);
    let output = command
        .args(["--exact", "--nocapture", "a_missing_library_is_reported_with_its_package"])
        .env(LIBRARY, MISSING)
        .output()
        .unwrap();
    let text = String::from_utf8_lossy(&output.stdout);
    assert!(text.contains("driver library /no/such/library not available ("), "{text}");
    assert!(!text.contains("dlopen failed"), "{text}");
    assert!(text.contains("); install \"Kvaser"), "{text}");
}

#[test]
fn other_failures_are_sentences() {
    let error = |scenario: &str, kind, channel, bit_rate| {
        let _driver = Driver::start(scenario);
        refusal(kind, channel, bit_rate).to_string()
    };
    assert_eq!(
        error("", AdapterKind::Pcan, "USB1", 300_000),
        "300000 bit/s not available; expected 5000, 10000, 20000, 33333, 47619, 50000, 83333, 95238, 100000, 125000, \
         250000, 500000, 800000, 1000000"
    );
    assert_eq!(
        error("", AdapterKind::Kvaser, "0", 300_000),
        "300000 bit/s not available; expected 10000, 20000, 50000, 62500, 83333, 100000, 125000, 250000, 500000, 800000, \
         1000000"
    );
    for (kind, channel) in CHANNELS {
        assert_eq!(
            error("in_use", kind, channel, 500_000),
            format!("channel {channel} is in use by another program; close it first")
        );
    }
    assert_eq!(
        error("", AdapterKind::Pcan, "USB2", 500_000),
        "channel USB2 not found; channels of PEAK: USB1"
    );
    assert_eq!(error("", AdapterKind::Kvaser, "1", 500_000), "channel 1 not found; channels of Kvaser: 0");
    assert_eq!(error("", AdapterKind::Kvaser, "+0", 500_000), "channel +0 not found; channels of Kvaser: 0");
    assert_eq!(
        error("absent", AdapterKind::Pcan, "USB1", 500_000),
        "channel USB1 not found; the driver of PEAK reports no adapter"
    );
}
