//! Buses that are reached through a serial adapter, a server or text.

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
    /// Its other end, kept open: without one reading ends.
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

/// Bytes as they are: no echo, no lines.
fn raw(terminal: &str) {
    run("stty", &["-F", terminal, "raw", "-echo"]);
}

/// What the program wrote to its port.
type Written = Arc<Mutex<Vec<u8>>>;

/// Gives commands of the program to an adapter, piece by piece, and notes them.
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

/// The program opened the adapter to listen, and sent nothing that puts a frame on the bus.
fn assert_listened_only(written: &Written) {
    let text = String::from_utf8(written.lock().unwrap().clone()).unwrap();
    let commands: Vec<_> = text.split('\r').collect();
    assert!(commands.contains(&"L"), "{commands:?}");
    // Opened for sending; standard, extended, remote and FD frames.
    let sends = |command: &&&str| command.starts_with(['O', 't', 'T', 'r', 'R', 'd', 'D', 'b', 'B']);
    assert_eq!(commands.iter().find(sends), None, "{commands:?}");
}

/// Frames with the lengths and kinds that slcan knows.
const CLASSIC: [&str; 6] =
    ["123#", "7FF#0011223344556677", "00000123#AB", "1FFFFFFE#0102030405060708", "321#R", "12345678#R3"];

/// What an adapter told after a greeting, without greetings.
fn recorded(path: &Path) -> Vec<String> {
    let frames = read(path).into_iter().map(|recorded| recorded.frame);
    frames.filter(|frame| !frame.starts_with(HELLO)).collect()
}

/// can-utils' own adapter, whose bus is vcan0. It has no listen-only mode, so it is told to open instead.
#[test]
fn frames_come_through_the_adapter_that_slcanpty_is() {
    if !in_guest() {
        return;
    }
    // It ends when something comes on its standard input, the end too; so it has a shell with a pipe nobody writes.
    let script = "sleep 9999 | exec stdbuf -oL slcanpty /dev/ptmx vcan0";
    let adapter = Program::start(Command::new("sh").args(["-c", script]));
    let is_open = |line: &str| line.contains("slave pseudo-terminal is");
    let opened = adapter.wait_line("name of a terminal", is_open);
    let terminal = opened.rsplit(' ').next().unwrap();
    // Opened before anything else opens and closes it: that would end the adapter.
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
    // It writes as many zeros behind a remote frame as that asks for, which is no slcan: told, not guessed at.
    let (sound, unsound) = CLASSIC.split_at(CLASSIC.len() - 1);
    send("vcan0", sound);
    send("vcan0", unsound);
    let told = live.wait_events("unreadable", |events| !events.is_empty());
    greet("vcan0", &[&live]);
    live.interrupt();
    assert_eq!(recorded(&record), sound);
    assert!(told[0]["reason"].as_str().unwrap().contains("R123456783000000"), "{told:?}");
    assert_listened_only(&written);
}

/// The kernel's slcan at the other end of the line, attached by slcand: what it sends is what an adapter tells. The
/// answers to commands, which it has none of, are given here.
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
                    // Its own commands to an adapter are not for the program.
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

/// An adapter's answer after this byte of a command: it has no time stamps.
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
fn a_server_that_went_away_and_came_back_is_heard_again() {
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
    // Not one of the harness's programs: its lines are the other's input.
    let mut candump = Command::new("candump").args(["-L", "vcan0"]).stdout(Stdio::piped()).spawn().unwrap();
    let live = Program::live_on(candump.stdout.take().unwrap(), ["-"]);
    greet("vcan0", &[&live]);
    send("vcan0", &["13D#0102"]);
    live.wait_events("frame", |events| events.iter().any(|event| event["id"] == "13D"));
    candump.kill().unwrap();
    candump.wait().unwrap();
    // The end of the text is the end.
    let ended = live.end();
    assert!(ended.status.success(), "{ended:?}");
}
