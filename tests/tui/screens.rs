//! Screens of the terminal UI: each file of `screens/` is a session with its command, keys, clicks and
//! screens.
//!
//! ```text
//! > cobscope view --node 32=danfoss-pve-ci fixtures/devices/pve.log
//! > size 100x30
//! > keys ]
//!   …the screen after these keys…
//! ▶ …a selected line…
//! ```
//!
//! Without colours (`--color never`), a selected line is reversed, which `▶` marks. A screen omits its second line if
//! this is the row of all pane titles, so that a new pane does not change every file. `COBSCOPE_BLESS=1` writes the
//! screens; review them before you commit them.

use std::fmt::Write as _;
use std::fs;
use std::path::Path;
use std::sync::mpsc::Receiver;

use cobscope::action::Action;
use cobscope::app::App;
use cobscope::ascii;
use cobscope::panes::PaneId;
use cobscope::timeline::TimelineNews;
use ratatui::Terminal;
use ratatui::backend::TestBackend;
use ratatui::crossterm::event::{KeyModifiers, MouseButton, MouseEvent, MouseEventKind};
use ratatui::style::Modifier;

use crate::docs::is_blessing;
use crate::support::{corpus, skip, step, workspace};

/// Min columns of a selected line; the cursor of a prompt has fewer.
const LEAST_SELECTED: usize = 10;

/// Max bytes of a capture for `look_through`.
const LARGEST: u64 = 60_000;

/// Usual step between files for `look_through`; odd, because captures often alternate with their expected events.
const STEP: usize = 7;

/// The application on a screen of fixed size.
pub struct Screen {
    app: App,
    news: Receiver<TimelineNews>,
    terminal: Terminal<TestBackend>,
}

impl Screen {
    /// `command` names files relative to the root of the workspace.
    pub fn open(command: &str, width: u16, height: u16) -> Self {
        // Screens contain paths, which may be cut: they must not depend on the folder of the workspace.
        std::env::set_current_dir(workspace()).unwrap();
        let words = shell_words(command.strip_prefix("cobscope ").unwrap());
        let (mut app, news) = cobscope::open_view(&words).unwrap();
        app.on_resize(width, height);
        let terminal = Terminal::new(TestBackend::new(width, height)).unwrap();
        let mut screen = Self { app, news, terminal };
        screen.settle();
        screen
    }

    /// Waits until the background threads have no more news.
    fn settle(&mut self) {
        loop {
            while let Ok(news) = self.news.try_recv() {
                self.app.on_news(news);
            }
            if !self.app.is_busy() {
                return;
            }
            self.app.on_news(self.news.recv().unwrap());
        }
    }

    pub fn keys(&mut self, keys: &str) {
        for key in cobscope::keymap::parse_sequence(keys).unwrap() {
            self.app.on_key(key);
            self.settle();
        }
    }

    /// Whether the program ends after the keys so far.
    pub fn quits(&mut self) -> bool {
        self.app.take_outputs().iter().any(|output| matches!(output, cobscope::app::TerminalRequest::Quit))
    }

    fn act(&mut self, action: Action) {
        self.app.perform_action(action);
        self.settle();
    }

    /// Presses or drags the mouse at `column,line`, both from 0.
    fn mouse(&mut self, kind: MouseEventKind, place: &str) {
        let (column, row) = place.split_once(',').unwrap();
        let (column, row) = (column.parse().unwrap(), row.parse().unwrap());
        self.app.on_mouse(MouseEvent { kind, column, row, modifiers: KeyModifiers::NONE });
        self.settle();
    }

    pub fn text(&mut self) -> String {
        self.terminal.draw(|frame| self.app.draw(frame.area(), frame.buffer_mut())).unwrap();
        let buffer = self.terminal.backend().buffer();
        let mut text = String::new();
        for y in 0..buffer.area.height {
            let cells: Vec<_> = (0..buffer.area.width).filter_map(|x| buffer.cell((x, y))).collect();
            let line: String = cells.iter().map(|cell| cell.symbol()).collect();
            let reversed = cells.iter().filter(|cell| cell.modifier.contains(Modifier::REVERSED)).count();
            let mark = if y > 1 && reversed >= LEAST_SELECTED { "▶ " } else { "  " };
            text += format!("{mark}{line}").trim_end();
            text.push('\n');
        }
        text
    }

    /// The screen for a session file: without the row of all pane titles.
    fn picture(&mut self) -> String {
        let titles = tab_bar();
        let text = self.text();
        let lines = text.split_inclusive('\n').enumerate();
        lines.filter(|(y, line)| *y != 1 || line.trim_end() != titles).map(|(_, line)| line).collect()
    }
}

/// The row of all pane titles on a screen that is wide enough for it.
pub fn tab_bar() -> String {
    let titles = PaneId::ALL.iter().map(|pane| format!(" {} {} ", *pane as usize, pane.title()));
    let titles: Vec<_> = titles.collect();
    format!("  {}", titles.concat()).trim_end().to_owned()
}

/// Words of a shell command with single quotes.
fn shell_words(text: &str) -> Vec<String> {
    let mut words = vec![String::new()];
    let mut is_quoted = false;
    for letter in text.chars() {
        match letter {
            '\'' => is_quoted = !is_quoted,
            ' ' if !is_quoted => words.push(String::new()),
            _ => words.last_mut().unwrap().push(letter),
        }
    }
    words
}

/// Plays a session; returns it with the present screens.
fn play(session: &str) -> String {
    let (mut command, mut size) = (String::new(), (80, 24));
    let mut screen: Option<Screen> = None;
    let mut played = String::new();
    for line in session.lines() {
        if line.starts_with('#') {
            writeln!(played, "{line}").unwrap();
        }
        let Some(order) = line.strip_prefix("> ") else { continue };
        writeln!(played, "{line}").unwrap();
        match order.split_once(' ').unwrap_or((order, "")) {
            ("cobscope", _) => (command, screen) = (order.to_owned(), None),
            ("size", wanted) => {
                let (width, height) = wanted.split_once('x').unwrap();
                size = (width.parse().unwrap(), height.parse().unwrap());
                if let Some(screen) = &mut screen {
                    screen.app.on_resize(size.0, size.1);
                    screen.terminal = Terminal::new(TestBackend::new(size.0, size.1)).unwrap();
                    screen.settle();
                    played += &screen.picture();
                }
            }
            ("keys", keys) => {
                let screen = screen.get_or_insert_with(|| Screen::open(&command, size.0, size.1));
                screen.keys(keys);
                played += &screen.picture();
            }
            (mouse @ ("click" | "drag"), place) => {
                let screen = screen.get_or_insert_with(|| Screen::open(&command, size.0, size.1));
                let kind = match mouse {
                    "click" => MouseEventKind::Down(MouseButton::Left),
                    _ => MouseEventKind::Drag(MouseButton::Left),
                };
                screen.mouse(kind, place);
                played += &screen.picture();
            }
            (other, _) => unreachable!("{other}: expected cobscope, size, keys, click or drag"),
        }
    }
    played
}

#[test]
fn every_session_shows_the_content_of_its_file() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../tests/tui/screens");
    let mut paths: Vec<_> = fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path()).collect();
    paths.sort();
    let mut wrong = String::new();
    for path in paths {
        let expected = fs::read_to_string(&path).unwrap();
        let seen = play(&expected);
        if seen == expected {
            continue;
        }
        if is_blessing() {
            fs::write(&path, seen).unwrap();
            continue;
        }
        writeln!(wrong, "{}:", path.display()).unwrap();
        let lines = expected.lines().zip(seen.lines()).enumerate();
        for (number, (expected, seen)) in lines.filter(|(_, (expected, seen))| expected != seen).take(12) {
            writeln!(wrong, "  line {}\n    expected {expected}\n    seen     {seen}", number + 1).unwrap();
        }
    }
    assert!(wrong.is_empty(), "\n{wrong}");
}

/// Sessions with `--ascii`: also the text of captures is ASCII.
#[test]
fn every_session_is_ascii_on_request() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../tests/tui/screens");
    for entry in fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        let session = fs::read_to_string(&path).unwrap();
        let seen =
            play(&session.replace(" --ascii", "").replace("> cobscope view", "> cobscope view --ascii"));
        // Dots of curves are drawn differently, and characters of captures may have no substitute.
        let is_of_capture = |letter: char| matches!(letter, '\u{2800}'..='\u{28FF}' | '\u{FFFD}' | '▶');
        let is_ui = |letter: &char| !letter.is_ascii() && !is_of_capture(*letter);
        let unknown = session
            .chars()
            .filter(is_ui)
            .find(|letter| ascii::ascii_substitute(letter.encode_utf8(&mut [0; 4])) == "?");
        assert_eq!(unknown, None, "{}", path.display());
        let screens = seen.lines().filter(|line| !line.starts_with(['>', '#']));
        let other: Vec<_> = screens.filter(|line| !line.trim_start_matches('▶').is_ascii()).collect();
        assert!(other.is_empty(), "{}:\n{}", path.display(), other.join("\n"));
    }
}

/// Session files omit this row.
#[test]
fn the_second_row_shows_the_titles_of_all_panes() {
    let mut screen = Screen::open("cobscope view --color never fixtures/devices/pve.log", 100, 24);
    let titles = "   0 Why  1 Nodes  2 Events  3 Frames  4 Detail  5 Signals  6 Transfers  7 Objects  8 Findings  9 Bus";
    assert_eq!(screen.text().lines().nth(1), Some(titles));
    assert_eq!(tab_bar(), titles);
    assert!(!screen.picture().contains(titles));
}

/// The file name of a session starts with the name of its pane.
#[test]
fn every_pane_has_a_session() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../tests/tui/screens");
    let names: Vec<_> = fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().file_name()).collect();
    let has_session =
        |pane: &&PaneId| names.iter().any(|name| name.to_str().unwrap().starts_with(pane.name()));
    let missing: Vec<_> = PaneId::ALL.iter().filter(|pane| !has_session(pane)).collect();
    assert!(missing.is_empty(), "{missing:?}: no file in tests/tui/screens");
}

/// Files in and below a folder, up to a size.
fn files(folder: &Path, largest: u64, found: &mut Vec<std::path::PathBuf>) {
    for entry in fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        if path.is_dir() {
            files(&path, largest, found);
        } else if path.metadata().unwrap().len() <= largest {
            found.push(path);
        }
    }
}

/// Shows all panes in two sizes, at the first finding and at the end; returns the number of captures.
fn look_through(folder: &Path) -> usize {
    let mut paths = Vec::new();
    files(folder, LARGEST, &mut paths);
    paths.sort();
    let mut looked = 0;
    for path in paths.into_iter().step_by(step(STEP)) {
        let words = ["view", "--color", "never", &path.display().to_string()].map(str::to_owned);
        // Other files than captures are skipped.
        let Ok((app, news)) = cobscope::open_view(&words) else { continue };
        looked += 1;
        let mut screen = Screen { app, news, terminal: Terminal::new(TestBackend::new(80, 24)).unwrap() };
        for (width, height) in [(100, 30), (20, 5)] {
            screen.app.on_resize(width, height);
            screen.terminal = Terminal::new(TestBackend::new(width, height)).unwrap();
            for keys in ["]", "vG"] {
                screen.keys(keys);
                for (_, pane) in PaneId::ALL.iter().zip(1..) {
                    screen.act(Action::Pane(pane));
                    assert!(!screen.text().contains('\u{1b}'), "{}", path.display());
                    screen.keys("<down><enter><esc>");
                }
            }
        }
    }
    looked
}

#[test]
fn every_fixture_can_be_looked_at() {
    assert!(look_through(&workspace().join("fixtures")) > 150 / step(STEP));
}

#[test]
fn every_small_recording_of_the_corpus_can_be_looked_at() {
    let corpus = corpus();
    if !corpus.is_dir() {
        return skip("corpus", "not there");
    }
    assert!(look_through(&corpus) > 20 / step(STEP));
}

#[test]
fn a_key_assigns_the_profile_that_the_behaviour_suggests() {
    let mut screen = Screen::open(
        "cobscope view --layout one --color never --pane nodes --at 70.0 fixtures/devices/sydfec.log",
        140,
        24,
    );
    // An empty EMCY at its start, TPDO1 of five bytes: the first node is the SYDFEC.
    assert!(screen.text().contains("behaves like SYDFEC: a assigns rexroth-sydfec"), "{}", screen.text());
    screen.keys("a");
    assert!(screen.text().contains("profile, EDS or DBC rexroth-sydfec"), "{}", screen.text());
    screen.keys("<enter>");
    let text = screen.text();
    assert!(text.contains("decoded again with --node 2=rexroth-sydfec"), "{text}");
    assert!(text.contains("SYDFEC (rexroth-sydfec, by option)"), "{text}");
    // The command that opens this view has the option, once.
    screen.keys("arexroth-vpcd<enter>j");
    let text = screen.text();
    assert!(text.contains("--node 2=rexroth-vpcd") && !text.contains("2=rexroth-sydfec"), "{text}");
}

#[test]
fn a_wrong_assignment_is_reported_in_the_prompt() {
    let mut screen = Screen::open(
        "cobscope view --layout one --color never --pane nodes fixtures/rules/node-lost.log",
        140,
        24,
    );
    screen.keys("j");
    for (typed, reported) in [
        ("rexroth-sydfek", "did you mean 'rexroth-sydfec'?"),
        ("none.eds", "none.eds: cannot be read"),
        ("Cargo.dbc", "Cargo.dbc: cannot be read"),
    ] {
        screen.keys(&format!("a{typed}<enter>"));
        assert!(screen.text().contains(reported), "{}", screen.text());
        screen.keys("<esc>");
    }
    assert!(!screen.text().contains("decoded again"), "{}", screen.text());
}

#[test]
fn a_preview_that_arrives_late_does_not_move_the_cursor() {
    let command = "cobscope view --color never --at 7.21 fixtures/devices/pve.log";
    let mut screen = Screen::open(command, 100, 24);
    // The second digit is typed before the preview of the first one arrives.
    for key in cobscope::keymap::parse_sequence(":22").unwrap() {
        screen.app.on_key(key);
    }
    let mut is_late = false;
    while !is_late {
        let news = screen.news.recv().unwrap();
        is_late = matches!(news, TimelineNews::Window(_));
        screen.app.on_news(news);
    }
    screen.keys("<esc>");
    assert!(screen.text().contains("--at '#105'"), "{}", screen.text());
}

#[test]
fn a_named_node_without_frames_is_reported() {
    let mut screen = Screen::open(
        "cobscope view --layout one --color never --node 99=rexroth-sydfec --node 2=rexroth-sydfec fixtures/devices/sydfec.log",
        140,
        24,
    );
    let text = screen.text();
    assert!(text.contains("sydfec.log: node 99/63 sent no frame; nodes present: 2/02"), "{text}");
}

#[test]
fn a_comparison_needs_two_captures_that_can_be_read_twice() {
    let clean = "fixtures/stories/danfoss-pve-ci/clean-run.log";
    let error = |words: &str| {
        std::env::set_current_dir(workspace()).unwrap();
        let words = shell_words(&format!("view {words}"));
        cobscope::open_view(&words).err().map(|error| format!("{error:#}")).unwrap_or_default()
    };
    let cases = [
        ("--against none.log fixtures/devices/pve.log", "--against none.log: cannot be opened: No such file"),
        ("--against CLEAN -", "--against reads a capture twice; stdin cannot be read again, open a file"),
        (
            "--against CLEAN fixtures/devices/pve.log fixtures/devices/md2.log",
            "--against compares one capture; found 2",
        ),
    ];
    for (words, expected) in cases {
        let found = error(&words.replace("CLEAN", clean));
        assert!(found.starts_with(expected), "{words}: {found}");
    }
}

#[test]
fn a_capture_that_cannot_be_compared_is_reported() {
    let folder = tempfile::tempdir().unwrap();
    let empty = folder.path().join("empty.log");
    fs::write(&empty, "").unwrap();
    let command = format!("cobscope view --against {} fixtures/devices/pve.log", empty.display());
    let text = Screen::open(&command, 140, 24).text();
    assert!(text.contains("AGAINST empty.log failed"), "{text}");
    assert!(text.contains("--against: "), "{text}");
}

#[test]
fn a_capture_equals_itself() {
    let pve = "fixtures/devices/pve.log";
    let command = format!("cobscope view --node 32=danfoss-pve-ci:pvea --against {pve} {pve}");
    let text = Screen::open(&command, 140, 40).text();
    assert!(text.contains("AGAINST pve.log equal") && !text.contains('≠'), "{text}");
}

#[test]
fn a_comparison_is_repeated_with_an_assigned_profile() {
    let folder = "fixtures/stories/danfoss-pve-ci";
    let command = format!(
        "cobscope view --layout one --pane nodes --against {folder}/clean-run.log {folder}/enable-in-fault-hold.log"
    );
    let mut screen = Screen::open(&command, 140, 40);
    // As `cobscope diff` without and with the profile.
    let before = screen.text();
    assert!(before.contains("AGAINST clean-run.log ≠1"), "{before}");
    screen.keys("jjjadanfoss-pve-ci:pvea<enter>");
    let after = screen.text();
    assert!(after.contains("decoded again with --node 32=danfoss-pve-ci:pvea"), "{after}");
    assert!(after.contains("AGAINST clean-run.log ≠3"), "{after}");
}
