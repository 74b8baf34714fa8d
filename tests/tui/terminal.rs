//! The program in a pseudo-terminal: its screen, and the state of the terminal after its end.
#![cfg(unix)]

use std::io::{Read as _, Write as _};
use std::num::NonZero;
use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::sync::{Arc, Condvar, Mutex};
use std::time::Duration;

use pty_process::Size;
use pty_process::blocking::{Command as PtyCommand, Pty, open};
use vt100::{MouseProtocolMode, Parser};

use crate::support::workspace;

/// Time limit for an expected condition on a busy machine.
const LIMIT: Duration = Duration::from_mins(1);

/// A home folder without files; nothing in these tests is remembered there.
const NO_HOME: &str = concat!(env!("CARGO_TARGET_TMPDIR"), "/no-home");

/// Output of the program so far.
#[derive(Default)]
struct ProgramOutput {
    parser: Parser,
    /// All bytes that the program wrote.
    written: Vec<u8>,
    has_ended: bool,
}

type Shared = Arc<(Mutex<ProgramOutput>, Condvar)>;

/// A program in a terminal.
pub struct Session {
    pty: Option<Arc<Pty>>,
    child: Child,
    seen: Shared,
}

impl Session {
    pub fn start(command: PtyCommand, rows: u16, columns: u16) -> Self {
        Self::start_at_home(command, rows, columns, Path::new(NO_HOME))
    }

    /// Starts a program for a user with this home folder.
    fn start_at_home(command: PtyCommand, rows: u16, columns: u16, home: &Path) -> Self {
        let (pty, pts) = open().unwrap();
        pty.resize(Size::new(rows, columns)).unwrap();
        let (config, state) = (home.join("config"), home.join("state"));
        let command = command.env("XDG_CONFIG_HOME", config).env("XDG_STATE_HOME", state);
        let child = command.env("TERM", "xterm-256color").spawn(pts).unwrap();
        let seen: Shared = Arc::default();
        seen.0.lock().unwrap().parser = Parser::new(size(rows), size(columns), 0);
        let pty = Arc::new(pty);
        let (source, sink) = (Arc::clone(&pty), Arc::clone(&seen));
        std::thread::spawn(move || {
            let mut piece = [0; 4096];
            // The end of the program is a read error of its terminal.
            while let Ok(count @ 1..) = (&*source).read(&mut piece) {
                let piece = piece.get(..count).unwrap();
                let mut seen = sink.0.lock().unwrap();
                seen.parser.process(piece);
                seen.written.extend_from_slice(piece);
                drop(seen);
                sink.1.notify_all();
            }
            sink.0.lock().unwrap().has_ended = true;
            sink.1.notify_all();
        });
        Self { pty: Some(pty), child, seen }
    }

    fn view(arguments: &[&str]) -> Self {
        let command = PtyCommand::new(env!("CARGO_BIN_EXE_cobscope"));
        let command = command.args(["view", "--at", "0"]).args(arguments);
        let command = command.current_dir(workspace());
        Self::start(command, 24, 80)
    }

    pub fn send(&self, keys: &str) {
        let mut pty = &**self.pty.as_ref().unwrap();
        pty.write_all(keys.as_bytes()).unwrap();
    }

    /// Waits until the screen meets a condition.
    pub fn wait(&self, what: &str, is_so: impl Fn(&str) -> bool) {
        self.wait_seen(what, |seen| is_so(&seen.parser.screen().contents()));
    }

    /// Waits until the whole capture is judged.
    pub fn wait_verdict(&self) {
        let is_judged = |header: &str| header.contains("FINDINGS") && !header.contains("warn …");
        let unready = ["state pending", "indexing", "reading"];
        let is_known = |screen: &str| unready.iter().all(|text| !screen.contains(text));
        self.wait("verdict", |screen| screen.lines().next().is_some_and(is_judged) && is_known(screen));
    }

    fn wait_seen(&self, what: &str, is_so: impl Fn(&ProgramOutput) -> bool) {
        let seen = self.seen.0.lock().unwrap();
        let (seen, timeout) = self.seen.1.wait_timeout_while(seen, LIMIT, |seen| !is_so(seen)).unwrap();
        assert!(!timeout.timed_out(), "no {what} on\n{}", seen.parser.screen().contents());
    }

    pub fn wait_text(&self, text: &str) {
        self.wait(text, |screen| screen.contains(text));
    }

    /// Waits for the end of the program, which must restore the terminal.
    pub fn wait_end(mut self) -> std::process::ExitStatus {
        self.wait_seen("end", |seen| seen.has_ended);
        let seen = self.seen.0.lock().unwrap();
        let screen = seen.parser.screen();
        assert!(!screen.alternate_screen(), "the screen before is back");
        assert!(!screen.bracketed_paste() && !screen.hide_cursor());
        assert_eq!(screen.mouse_protocol_mode(), MouseProtocolMode::None);
        drop(seen);
        self.child.wait().unwrap()
    }
}

fn size(lines: u16) -> NonZero<u16> {
    NonZero::new(lines).unwrap()
}

const PVE: &[&str] = &["--node", "32=danfoss-pve-ci", "fixtures/devices/pve.log"];

#[test]
fn start_filter_jump_and_quit() {
    let session = Session::view(PVE);
    session.wait_text("BOOT");
    session.send("fkind == emcy\r");
    session.wait_text("3 events shown");
    // The jumps are requested at once, whether the rules have finished or not.
    session.send(":#104\r]");
    session.wait_text("no further finding; the filter hides 12 (c clears it)");
    session.send("c]");
    session.wait_text("#105/190");
    session.send("q");
    assert!(session.wait_end().success());
}

#[test]
fn keys_typed_ahead_act_one_after_the_other() {
    let session = Session::view(PVE);
    session.wait_text("BOOT");
    // Findings after 7.3 s begin with frame 110, the last one is in frame 154; EMCY is in the rows of 3, 104 and 105.
    session.send(":7.3\r]");
    session.wait_text("#110/190");
    session.send("G[");
    session.wait_text("#154/190");
    session.send("g/EMCY\rnn");
    session.wait_text("#105/190");
    session.send("q");
    assert!(session.wait_end().success());
}

#[test]
fn a_line_is_copied_through_the_terminal() {
    let session = Session::view(PVE);
    session.wait_text("BOOT");
    session.send("]");
    session.wait_text("#104/190");
    session.wait_text("Kind");
    session.send("y");
    session.wait_text("copied");
    // OSC 52, in Base64: the start of "7.204 can0 0A0 32/20 EMCY 8305 …".
    let copied = b"\x1b]52;c;Ny4yMDQgY2FuMCAwQTAgMzIvMjAgRU1DWSA4MzA1";
    session.wait_seen("copied text", |seen| seen.written.windows(copied.len()).any(|part| part == copied));
    session.send("q");
    assert!(session.wait_end().success());
}

#[test]
fn another_size_is_used_at_once() {
    let session = Session::view(PVE);
    session.wait_text("BOOT");
    session.seen.0.lock().unwrap().parser.screen_mut().set_size(size(30), size(120));
    session.pty.as_ref().unwrap().resize(Size::new(30, 120)).unwrap();
    // The time in the header is right-aligned.
    session.wait_seen("header over the whole width", |seen| {
        let header = seen.parser.screen().contents_between(0, 100, 0, 120);
        header.trim_end().ends_with(" s")
            && seen.parser.screen().contents_between(29, 0, 29, 20).contains("? help")
    });
    session.send("q");
    assert!(session.wait_end().success());
}

/// A reader that waits for edges loses the key when it finds both at once.
#[test]
fn a_key_pressed_while_the_size_changes_is_not_lost() {
    let session = Session::view(PVE);
    session.wait_verdict();
    let panes = [("3", "--pane frames"), ("2", "--pane events")].into_iter().cycle().take(400);
    for (lines, (key, pane)) in [25, 24].into_iter().cycle().zip(panes) {
        session.seen.0.lock().unwrap().parser.screen_mut().set_size(size(lines), size(80));
        session.pty.as_ref().unwrap().resize(Size::new(lines, 80)).unwrap();
        session.send(key);
        session.wait_text(pane);
    }
    session.send("q");
    assert!(session.wait_end().success());
}

#[test]
fn a_terminated_program_restores_the_terminal() {
    for signal in ["-TERM", "-INT"] {
        let session = Session::view(PVE);
        session.wait_text("BOOT");
        let id = session.child.id().to_string();
        assert!(Command::new("kill").args([signal, &id]).status().unwrap().success());
        session.wait_end();
    }
}

#[test]
fn a_terminal_that_is_gone_ends_the_program() {
    let mut session = Session::view(PVE);
    session.wait_text("BOOT");
    let id = session.child.id().to_string();
    // sshd sends this signal when the connection breaks.
    assert!(Command::new("kill").args(["-HUP", &id]).status().unwrap().success());
    session.pty = None;
    session.child.wait().unwrap();
}

#[test]
fn a_capture_from_a_pipe_leaves_the_keys_to_the_terminal() {
    let program = env!("CARGO_BIN_EXE_cobscope");
    let script = format!("cat fixtures/devices/pve.log | {program} view --at 0 --node 32=danfoss-pve-ci -");
    let session =
        Session::start(PtyCommand::new("sh").args(["-c", &script]).current_dir(workspace()), 24, 80);
    session.wait_text("BOOT");
    session.send("G");
    session.wait_text("#190/190");
    session.send("q");
    assert!(session.wait_end().success());
}

#[test]
fn without_a_terminal_it_says_what_to_use_instead() {
    let output = Command::new(env!("CARGO_BIN_EXE_cobscope"))
        .args(["view", "fixtures/devices/pve.log"])
        .current_dir(workspace())
        .stdin(Stdio::null())
        .output()
        .unwrap();
    assert_eq!(output.status.code(), Some(2));
    let text = String::from_utf8(output.stderr).unwrap();
    assert_eq!(text, "cobscope: stdout is not a terminal; for text output use decode\n");
}

#[test]
fn an_unreadable_capture_is_reported_before_the_screen_opens() {
    let session = Session::view(&["no-such-file.log"]);
    session.wait_text("no-such-file.log: cannot be opened");
    assert_eq!(session.wait_end().code(), Some(3));
}

/// A session with its home folder.
fn at_home(home: &Path, options: &[&str]) -> Session {
    let command = PtyCommand::new(env!("CARGO_BIN_EXE_cobscope"));
    let command = command.arg("view").args(options).args(PVE).current_dir(workspace());
    Session::start_at_home(command, 40, 140, home)
}

#[test]
fn a_layout_is_remembered_until_it_is_discarded() {
    let home = tempfile::tempdir().unwrap();
    let memory = home.path().join("state/cobscope/view.toml");
    let quit = |session: Session| {
        session.send("q");
        assert!(session.wait_end().success());
    };
    let session = at_home(home.path(), &[]);
    session.wait_text("0 Why ──");
    quit(session);
    assert!(!memory.exists(), "nothing was changed");
    let session = at_home(home.path(), &[]);
    session.wait_verdict();
    session.send("|");
    session.wait_text("layout list");
    quit(session);
    assert!(std::fs::read_to_string(&memory).unwrap().contains("layout = \"list\""));
    let session = at_home(home.path(), &[]);
    session.wait_text("--layout list");
    quit(session);
    // An option overrides the remembered value, and is not remembered itself.
    let session = at_home(home.path(), &["--layout", "signals"]);
    session.wait_text("5 Signals ──");
    quit(session);
    let session = at_home(home.path(), &[]);
    session.wait_text("--layout list");
    session.send("\u{12}");
    session.wait_text("are discarded");
    session.wait_text("0 Why ──");
    quit(session);
    assert!(!memory.exists());
}

#[test]
fn a_layout_of_the_command_line_or_the_config_file_is_not_remembered() {
    let home = tempfile::tempdir().unwrap();
    let memory = home.path().join("state/cobscope/view.toml");
    let folder = home.path().join("config/cobscope");
    std::fs::create_dir_all(&folder).unwrap();
    std::fs::write(folder.join("config.toml"), "split = 40\n[columns]\nframes = [\"ID\"]\n").unwrap();
    let session = at_home(home.path(), &["--layout", "one"]);
    session.wait_verdict();
    session.send("i");
    session.wait("screen without strip", |screen| !screen.contains("0 to"));
    session.send("q");
    assert!(session.wait_end().success());
    let remembered = std::fs::read_to_string(&memory).unwrap();
    assert!(remembered.ends_with("discards it.\nstrip = false\n"), "{remembered}");
}

/// crossterm drops colours and other attributes under NO_COLOR unless the program decides.
#[test]
fn no_color_removes_colours_unless_an_option_or_a_key_asks_for_them() {
    let start = |options: &[&str]| {
        let command = PtyCommand::new(env!("CARGO_BIN_EXE_cobscope")).arg("view").args(options);
        let session = Session::start(command.args(PVE).current_dir(workspace()).env("NO_COLOR", "1"), 24, 80);
        session.wait_verdict();
        session
    };
    let has = |session: &Session, sequence: &[u8]| {
        let seen = session.seen.0.lock().unwrap();
        seen.written.windows(sequence.len()).any(|part| part == sequence)
    };
    let (colour, bold) = (b"38;5;", b"\x1b[1m");
    let always = start(&["--color", "always"]);
    assert!(has(&always, colour) && has(&always, bold));
    let plain = start(&[]);
    assert!(!has(&plain, colour) && has(&plain, bold));
    plain.send("T");
    plain.wait_seen("colours", |seen| seen.written.windows(5).any(|part| part == colour));
    for session in [always, plain] {
        session.send("q");
        assert!(session.wait_end().success());
    }
}

#[test]
fn the_config_file_decides_keys_and_layout() {
    let home = tempfile::tempdir().unwrap();
    let folder = home.path().join("config/cobscope");
    std::fs::create_dir_all(&folder).unwrap();
    let file = folder.join("config.toml");
    std::fs::write(&file, "layout = \"one\"\nascii = true\n[keys]\npane-bus = \"B\"\n").unwrap();
    let session = at_home(home.path(), &[]);
    session.wait_verdict();
    session.send("B");
    session.wait_text("wiring");
    session.send("q");
    assert!(session.wait_end().success());
    std::fs::write(&file, "layout = \"two\"\n").unwrap();
    let session = at_home(home.path(), &[]);
    session.wait_text("config.toml:1:10: layout = \"two\": expected one, diagnose, list, signals");
    assert_eq!(session.wait_end().code(), Some(2));
}

#[test]
fn the_terminal_decides_between_dark_and_light() {
    let home = tempfile::tempdir().unwrap();
    let header = |session: &Session| {
        session.wait_verdict();
        let colour = |cell: &vt100::Cell| (cell.fgcolor(), cell.bgcolor());
        let seen = session.seen.0.lock().unwrap();
        let mut colours: Vec<_> =
            (0..140).filter_map(|x| seen.parser.screen().cell(0, x).map(colour)).collect();
        // Numbers in the header may still grow: only the order of the colours is equal.
        colours.dedup();
        colours
    };
    let ends = |session: Session| {
        session.send("q");
        assert!(session.wait_end().success());
    };
    let light = at_home(home.path(), &["--theme", "light"]);
    let expected = header(&light);
    ends(light);
    let dark = at_home(home.path(), &["--theme", "dark"]);
    assert_ne!(header(&dark), expected);
    ends(dark);
    let asked = at_home(home.path(), &[]);
    asked.wait_seen("question", |seen| seen.written.windows(5).any(|bytes| bytes == b"\x1b]11;"));
    asked.send("\x1b]11;rgb:ffff/ffff/ffff\x07\x1b[?62;c");
    assert_eq!(header(&asked), expected);
    ends(asked);
}
