//! Buses that are connected by a serial adapter, a server or text.

use std::fs::{OpenOptions, read_link};
use std::io::{Read as _, Write as _};
use std::os::fd::{AsFd as _, AsRawFd as _};
use std::path::Path;
use std::process::{Command, Stdio};
use std::sync::{Arc, Mutex};
use std::thread;

use pty_process::blocking::{Pts, Pty, open};

use crate::harness::{HELLO, Program, greet, in_guest, ip, run, send, wait_until};
use crate::pair::{parse, read};
use crate::server::Server;

/// A pseudo-terminal in place of a serial port.
struct Port {
    pty: Arc<Pty>,
    /// The other end, kept open, because reading ends when it is closed.
    _pts: Pts,
    name: String,
}

impl Port {
    fn open() -> Self {
        let (pty, pts) = open().unwrap();
        let descriptor = pts.as_fd().as_raw_fd();
        let name = read_link(format!("/proc/self/fd/{descriptor}")).unwrap().to_str().unwrap().to_owned();
        raw(&name);
        Self { pty: Arc::new(pty), _pts: pts, name }
    }
}

/// Sets raw mode: no echo, no line editing.
fn raw(terminal: &str) {
    run("stty", &["-F", terminal, "raw", "-echo"]);
}

/// Bytes that the program wrote to its port.
type Written = Arc<Mutex<Vec<u8>>>;

/// Passes commands of the program to an adapter and stores them.
fn listen(port: &Port, mut take: impl FnMut(&[u8]) + Send + 'static) -> Written {
    let (pty, written) = (Arc::clone(&port.pty), Written::default());
    let shared = Arc::clone(&written);
    thread::spawn(move || {
        let mut piece = [0; 256];
        while let Ok(count @ 1..) = (&*pty).read(&mut piece) {
            shared.lock().unwrap().extend_from_slice(&piece[..count]);
            take(&piece[..count]);
        }
    });
    written
}

/// Asserts that the program opened the adapter in listen mode and sent no frame.
fn assert_listened_only(written: &Written) {
    let text = String::from_utf8(written.lock().unwrap().clone()).unwrap();
    let commands: Vec<_> = text.split('\r').collect();
    assert!(commands.contains(&"L"), "{commands:?}");
    // Open for sending; standard, extended, remote and FD frames.
    let sends = |command: &&&str| command.starts_with(['O', 't', 'T', 'r', 'R', 'd', 'D', 'b', 'B']);
    assert_eq!(commands.iter().find(sends), None, "{commands:?}");
}

/// Frames with the lengths and kinds that slcan supports.
const CLASSIC: [&str; 6] =
    ["123#", "7FF#0011223344556677", "00000123#AB", "1FFFFFFE#0102030405060708", "321#R", "12345678#R3"];

/// Frames of an adapter in a capture, without greetings.
fn recorded(path: &Path) -> Vec<String> {
    let frames = read(path).into_iter().map(|recorded| recorded.frame);
    frames.filter(|frame| !frame.starts_with(HELLO)).collect()
}

/// The adapter of can-utils, on vcan0. It has no listen-only mode, so it gets the command to open instead.
#[test]
fn frames_come_through_the_adapter_that_slcanpty_is() {
    if !in_guest() {
        return;
    }
    // It ends at input or at the end of its standard input, so a shell pipe without any output keeps it open.
    let script = "sleep 9999 | exec stdbuf -oL slcanpty /dev/ptmx vcan0";
    let adapter = Program::start(Command::new("sh").args(["-c", script]));
    let is_open = |line: &str| line.contains("slave pseudo-terminal is");
    let opened = adapter.wait_line("name of a terminal", is_open);
    let terminal = opened.rsplit(' ').next().unwrap();
    // Opened before any other program opens and closes it, because that would end the adapter.
    let mut to = OpenOptions::new().read(true).write(true).open(terminal).unwrap();
    let mut from = to.try_clone().unwrap();
    raw(terminal);

    let port = Port::open();
    let written = listen(&port, move |bytes| {
        let changed: Vec<_> = bytes.iter().map(|byte| if *byte == b'L' { b'O' } else { *byte }).collect();
        to.write_all(&changed).unwrap();
    });
    let pty = Arc::clone(&port.pty);
    thread::spawn(move || {
        let mut piece = [0; 256];
        while let Ok(count @ 1..) = from.read(&mut piece) {
            (&*pty).write_all(&piece[..count]).unwrap();
        }
    });
    let folder = tempfile::tempdir().unwrap();
    let record = folder.path().join("slcan.log");
    let live = Program::live([&format!("slcan:{}@500000", port.name), "--record", record.to_str().unwrap()]);
    greet("vcan0", &[&live]);
    // It appends as many zeros to a remote frame as the frame requests, which is not valid slcan: reported as
    // unreadable.
    let (sound, unsound) = CLASSIC.split_at(CLASSIC.len() - 1);
    send("vcan0", sound);
    send("vcan0", unsound);
    let reported = live.wait_events("unreadable", |events| !events.is_empty());
    greet("vcan0", &[&live]);
    live.interrupt();
    assert_eq!(recorded(&record), sound);
    assert!(reported[0]["reason"].as_str().unwrap().contains("R123456783000000"), "{reported:?}");
    assert_listened_only(&written);
}

/// The kernel's slcan at the other end of the line, attached by slcand: its output is that of an adapter.
/// This test responds to commands, because the kernel does not.
#[test]
fn frames_come_from_the_kernels_slcan() {
    if !in_guest() {
        return;
    }
    let kernel = Port::open();
    let daemon = Program::start(Command::new("slcand").args(["-F", &kernel.name, "slcan0"]));
    let port = Port::open();
    let answer = Arc::clone(&port.pty);
    let written = listen(&port, move |bytes| {
        for byte in bytes {
            (&*answer).write_all(answer_to(*byte)).unwrap();
        }
    });
    let (pty, source) = (Arc::clone(&port.pty), Arc::clone(&kernel.pty));
    thread::spawn(move || {
        let (mut piece, mut line) = ([0; 256], Vec::new());
        while let Ok(count @ 1..) = (&*source).read(&mut piece) {
            for byte in &piece[..count] {
                line.push(*byte);
                if *byte == b'\r' {
                    // The kernel's own commands to an adapter are not forwarded.
                    if line[0].eq_ignore_ascii_case(&b't') || line[0].eq_ignore_ascii_case(&b'r') {
                        (&*pty).write_all(&line).unwrap();
                    }
                    line.clear();
                }
            }
        }
    });
    let folder = tempfile::tempdir().unwrap();
    let record = folder.path().join("slcan.log");
    wait_until("slcan0", || Path::new("/sys/class/net/slcan0").exists());
    ip("link set slcan0 up");
    let live = Program::live([&format!("slcan:{}@500000", port.name), "--record", record.to_str().unwrap()]);
    greet("slcan0", &[&live]);
    send("slcan0", &CLASSIC);
    greet("slcan0", &[&live]);
    live.interrupt();
    assert_eq!(recorded(&record), CLASSIC);
    assert_listened_only(&written);
    drop(daemon);
}

/// Response of an adapter after this byte of a command; it has no timestamps.
fn answer_to(byte: u8) -> &'static [u8] {
    match byte {
        b'V' => b"V1013",
        b'N' => b"N4242",
        b'F' => b"F00",
        b'Z' => b"\x07",
        b'\r' => b"\r",
        _ => b"",
    }
}

#[test]
fn frames_and_their_times_come_from_a_socketcand_server() {
    if !in_guest() {
        return;
    }
    let server = Server::start(0, "vcan0");
    let folder = tempfile::tempdir().unwrap();
    let record = folder.path().join("server.log");
    let live = Program::live([&server.source(), "--record", record.to_str().unwrap()]);
    let candump = Program::candump("vcan0");
    greet("vcan0", &[&live, &candump]);
    let sent = ["123#", "7FF#0011223344556677", "00000123#AB", "123##1112233"];
    send("vcan0", &sent);
    greet("vcan0", &[&live, &candump]);
    live.interrupt();
    let ours: Vec<_> = read(&record).into_iter().map(|recorded| (recorded.time, recorded.frame)).collect();
    let theirs = parse(&candump.lines().join("\n")).into_iter();
    let theirs: Vec<_> = theirs.map(|recorded| (recorded.time, recorded.frame)).collect();
    for frame in sent {
        let of = |all: &[(u64, String)]| all.iter().find(|(_, other)| other == frame).cloned();
        assert!(of(&ours).is_some(), "{frame} is not in {ours:?}");
        assert_eq!(of(&ours), of(&theirs));
    }
    assert_eq!(server.commands(), ["< open vcan0 >", "< rawmode >"]);
}

#[test]
fn a_server_that_returns_is_read_again() {
    if !in_guest() {
        return;
    }
    let server = Server::start(0, "vcan0");
    let port = server.port;
    let live = Program::live([&server.source()]);
    greet("vcan0", &[&live]);
    drop(server);
    live.wait_events("link", |events| events.iter().any(|event| event["state"] != "up"));
    let server = Server::start(port, "vcan0");
    greet("vcan0", &[&live]);
    let last = live.wait_events("link", |events| events.last().is_some_and(|event| event["state"] == "up"));
    assert!(last.len() >= 2, "{last:?}");
    live.interrupt();
    drop(server);
}

#[test]
fn text_of_candump_is_read_from_a_pipe() {
    if !in_guest() {
        return;
    }
    // Not a program of the harness, because its output is the input of the other program.
    let mut candump = Command::new("candump").args(["-L", "vcan0"]).stdout(Stdio::piped()).spawn().unwrap();
    let live = Program::live_on(candump.stdout.take().unwrap(), ["-"]);
    greet("vcan0", &[&live]);
    send("vcan0", &["13D#0102"]);
    live.wait_events("frame", |events| events.iter().any(|event| event["id"] == "13D"));
    candump.kill().unwrap();
    candump.wait().unwrap();
    // The program ends with the text.
    let ended = live.end();
    assert!(ended.status.success(), "{ended:?}");
}
