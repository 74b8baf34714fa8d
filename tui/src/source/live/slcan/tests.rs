//! Tests with an adapter simulated by a thread at the other end of a pseudo-terminal.

use std::path::{Path, PathBuf};
use std::sync::mpsc::{self, Sender, TryRecvError};
use std::sync::{Arc, Mutex};
use std::thread::JoinHandle;

use cobscope_decoder::frame::{CanId, LinkState};
use serial2::SerialPort;

use super::super::{Arrivals, BusStatus};
use super::*;

/// Time limit, far longer than any step takes.
const LIMIT: Duration = Duration::from_secs(30);

/// The only commands the program may send.
const ALLOWED: [&str; 6] = ["C", "S4", "S6", "Z1", "L", "F"];

/// Responses to a command.
type Answers = fn(&str) -> &'static [u8];

/// Supports every command; the flags are clear.
fn obliging(line: &str) -> &'static [u8] {
    if line == "F" { b"F00\r" } else { b"\r" }
}

/// A simulated adapter, plugged in while it exists.
struct Plugged {
    link: PathBuf,
    say: Option<Sender<&'static [u8]>>,
    observed: Arc<Mutex<Vec<u8>>>,
    thread: Option<JoinHandle<()>>,
}

impl Plugged {
    fn new(link: &Path, answers: Answers) -> Self {
        use std::os::fd::AsRawFd as _;
        let (mut adapter, port) = SerialPort::pair().unwrap();
        let device = std::fs::read_link(format!("/proc/self/fd/{}", port.as_raw_fd())).unwrap();
        std::os::unix::fs::symlink(device, link).unwrap();
        let observed = Arc::new(Mutex::new(Vec::new()));
        let (say, stated) = mpsc::channel::<&[u8]>();
        let ear = Arc::clone(&observed);
        let thread = std::thread::spawn(move || {
            // Without a handle of its own the terminal would hang up before it is opened.
            let _port = port;
            adapter.set_read_timeout(Duration::from_millis(2)).unwrap();
            let (mut buffer, mut begun) = ([0; 256], String::new());
            loop {
                match stated.try_recv() {
                    Ok(bytes) => adapter.write_all(bytes).unwrap(),
                    Err(TryRecvError::Disconnected) => return,
                    Err(TryRecvError::Empty) => {}
                }
                let count = adapter.read(&mut buffer).unwrap_or(0);
                ear.lock().unwrap().extend_from_slice(&buffer[..count]);
                for byte in &buffer[..count] {
                    match byte {
                        b'\r' => adapter.write_all(answers(&std::mem::take(&mut begun))).unwrap(),
                        byte => begun.push(char::from(*byte)),
                    }
                }
            }
        });
        Self { link: link.into(), say: Some(say), observed, thread: Some(thread) }
    }

    fn send(&self, bytes: &'static [u8]) {
        self.say.as_ref().unwrap().send(bytes).unwrap();
    }

    /// Commands received so far.
    fn received(&self) -> String {
        String::from_utf8(self.observed.lock().unwrap().clone()).unwrap()
    }

    /// Waits until the commands received are `expected`.
    fn hears(&self, expected: &str) {
        let begin = Instant::now();
        while self.received() != expected {
            assert!(begin.elapsed() < LIMIT, "heard {:?}, expected {expected:?}", self.received());
            std::thread::yield_now();
        }
    }
}

impl Drop for Plugged {
    fn drop(&mut self) {
        self.say = None;
        let result = self.thread.take().unwrap().join();
        let _ = std::fs::remove_file(&self.link);
        if !std::thread::panicking() {
            result.unwrap();
            for line in self.received().split_terminator('\r') {
                assert!(ALLOWED.contains(&line), "{line:?} was sent to the adapter");
            }
        }
    }
}

/// A folder with the path of an adapter.
fn place() -> (tempfile::TempDir, PathBuf) {
    let folder = tempfile::tempdir().unwrap();
    let link = folder.path().join("ttyACM7");
    (folder, link)
}

/// Receives until there are `count` items.
fn receive(source: &mut dyn LiveSource, count: usize) -> Vec<Arrival> {
    let (begin, mut arrivals) = (Instant::now(), Arrivals::default());
    while arrivals.items.len() < count {
        assert!(begin.elapsed() < LIMIT, "{:?}", arrivals.items);
        source.receive_items(&mut arrivals, Duration::from_millis(100)).unwrap();
        assert_eq!(arrivals.names.names(), ["ttyACM7"]);
    }
    arrivals.items
}

fn frame(item: &Arrival) -> Frame {
    let Arrival::Frame(frame) = item else { panic!("{item:?} is not a frame") };
    *frame
}

fn only_status(source: &mut dyn LiveSource) -> BusStatus {
    let mut status = source.bus_status();
    assert_eq!(status.len(), 1);
    status.remove(0)
}

fn error(link: &Path, bit_rate: Option<u32>) -> String {
    match open(link.to_str().unwrap(), bit_rate) {
        Ok(_) => panic!("it was opened"),
        Err(error) => format!("{error:#}"),
    }
}

#[test]
fn an_adapter_is_closed_set_up_and_opened_to_listen_and_closed_in_the_end() {
    let (_folder, link) = place();
    let adapter = Plugged::new(&link, |line| if line == "F" { b"" } else { b"\r" });
    let before = clock::now();
    let mut source = open(link.to_str().unwrap(), Some(500_000)).unwrap();
    assert_eq!(adapter.received(), "C\rS6\rZ1\rL\r");
    let items = receive(&mut *source, 1);
    let [
        Arrival::Notice(Notice::Link {
            bus: BusIndex(0),
            time,
            state: LinkState::Up,
            bit_rate: Some(500_000),
        }),
    ] = items[..]
    else {
        panic!("{items:?}")
    };
    assert!(before <= time && time <= clock::now());
    let status = only_status(&mut *source);
    assert_eq!(
        (status.name.as_str(), status.state, status.bit_rate),
        ("ttyACM7", LinkState::Up, Some(500_000))
    );
    assert_eq!((status.stamps, status.controller, status.lost), (SourceClock::Adapter, None, 0));
    assert_eq!(status.mode, Some(ControllerMode::ListenOnly));
    drop(source);
    adapter.hears("C\rS6\rZ1\rL\rC\r");
}

#[test]
fn without_a_bit_rate_the_adapter_keeps_its_own_and_this_is_reported() {
    let (_folder, link) = place();
    // The channel was already closed, and there are no timestamps.
    let adapter = Plugged::new(&link, |line| match line {
        "L" => b"\r",
        _ => b"\x07",
    });
    let mut source = open(link.to_str().unwrap(), None).unwrap();
    assert_eq!(adapter.received(), "C\rZ1\rL\r");
    let items = receive(&mut *source, 2);
    let [Arrival::Notice(Notice::Assumption(text)), Arrival::Notice(Notice::Link { bit_rate: None, .. })] =
        &items[..]
    else {
        panic!("{items:?}")
    };
    assert!(text.starts_with("ttyACM7: bit rate of the adapter unchanged; slcan:/"), "{text}");
    assert_eq!(only_status(&mut *source).stamps, SourceClock::Arrival);
    let before = clock::now();
    adapter.send(b"t1230\r");
    let time = frame(&receive(&mut *source, 1)[0]).time.unwrap();
    assert!((before..=clock::now()).contains(&time));
}

#[test]
fn frames_of_every_kind_are_received_unchanged() {
    let (_folder, link) = place();
    let adapter = Plugged::new(&link, obliging);
    let mut source = open(link.to_str().unwrap(), Some(125_000)).unwrap();
    receive(&mut *source, 1);
    adapter.send(b"t70A105EA5E\rT18FEF1002AABBEA5F\rr0804");
    adapter.send(b"0000\rR1FFFFFFF80001\rd12390001020304050607080910110002\rB00000001");
    adapter.send(b"00003\r\r\nsw096000\rt1232zz\r");
    let items = receive(&mut *source, 8);
    let frames: Vec<_> = items[..7].iter().map(frame).collect();
    assert_eq!((frames[0].id, frames[0].data()), (CanId::Standard(0x70A), &[5][..]));
    assert_eq!((frames[1].id, frames[1].data()), (CanId::Extended(0x18FE_F100), &[0xAA, 0xBB][..]));
    assert_eq!(
        (frames[2].id, frames[2].length, frames[2].flags),
        (CanId::Standard(0x80), 4, FrameFlags::REMOTE)
    );
    assert_eq!((frames[3].id, frames[3].length), (CanId::Extended(0x1FFF_FFFF), 8));
    assert_eq!((frames[4].length, frames[4].flags), (12, FrameFlags::FD));
    assert_eq!(frames[5].flags, FrameFlags::FD.with(FrameFlags::BIT_RATE_SWITCH));
    assert_eq!((frames[6].id, frames[6].flags), (CanId::Extended(0x204), FrameFlags::ERROR));
    // 59,998, 59,999, 0, 1, 2, 3 ms: the timestamps restart between the second and the third.
    let first = frames[0].time.unwrap();
    for (milliseconds, frame) in (0..6).zip(&frames) {
        let since = frame.time.unwrap().since(first);
        assert!(since <= milliseconds * 1_000_000, "{since} instead of {milliseconds} ms");
    }
    assert!(frames[..6].is_sorted_by_key(|frame| frame.time));
    let Arrival::Notice(Notice::Unreadable { place: CapturePlace::Now, reason }) = &items[7] else {
        panic!("{items:?}")
    };
    assert_eq!(reason, "slcan: data: fewer bytes than the DLC; found \"t1232zz\"");
    let status = only_status(&mut *source);
    assert_eq!(
        (status.controller.as_deref(), status.stamps),
        (Some("error warning, rx 96 tx 0"), SourceClock::Adapter)
    );
}

#[test]
fn what_was_under_way_before_it_was_closed_is_left_out() {
    let (_folder, link) = place();
    let adapter = Plugged::new(&link, |line| match line {
        "C" => b"123456\rt1230\r\x07t4560\rt7",
        _ => b"\r",
    });
    let mut source = open(link.to_str().unwrap(), Some(500_000)).unwrap();
    receive(&mut *source, 1);
    adapter.send(b"t0010\r");
    assert_eq!(frame(&receive(&mut *source, 1)[0]).id, CanId::Standard(1));
}

#[test]
fn an_adapter_that_will_not_listen_only_is_refused_and_left_closed() {
    let (_folder, link) = place();
    let adapter = Plugged::new(&link, |line| if line == "L" { b"\x07" } else { b"\r" });
    let text = error(&link, Some(500_000));
    let expected = format!(
        "{}: the adapter refuses listen-only mode (command L); other modes are not used because they acknowledge \
         frames; use firmware that supports this command",
        link.display()
    );
    assert_eq!(text, expected);
    adapter.hears("C\rS6\rZ1\rL\rC\r");
    drop(adapter);
    // The state of an adapter that does not respond is unknown.
    let adapter = Plugged::new(&link, |line| if line == "L" { b"" } else { b"\r" });
    assert!(error(&link, None).contains("its bit rate may not be set: add @500000"));
    adapter.hears("C\rZ1\rL\rC\r");
}

#[test]
fn bit_rates_are_refused_by_name() {
    let (_folder, link) = place();
    let known = "10000, 20000, 50000, 100000, 125000, 250000, 500000, 800000, 1000000";
    assert_eq!(error(&link, Some(83_333)), format!("slcan has no command for 83333 bit/s; it has {known}"));
    let adapter = Plugged::new(&link, |line| if line == "S4" { b"\x07" } else { b"\r" });
    assert_eq!(error(&link, Some(125_000)), format!("{}: the adapter refuses 125000 bit/s", link.display()));
    adapter.hears("C\rS4\rC\r");
}

#[test]
fn a_missing_or_silent_port_is_reported() {
    let (_folder, link) = place();
    let text = error(&link, None);
    assert!(
        text.starts_with(&format!("{}: the serial port cannot be used: No such file", link.display())),
        "{text}"
    );
    assert!(text.contains("serial ports here"), "{text}");
    let adapter = Plugged::new(&link, |_| b"");
    let text = error(&link, None);
    assert!(text.contains("no response to slcan command C"), "{text}");
    adapter.hears("C\rC\rC\rC\rC\rC\rC\r");
}

#[test]
fn lost_frames_are_requested_and_reported() {
    let (_folder, link) = place();
    let adapter = Plugged::new(&link, |line| if line == "F" { b"F2D\r" } else { b"\r" });
    let mut source = open(link.to_str().unwrap(), Some(500_000)).unwrap();
    receive(&mut *source, 1);
    let items = receive(&mut *source, 1);
    let [Arrival::Notice(Notice::LostFrames { place: CapturePlace::Now, bus: BusIndex(0), count: None })] =
        items[..]
    else {
        panic!("{items:?}")
    };
    adapter.hears("C\rS6\rZ1\rL\rF\r");
    let status = only_status(&mut *source);
    assert_eq!(status.lost, 1);
    assert_eq!(status.controller.unwrap(), "receive queue full, error warning, data overrun, error passive");
}

#[test]
fn an_adapter_without_flags_is_asked_once() {
    let (_folder, link) = place();
    let adapter = Plugged::new(&link, |line| if line == "F" { b"\x07" } else { b"\r" });
    let mut source = open(link.to_str().unwrap(), Some(500_000)).unwrap();
    receive(&mut *source, 1);
    let mut arrivals = Arrivals::default();
    // Longer than the time until the second request.
    let begin = Instant::now();
    source.receive_items(&mut arrivals, Duration::from_millis(2_300)).unwrap();
    assert!(arrivals.items.is_empty(), "{arrivals:?}");
    assert!(begin.elapsed() >= Duration::from_millis(2_300));
    assert_eq!(adapter.received(), "C\rS6\rZ1\rL\rF\r");
    adapter.send(b"\x07");
    let items = receive(&mut *source, 1);
    let [Arrival::Notice(Notice::Unreadable { reason, .. })] = &items[..] else { panic!("{items:?}") };
    assert_eq!(reason, "slcan: the adapter reports an error (BEL)");
}

#[test]
fn an_adapter_that_is_unplugged_comes_back_by_itself() {
    let (_folder, link) = place();
    let adapter = Plugged::new(&link, obliging);
    let mut source = open(link.to_str().unwrap(), Some(500_000)).unwrap();
    receive(&mut *source, 1);
    adapter.send(b"t0010\rt12");
    receive(&mut *source, 1);
    drop(adapter);
    let items = receive(&mut *source, 1);
    let [Arrival::Notice(Notice::Link { state: LinkState::Gone, bit_rate: None, .. })] = items[..] else {
        panic!("{items:?}")
    };
    let status = only_status(&mut *source);
    assert_eq!((status.state, status.bit_rate), (LinkState::Gone, None));
    // While it is disconnected, nothing arrives, and receiving waits.
    let (begin, mut arrivals) = (Instant::now(), Arrivals::default());
    source.receive_items(&mut arrivals, Duration::from_millis(300)).unwrap();
    assert!(arrivals.items.is_empty() && begin.elapsed() >= Duration::from_millis(300));

    let adapter = Plugged::new(&link, obliging);
    let items = receive(&mut *source, 1);
    let [Arrival::Notice(Notice::Link { state: LinkState::Up, bit_rate: Some(500_000), .. })] = items[..]
    else {
        panic!("{items:?}")
    };
    assert!(adapter.received().starts_with("C\rS6\rZ1\rL\r"));
    // The incomplete line from before is not part of this one.
    adapter.send(b"t0020\r");
    assert_eq!(frame(&receive(&mut *source, 1)[0]).id, CanId::Standard(2));
    assert_eq!(only_status(&mut *source).state, LinkState::Up);
}

#[test]
fn an_adapter_that_comes_back_and_will_not_listen_only_is_the_end() {
    let (_folder, link) = place();
    let adapter = Plugged::new(&link, obliging);
    let mut source = open(link.to_str().unwrap(), Some(500_000)).unwrap();
    drop(adapter);
    receive(&mut *source, 2);
    let _adapter = Plugged::new(&link, |line| if line == "L" { b"\x07" } else { b"\r" });
    let begin = Instant::now();
    let ended = loop {
        assert!(begin.elapsed() < LIMIT);
        if let Err(ended) = source.receive_items(&mut Arrivals::default(), Duration::from_millis(100)) {
            break ended;
        }
    };
    let super::super::SourceEnd::Failed(error) = ended else { panic!("{ended:?}") };
    assert!(error.to_string().contains("refuses listen-only mode"), "{error}");
}
