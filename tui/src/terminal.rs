//! The real terminal: keys in, screen out. Nothing here decides anything.

use std::io::{BufWriter, Stdout, Write as _, stdout};
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
use ratatui::crossterm::terminal::{
    EnterAlternateScreen, LeaveAlternateScreen, disable_raw_mode, enable_raw_mode,
};

use crate::app::{App, Output};
use crate::timeline::News;

/// How often the screen shows what the background has done while it works.
const REFRESH: Duration = Duration::from_millis(200);

/// How often the screen shows how live buses are while nothing comes of them.
const LOOK: Duration = Duration::from_secs(1);

/// Bytes of a whole screen's changes, which go to the terminal at once.
const OUTPUT: usize = 64 * 1024;

/// What wakes the application.
pub enum Message {
    /// The user did something.
    Input(Event),
    /// The background found something.
    News(News),
    /// The terminal is gone.
    Gone,
}

/// A terminal that is given back as it was, whatever happens.
pub struct Screen(Terminal<CrosstermBackend<BufWriter<Stdout>>>);

impl Screen {
    /// Takes the terminal over.
    ///
    /// # Errors
    /// When there is none.
    pub fn take() -> anyhow::Result<Self> {
        let hook = std::panic::take_hook();
        std::panic::set_hook(Box::new(move |info| {
            give_back();
            hook(info);
        }));
        enable_raw_mode().context("this is no terminal the UI can use")?;
        let output = BufWriter::with_capacity(OUTPUT, stdout());
        let terminal = Terminal::new(CrosstermBackend::new(output)).context("the terminal cannot be used")?;
        let screen = Self(terminal);
        execute!(stdout(), EnterAlternateScreen).context("the terminal cannot be written")?;
        execute!(stdout(), EnableMouseCapture, EnableBracketedPaste)
            .context("the terminal cannot be written")?;
        Ok(screen)
    }
}

impl Drop for Screen {
    fn drop(&mut self) {
        give_back();
    }
}

/// Ends what ratatui's own hook leaves on: mouse and paste reports.
fn give_back() {
    // A terminal that is gone needs nothing back.
    let _ = execute!(stdout(), DisableMouseCapture, DisableBracketedPaste, LeaveAlternateScreen, Show);
    let _ = disable_raw_mode();
}

/// Sends what the user does.
///
/// # Errors
/// When no thread can be started.
pub fn listen(messages: Sender<Message>) -> anyhow::Result<()> {
    let inputs = messages.clone();
    let listen = move || {
        loop {
            let message = event::read().map_or(Message::Gone, Message::Input);
            let is_gone = matches!(message, Message::Gone);
            if inputs.send(message).is_err() || is_gone {
                return;
            }
        }
    };
    #[cfg(unix)]
    mind_signals(messages)?;
    std::thread::Builder::new().name("input".into()).spawn(listen).context("no thread can be started")?;
    Ok(())
}

/// Being told to end, or losing the terminal, is leaving.
#[cfg(unix)]
fn mind_signals(messages: Sender<Message>) -> anyhow::Result<()> {
    use signal_hook::consts::{SIGHUP, SIGTERM};
    let mut signals =
        signal_hook::iterator::Signals::new([SIGHUP, SIGTERM]).context("signals cannot be minded")?;
    let mind = move || {
        if signals.forever().next().is_some() {
            // The application may be gone already.
            let _ = messages.send(Message::Gone);
        }
    };
    std::thread::Builder::new().name("signals".into()).spawn(mind).context("no thread can be started")?;
    Ok(())
}

/// Runs until the user leaves.
///
/// # Errors
/// When the terminal cannot be drawn on.
pub fn run(app: &mut App, screen: &mut Screen, messages: &Receiver<Message>) -> anyhow::Result<()> {
    let size = screen.0.size().context("the terminal has no size")?;
    app.resize(size.width, size.height);
    let mut is_new = true;
    loop {
        // What grew is drawn when the place that is followed is known.
        if is_new || !app.is_seeking() {
            screen.0.draw(|frame| app.draw(frame.area(), frame.buffer_mut())).context("drawing failed")?;
        }
        let Some(came) = wait(app, messages) else { return Ok(()) };
        is_new = came.is_empty() || came.iter().any(|message| !matches!(message, Message::News(News::Grew)));
        // Everything that came meanwhile is drawn once.
        for message in came.into_iter().chain(messages.try_iter()) {
            match message {
                Message::Input(event) => input(app, event),
                Message::News(news) => app.news(news),
                Message::Gone => return Ok(()),
            }
        }
        app.tick();
        for output in app.outputs() {
            match output {
                Output::Quit => return Ok(()),
                Output::Copy(text) => {
                    execute!(stdout(), CopyToClipboard::to_clipboard_from(text)).context("copying failed")?;
                    stdout().flush().context("copying failed")?;
                }
            }
        }
    }
}

/// Waits for a reason to draw again; nothing when there will be none. What grows steadily is drawn every [`REFRESH`],
/// what comes behind a pause at once, what the user does always.
fn wait(app: &App, messages: &Receiver<Message>) -> Option<Vec<Message>> {
    let drawn = Instant::now();
    let mut came = Vec::new();
    loop {
        let is_due = !came.is_empty() || app.is_busy();
        let patience = match is_due {
            true => REFRESH.saturating_sub(drawn.elapsed()),
            false if app.is_live() => LOOK,
            false => Duration::MAX,
        };
        match messages.recv_timeout(patience) {
            Ok(message) => {
                let can_wait = matches!(message, Message::News(News::Grew)) && drawn.elapsed() < REFRESH;
                came.push(message);
                if !can_wait {
                    return Some(came);
                }
            }
            Err(RecvTimeoutError::Timeout) => return Some(came),
            Err(RecvTimeoutError::Disconnected) => return None,
        }
    }
}

fn input(app: &mut App, event: Event) {
    match event {
        Event::Key(key) if key.kind != KeyEventKind::Release => app.key(key),
        Event::Mouse(mouse) => app.mouse(mouse),
        Event::Resize(width, height) => app.resize(width, height),
        Event::Paste(text) => app.paste(&text),
        _ => {}
    }
}

#[cfg(all(test, unix))]
mod tests {
    use std::io::Read as _;

    use pty_process::blocking::{Command, open};

    use super::*;

    /// Set for the process that panics.
    const CHILD: &str = "COBSCOPE_TEST_PANIC";

    /// Taken over and given back: alternate screen, mouse, bracketed paste, cursor.
    const GIVEN_BACK: [&str; 3] = ["\x1b[?1049l", "\x1b[?2004l", "\x1b[?25h"];

    #[test]
    fn a_panic_gives_the_terminal_back() {
        if std::env::var_os(CHILD).is_some() {
            let _screen = Screen::take().unwrap();
            panic!("on purpose");
        }
        let (mut pty, pts) = open().unwrap();
        let arguments = ["--exact", "terminal::tests::a_panic_gives_the_terminal_back", "--nocapture"];
        let command = Command::new(std::env::current_exe().unwrap()).args(arguments).env(CHILD, "1");
        let mut child = command.spawn(pts).unwrap();
        let mut written = Vec::new();
        // The end of the child is an error of its terminal.
        let _ = pty.read_to_end(&mut written);
        assert!(!child.wait().unwrap().success());
        let written = String::from_utf8_lossy(&written);
        let taken = written.find("\x1b[?1049h").expect("the alternate screen");
        let said = written.find("on purpose").expect("the panic's message");
        for sequence in GIVEN_BACK {
            let back = written.find(sequence).unwrap_or_else(|| panic!("no {sequence:?} in {written:?}"));
            assert!(taken < back && back < said, "the message is read on the screen there was before");
        }
    }
}
