//! The terminal: input events to the application, its screen to the output.

mod background;

use std::io::{BufWriter, ErrorKind, Stdout, Write as _, stdout};
use std::sync::mpsc::{Receiver, RecvTimeoutError, Sender};
use std::time::{Duration, Instant};

use anyhow::Context as _;
use ratatui::Terminal;
use ratatui::backend::CrosstermBackend;
use ratatui::crossterm::clipboard::CopyToClipboard;
use ratatui::crossterm::cursor::Show;
use ratatui::crossterm::event::{
    self, DisableBracketedPaste, DisableMouseCapture, EnableBracketedPaste, EnableMouseCapture, Event,
    KeyEventKind,
};
use ratatui::crossterm::execute;
use ratatui::crossterm::style::force_color_output;
use ratatui::crossterm::terminal::{
    EnterAlternateScreen, LeaveAlternateScreen, disable_raw_mode, enable_raw_mode,
};

pub use background::{BackgroundAnswer, ask_terminal as background};

use background::LateAnswer;

use crate::app::{App, TerminalRequest};
use crate::timeline::TimelineNews;

/// Minimum interval between screens while background threads report progress.
const REFRESH: Duration = Duration::from_millis(200);

/// Interval of screens of silent live buses.
const LOOK: Duration = Duration::from_secs(1);

/// Buffer for the changes of a whole screen, written at once.
const OUTPUT: usize = 64 * 1024;

/// A message to the main loop.
pub enum LoopMessage {
    /// Keyboard, mouse, paste or resize.
    Input(Event),
    /// Message of a background thread.
    News(TimelineNews),
    /// The terminal is gone.
    Gone,
}

/// The terminal in UI mode; dropping it restores the previous mode.
pub struct TerminalScreen(Terminal<CrosstermBackend<BufWriter<Stdout>>>);

impl TerminalScreen {
    /// Switches the terminal to UI mode.
    ///
    /// # Errors
    /// No usable terminal.
    pub fn enter_screen() -> anyhow::Result<Self> {
        let hook = std::panic::take_hook();
        std::panic::set_hook(Box::new(move |info| {
            give_back();
            hook(info);
        }));
        // The theme alone decides about colours: it knows NO_COLOR, --color and the key for colours. Otherwise
        // crossterm would drop colours, bold and underline under NO_COLOR.
        force_color_output(true);
        enable_raw_mode().context("the UI cannot use this terminal")?;
        let output = BufWriter::with_capacity(OUTPUT, stdout());
        let terminal = Terminal::new(CrosstermBackend::new(output)).context("cannot set up the terminal")?;
        let screen = Self(terminal);
        execute!(stdout(), EnterAlternateScreen).context("cannot write to the terminal")?;
        // Consoles without escape sequences, in old versions of Windows, refuse what they do not have.
        let _ = execute!(stdout(), EnableMouseCapture);
        let _ = execute!(stdout(), EnableBracketedPaste);
        Ok(screen)
    }
}

impl Drop for TerminalScreen {
    fn drop(&mut self) {
        give_back();
    }
}

/// Restores the terminal, including mouse and paste reports, which ratatui's own hook leaves on.
fn give_back() {
    // A terminal that no longer exists needs no restoring. On Windows a command fails if its setting was refused before;
    // the others must follow all the same.
    let _ = execute!(stdout(), DisableMouseCapture);
    let _ = execute!(stdout(), DisableBracketedPaste);
    let _ = execute!(stdout(), LeaveAlternateScreen, Show);
    let _ = disable_raw_mode();
}

/// Starts the threads for input and signals. `may_answer`: see [`BackgroundAnswer::may_come`].
///
/// # Errors
/// A thread or the signal handler cannot be started.
pub fn start_threads(messages: Sender<LoopMessage>, may_answer: bool) -> anyhow::Result<()> {
    let inputs = messages.clone();
    let mut late = LateAnswer::new(may_answer);
    let listen = move || {
        loop {
            let message = event::read().map_or(LoopMessage::Gone, LoopMessage::Input);
            if let LoopMessage::Input(Event::Key(key)) = &message
                && late.takes_key(key)
            {
                continue;
            }
            let is_gone = matches!(message, LoopMessage::Gone);
            if inputs.send(message).is_err() || is_gone {
                return;
            }
        }
    };
    #[cfg(unix)]
    mind_signals(messages)?;
    std::thread::Builder::new().name("input".into()).spawn(listen).context("cannot start a thread")?;
    Ok(())
}

/// Ends the program on SIGHUP, SIGINT and SIGTERM, so that the terminal is restored.
#[cfg(unix)]
fn mind_signals(messages: Sender<LoopMessage>) -> anyhow::Result<()> {
    use signal_hook::consts::{SIGHUP, SIGINT, SIGTERM};
    let mut signals = signal_hook::iterator::Signals::new([SIGHUP, SIGINT, SIGTERM])
        .context("cannot install the signal handler")?;
    let mind = move || {
        if signals.forever().next().is_some() {
            // The application may have ended already.
            let _ = messages.send(LoopMessage::Gone);
        }
    };
    std::thread::Builder::new().name("signals".into()).spawn(mind).context("cannot start a thread")?;
    Ok(())
}

/// Runs until the user quits.
///
/// # Errors
/// The terminal cannot be drawn on.
pub fn run_loop(
    app: &mut App,
    screen: &mut TerminalScreen,
    messages: &Receiver<LoopMessage>,
) -> anyhow::Result<()> {
    let size = screen.0.size().context("cannot read the terminal size")?;
    app.on_resize(size.width, size.height);
    let mut is_new = true;
    let mut followed: Option<Instant> = None;
    loop {
        // While following, growth is drawn together with the new cursor position.
        if is_new || !app.is_seeking() {
            screen
                .0
                .draw(|frame| app.draw(frame.area(), frame.buffer_mut()))
                .context("cannot draw the screen")?;
        }
        let Some(arrived) = wait_for_message(app, messages) else { return Ok(()) };
        is_new = arrived.is_empty()
            || arrived.iter().any(|message| !matches!(message, LoopMessage::News(TimelineNews::Grew)));
        // Messages received in the meantime are drawn together.
        for message in arrived.into_iter().chain(messages.try_iter()) {
            match message {
                LoopMessage::Input(event) => on_input(app, event),
                LoopMessage::News(news) => app.on_news(news),
                LoopMessage::Gone => return Ok(()),
            }
        }
        // Following moves the cursor at most once per REFRESH.
        if followed.is_none_or(|last| last.elapsed() >= REFRESH) {
            followed = Some(Instant::now());
            app.on_tick();
        }
        for output in app.take_outputs() {
            match output {
                TerminalRequest::Quit => return Ok(()),
                TerminalRequest::Copy(text) => {
                    let copied = execute!(stdout(), CopyToClipboard::to_clipboard_from(text));
                    if copied.as_ref().is_err_and(|error| error.kind() != ErrorKind::Unsupported) {
                        copied.context("cannot copy to the clipboard")?;
                    }
                    stdout().flush().context("cannot copy to the clipboard")?;
                }
            }
        }
    }
}

/// Waits for the next reason to draw; None after the end. Continuous progress is drawn every [`REFRESH`], the
/// first message after a pause and user input at once.
fn wait_for_message(app: &App, messages: &Receiver<LoopMessage>) -> Option<Vec<LoopMessage>> {
    let drawn = Instant::now();
    let mut arrived = Vec::new();
    loop {
        let is_due = !arrived.is_empty() || app.is_busy();
        let patience = match is_due {
            true => REFRESH.saturating_sub(drawn.elapsed()),
            false if app.is_live() => LOOK,
            false => Duration::MAX,
        };
        match messages.recv_timeout(patience) {
            Ok(message) => {
                let can_wait =
                    matches!(message, LoopMessage::News(TimelineNews::Grew)) && drawn.elapsed() < REFRESH;
                arrived.push(message);
                if !can_wait {
                    return Some(arrived);
                }
            }
            Err(RecvTimeoutError::Timeout) => return Some(arrived),
            Err(RecvTimeoutError::Disconnected) => return None,
        }
    }
}

fn on_input(app: &mut App, event: Event) {
    match event {
        Event::Key(key) if key.kind != KeyEventKind::Release => app.on_key(key),
        Event::Mouse(mouse) => app.on_mouse(mouse),
        Event::Resize(width, height) => app.on_resize(width, height),
        Event::Paste(text) => app.on_paste(&text),
        _ => {}
    }
}

#[cfg(all(test, unix))]
mod tests {
    use std::io::Read as _;

    use pty_process::blocking::{Command, open};

    use super::*;

    /// Environment variable of the child process that panics.
    const CHILD: &str = "COBSCOPE_TEST_PANIC";

    /// Escape sequences that restore the terminal: alternate screen, bracketed paste, cursor.
    const GIVEN_BACK: [&str; 3] = ["\x1b[?1049l", "\x1b[?2004l", "\x1b[?25h"];

    #[test]
    fn a_panic_gives_the_terminal_back() {
        if std::env::var_os(CHILD).is_some() {
            let _screen = TerminalScreen::enter_screen().unwrap();
            panic!("on purpose");
        }
        let (mut pty, pts) = open().unwrap();
        let arguments = ["--exact", "terminal::tests::a_panic_gives_the_terminal_back", "--nocapture"];
        let command = Command::new(std::env::current_exe().unwrap()).args(arguments).env(CHILD, "1");
        let mut child = command.spawn(pts).unwrap();
        let mut written = Vec::new();
        // The end of the child is reported as a read error.
        let _ = pty.read_to_end(&mut written);
        assert!(!child.wait().unwrap().success());
        let written = String::from_utf8_lossy(&written);
        let taken = written.find("\x1b[?1049h").expect("the alternate screen");
        let stated = written.find("on purpose").expect("the panic's message");
        for sequence in GIVEN_BACK {
            let back = written.find(sequence).unwrap_or_else(|| panic!("no {sequence:?} in {written:?}"));
            assert!(taken < back && back < stated, "the message is read on the screen there was before");
        }
    }
}
