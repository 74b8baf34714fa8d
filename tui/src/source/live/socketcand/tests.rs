//! Tests with a server simulated by a thread on loopback.

use std::net::TcpListener;
use std::thread::JoinHandle;

use cobscope_decoder::capture::Notice;
use cobscope_decoder::frame::{BusIndex, CanId, LinkState};

use super::super::Arrivals;
use super::*;

/// Time limit, far longer than any step takes.
const LIMIT: Duration = Duration::from_secs(30);

/// A server that accepts one connection after another.
struct Script {
    listener: TcpListener,
}

/// A connection controlled by a script.
struct Peer(TcpStream);

impl Script {
    fn new() -> (Self, String) {
        let listener = TcpListener::bind("127.0.0.1:0").unwrap();
        let address = listener.local_addr().unwrap().to_string();
        (Self { listener }, address)
    }

    fn accept(&self) -> Peer {
        let (stream, _) = self.listener.accept().unwrap();
        stream.set_read_timeout(Some(LIMIT)).unwrap();
        Peer(stream)
    }

    /// Accepts a connection and opens can0, as socketcand does.
    fn hand_over(&self) -> Peer {
        let mut peer = self.accept();
        peer.send("< hi >");
        peer.hears("< open can0 >");
        peer.send("< ok >");
        peer.hears("< rawmode >");
        peer.send("< ok >");
        peer
    }
}

impl Peer {
    fn send(&mut self, text: &str) {
        self.0.write_all(text.as_bytes()).unwrap();
    }

    /// Asserts that the next request is `expected`.
    fn hears(&mut self, expected: &str) {
        let mut received = vec![0; expected.len()];
        self.0.read_exact(&mut received).unwrap();
        assert_eq!(String::from_utf8(received).unwrap(), expected);
    }

    /// Asserts that the client closes the connection without a further request.
    fn hears_the_end(mut self) {
        let mut rest = Vec::new();
        self.0.read_to_end(&mut rest).unwrap();
        assert_eq!(String::from_utf8(rest).unwrap(), "");
    }
}

/// Runs the script of a server in parallel to a test.
fn serve(script: impl FnOnce() + Send + 'static) -> JoinHandle<()> {
    std::thread::spawn(script)
}

/// Receives until there are `count` items.
fn receive(source: &mut dyn LiveSource, count: usize) -> Vec<Arrival> {
    let (begin, mut arrivals) = (Instant::now(), Arrivals::default());
    while arrivals.items.len() < count {
        assert!(begin.elapsed() < LIMIT, "{:?}", arrivals.items);
        source.receive_items(&mut arrivals, Duration::from_millis(100)).unwrap();
        assert_eq!(arrivals.names.names(), ["can0"]);
    }
    arrivals.items
}

fn error(address: &str, bus: &str) -> String {
    match open(address, bus) {
        Ok(_) => panic!("it was opened"),
        Err(error) => format!("{error:#}"),
    }
}

#[test]
fn a_bus_is_opened_in_raw_mode_and_its_frames_have_the_servers_times() {
    let (script, address) = Script::new();
    let server = serve(move || {
        let mut peer = script.accept();
        peer.send("< hi >");
        peer.hears("< open can0 >");
        peer.send("< ok >");
        peer.hears("< rawmode >");
        // The first frame arrives together with the reply.
        peer.send("< ok >< frame 123 1700000000.123456 1122 >< frame 18FEF100 170000");
        peer.send("0001.000000  >< what >< error 004 1700000002.000000 >");
        peer.hears_the_end();
    });
    let mut source = open(&address, "can0").unwrap();
    let items = receive(&mut *source, 5);
    let Arrival::Notice(Notice::Link { bus: BusIndex(0), state: LinkState::Up, bit_rate: None, .. }) =
        items[0]
    else {
        panic!("{items:?}")
    };
    let frames: Vec<_> = items
        .iter()
        .filter_map(|item| match item {
            Arrival::Frame(frame) => Some(frame),
            Arrival::Notice(_) => None,
        })
        .collect();
    assert_eq!((frames[0].id, frames[0].data()), (CanId::Standard(0x123), &[0x11, 0x22][..]));
    assert_eq!(frames[0].time, Some(Timestamp(1_700_000_000_123_456_000)));
    assert_eq!(
        (frames[1].id, frames[1].time),
        (CanId::Extended(0x18FE_F100), Some(Timestamp(1_700_000_001_000_000_000)))
    );
    assert_eq!(frames[2].id, CanId::Extended(4));
    let Arrival::Notice(Notice::Unreadable { reason, .. }) = &items[3] else { panic!("{items:?}") };
    assert_eq!(reason, "socketcand: expected hi, ok, echo, frame, fdframe, rtr or error; found \"what\"");
    let status = source.bus_status().remove(0);
    assert_eq!(
        (status.name.as_str(), status.state, status.stamps),
        ("can0", LinkState::Up, SourceClock::Recorded)
    );
    // The protocol does not report the mode of the interface of the server.
    assert_eq!(status.mode, Some(ControllerMode::OfServer));
    drop(source);
    server.join().unwrap();
}

#[test]
fn a_connection_that_is_lost_comes_back_by_itself() {
    let (script, address) = Script::new();
    let server = serve(move || {
        let mut peer = script.hand_over();
        peer.send("< frame 001 1000000000.000000 >< frame 0");
        drop(peer);
        // The server is back, but its interface is missing.
        let mut peer = script.accept();
        peer.send("< hi >");
        peer.hears("< open can0 >");
        peer.send("< error could not open bus >");
        drop(peer);
        let mut peer = script.hand_over();
        peer.send("< frame 002 1000000005.000000 >");
        peer.hears_the_end();
    });
    let mut source = open(&address, "can0").unwrap();
    let mut items = receive(&mut *source, 3);
    // On the clock of the server, which is years slow: not before its last frame, and not much later.
    let Arrival::Notice(Notice::Link { time, state: LinkState::Gone, .. }) = items[2] else {
        panic!("{items:?}")
    };
    let since = u64::try_from(time.0 - 1_000_000_000_000_000_000).unwrap();
    assert!(Duration::from_nanos(since) < LIMIT, "{time}");
    assert_eq!(source.bus_status().remove(0).controller.as_deref(), Some("the server closed the connection"));
    items = receive(&mut *source, 2);
    let Arrival::Notice(Notice::Link { state: LinkState::Up, .. }) = items[0] else { panic!("{items:?}") };
    let Arrival::Frame(frame) = items[1] else { panic!("{items:?}") };
    assert_eq!((frame.id, frame.data()), (CanId::Standard(2), &[][..]));
    drop(source);
    server.join().unwrap();
}

#[test]
fn the_error_of_the_server_for_a_wrong_bus_is_reported() {
    let (script, address) = Script::new();
    let server = serve(move || {
        let mut peer = script.accept();
        peer.send("< hi >");
        peer.hears("< open can7 >");
        peer.send("< error could not open bus >");
        peer.hears_the_end();
    });
    let expected = format!("{address}: < open can7 >: server reports \"could not open bus\"");
    assert_eq!(error(&address, "can7"), expected);
    server.join().unwrap();
}

#[test]
fn another_kind_of_server_is_recognised() {
    let (script, address) = Script::new();
    let server = serve(move || {
        let mut peer = script.accept();
        peer.send("SSH-2.0-OpenSSH_9.2 <\r\n");
        peer.hears_the_end();
    });
    let expected = "not a socketcand server: socketcand: expected nothing between elements; found \"SSH-2.0-OpenSSH_9.2\"";
    assert_eq!(error(&address, "can0"), format!("{address}: {expected}"));
    server.join().unwrap();
    // A server that does not respond.
    let (script, address) = Script::new();
    let server = serve(move || script.accept().hears_the_end());
    assert!(error(&address, "can0").ends_with("no response within 3 s; is this a socketcand server?"));
    server.join().unwrap();
}

#[test]
fn a_missing_server_and_an_invalid_name_are_reported() {
    let (script, address) = Script::new();
    drop(script);
    let text = error(&address, "can0");
    assert!(text.starts_with(&format!("{address}: cannot connect: ")), "{text}");
    let text = error("localhost", "can0 >< send 123 0");
    assert!(
        text.starts_with("\"can0 >< send 123 0\" is not a valid bus name; expected 1 to 15 characters"),
        "{text}"
    );
}

#[test]
fn a_silent_server_is_asked_and_a_mute_one_is_gone() {
    let (script, address) = Script::new();
    let server = serve(move || {
        let mut peer = script.hand_over();
        peer.hears("< echo >");
        peer.send("< echo >");
        peer.hears("< echo >");
        // An unplugged cable: no more data, and the connection stays open.
        peer.hears_the_end();
    });
    let patience = SilenceLimits { quiet: Duration::from_millis(300), dead: Duration::from_secs(1) };
    let mut source = open_with(&address, "can0", patience).unwrap();
    let items = receive(&mut *source, 2);
    let Arrival::Notice(Notice::Link { state: LinkState::Gone, .. }) = items[1] else { panic!("{items:?}") };
    let status = source.bus_status().remove(0);
    assert_eq!(status.controller.as_deref(), Some("the server no longer responds"));
    server.join().unwrap();
}

#[test]
fn waiting_takes_as_long_as_it_may_and_no_longer_than_until_something_comes() {
    let (script, address) = Script::new();
    let (go, gone) = std::sync::mpsc::channel();
    let server = serve(move || {
        let mut peer = script.hand_over();
        gone.recv().unwrap();
        peer.send("< frame 001 1.000000 >");
        peer.hears_the_end();
    });
    let mut source = open(&address, "can0").unwrap();
    receive(&mut *source, 1);
    let (begin, mut arrivals) = (Instant::now(), Arrivals::default());
    source.receive_items(&mut arrivals, Duration::from_millis(120)).unwrap();
    assert!(arrivals.items.is_empty() && begin.elapsed() >= Duration::from_millis(120));
    source.receive_items(&mut arrivals, Duration::ZERO).unwrap();
    assert!(arrivals.items.is_empty());
    go.send(()).unwrap();
    let begin = Instant::now();
    source.receive_items(&mut arrivals, LIMIT).unwrap();
    assert!(arrivals.items.len() == 1 && begin.elapsed() < LIMIT);
    drop(source);
    server.join().unwrap();
}

#[test]
fn addresses_have_the_usual_port_unless_they_say_another() {
    for (address, expected) in [
        ("machine", "machine:29536"),
        ("machine:1234", "machine:1234"),
        ("10.0.0.1", "10.0.0.1:29536"),
        ("::1", "[::1]:29536"),
        ("[::1]", "[::1]:29536"),
        ("[::1]:1234", "[::1]:1234"),
        ("machine:port", "machine:port:29536"),
    ] {
        assert_eq!(with_port(address), expected);
    }
}
