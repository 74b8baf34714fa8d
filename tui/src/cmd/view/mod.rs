//! `cobscope view`: the terminal UI for captures.

mod against;
mod arguments;
mod page_writer;

use std::io::IsTerminal as _;
use std::path::Path;
use std::sync::Arc;
use std::sync::mpsc::{Receiver, Sender, channel};

use anyhow::{Context as _, ensure};

use crate::app::{App, Compare, ViewSettings, quote_word};
use crate::exit_code::ExitStatus;
use crate::run::input::{
    build_setup, capture_paths, check_rules_of, join_options, missing_parts, named_buses, read_options,
    session_options,
};
use crate::run::messages::print_error;
use crate::run::screen::{ScreenSettings, reassign, remember_settings};
use crate::source::CaptureFile;
use crate::terminal::{self, LoopMessage, TerminalScreen};
use crate::timeline::{Timeline, TimelineCaptures, TimelineNews};
pub use arguments::ViewArgs;
use page_writer::page_writer;

/// Runs the command.
pub fn run(arguments: &ViewArgs) -> ExitStatus {
    if !std::io::stdout().is_terminal() {
        print_error(&anyhow::anyhow!("stdout is not a terminal; for text output use decode"));
        return ExitStatus::Usage;
    }
    let settings = match ScreenSettings::of_user(&arguments.screen, arguments.color) {
        Ok(settings) => settings,
        Err(error) => {
            print_error(&error);
            return ExitStatus::Usage;
        }
    };
    let captures = match captures_of(arguments) {
        Ok(captures) => captures,
        Err(error) => {
            print_error(&error);
            return ExitStatus::Profile;
        }
    };
    match show_view(arguments, captures, &settings) {
        Ok(()) => ExitStatus::Clean,
        Err(error) => {
            print_error(&error);
            ExitStatus::Capture
        }
    }
}

/// Note on further parts of the capture in its folder, for the status line.
fn parts_note(arguments: &ViewArgs, captures: &TimelineCaptures) -> Option<String> {
    missing_parts(&CaptureFile::files_named(&captures.paths), &arguments.input)
}

fn captures_of(arguments: &ViewArgs) -> anyhow::Result<TimelineCaptures> {
    let session = session_options(&arguments.input)?;
    let rules = Arc::new(build_setup(&arguments.input, &session.catalogue, None)?);
    check_rules_of(arguments.filter.as_ref(), &rules)?;
    let paths = capture_paths(&arguments.input);
    Ok(TimelineCaptures {
        paths,
        align: arguments.align,
        join: join_options(&arguments.input),
        read: read_options(&arguments.input),
        session,
        rules,
        live: None,
    })
}

/// Creates the application without a terminal, and the receiver for results of its background threads.
///
/// # Errors
/// As for the command: invalid profiles or bus file, captures that cannot be opened.
pub fn open_view(arguments: &ViewArgs, words: &[String]) -> anyhow::Result<(App, Receiver<TimelineNews>)> {
    let command = command_line("view", words.iter().cloned());
    let (news, found) = channel();
    let captures = captures_of(arguments)?;
    let settings = ScreenSettings::of_options(&arguments.screen, arguments.color);
    let start = view_settings(arguments, &settings, command, (&captures, &news))?;
    let parts = parts_note(arguments, &captures);
    let timeline = Timeline::open(captures, news)?;
    let mut app = App::new(timeline, settings.theme, start);
    if let Some(text) = &parts {
        app.show_message(text);
    }
    Ok((app, found))
}

fn show_view(
    arguments: &ViewArgs,
    captures: TimelineCaptures,
    settings: &ScreenSettings,
) -> anyhow::Result<()> {
    let (messages, inbox) = channel();
    let (news, found) = channel();
    let command = command_line("view", std::env::args().skip(1));
    let start = view_settings(arguments, settings, command, (&captures, &news))?;
    let parts = parts_note(arguments, &captures);
    let timeline = Timeline::open(captures, news)?;
    ensure_keys(arguments)?;
    forward_news(found, messages.clone())?;
    let mut app = App::new(timeline, settings.theme, start);
    if let Some(text) = &parts {
        app.show_message(text);
    }
    let mut screen = TerminalScreen::enter_screen()?;
    terminal::start_threads(messages, settings.may_answer)?;
    terminal::run_loop(&mut app, &mut screen, &inbox)?;
    drop(screen);
    remember_settings(&app, settings)
}

/// The comparison with another capture, if one is requested.
///
/// # Errors
/// If that capture is missing, or the captures of the view are several ones.
fn start_comparison(
    arguments: &ViewArgs,
    captures: &TimelineCaptures,
    news: &Sender<TimelineNews>,
) -> anyhow::Result<Option<(String, Compare)>> {
    let Some(good) = &arguments.against else { return Ok(None) };
    let job = against::job(good, &arguments.input, &captures.session)?;
    Ok(Some((file_name(good), against::comparer(job, news.clone()))))
}

/// Forwards results of the background threads to the application.
///
/// # Errors
/// If the thread cannot be started.
pub(super) fn forward_news(
    found: Receiver<TimelineNews>,
    messages: Sender<LoopMessage>,
) -> anyhow::Result<()> {
    let run = move || {
        for news in found {
            if messages.send(LoopMessage::News(news)).is_err() {
                return;
            }
        }
    };
    std::thread::Builder::new().name("news".into()).spawn(run).context("cannot start a thread")?;
    Ok(())
}

/// Checks that stdin is a terminal, unless it is a capture; in that case keys are read from `/dev/tty`.
fn ensure_keys(arguments: &ViewArgs) -> anyhow::Result<()> {
    let is_piped = capture_paths(&arguments.input).iter().any(|path| path.as_os_str() == "-");
    ensure!(is_piped || std::io::stdin().is_terminal(), "stdin is not a terminal; keys cannot be read");
    Ok(())
}

/// # Errors
/// As for [`start_comparison`].
fn view_settings(
    arguments: &ViewArgs,
    settings: &ScreenSettings,
    command: String,
    (captures, news): (&TimelineCaptures, &Sender<TimelineNews>),
) -> anyhow::Result<ViewSettings> {
    Ok(ViewSettings {
        command,
        pane: settings.pane,
        preferences: settings.preferences.clone(),
        defaults: settings.defaults.clone(),
        keymap: settings.keymap.clone(),
        reassign: reassign(&arguments.input),
        write_report: page_writer(&arguments.input, &captures.rules, news),
        at: arguments.at,
        filter: arguments.filter.clone().map(|filter| (filter.to_string(), filter)),
        all: arguments.all,
        follows: false,
        named: named_buses(&arguments.input, &captures.session),
        against: start_comparison(arguments, captures, news)?,
    })
}

fn file_name(path: &Path) -> String {
    path.file_name().map_or_else(|| path.display().to_string(), |name| name.to_string_lossy().into_owned())
}

/// The command line without the options whose state the view adds itself.
pub fn command_line(name: &str, given: impl Iterator<Item = String>) -> String {
    let mut words = vec!["cobscope".to_owned(), name.to_owned()];
    let mut given = given.peekable();
    given.next_if(|word| word == name);
    while let Some(word) = given.next() {
        let own = ["--pane", "--layout", "--at", "--filter"];
        if own.contains(&word.as_str()) {
            given.next();
        } else if word != "--all" && !own.iter().any(|name| word.starts_with(&format!("{name}="))) {
            words.push(quote_word(&word));
        }
    }
    words.join(" ")
}
