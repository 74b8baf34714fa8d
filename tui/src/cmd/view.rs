//! `cobscope view`: the terminal UI for captures.

use std::io::IsTerminal as _;
use std::path::Path;
use std::sync::Arc;
use std::sync::mpsc::{Receiver, Sender, channel};

use anyhow::{Context as _, ensure};

use super::against;
use super::input::{
    captures, check_rules_of, join_options, named_buses, read_options, session_options, setup,
};
use super::messages::complain;
use super::page_writer::page_writer;
use super::reassign::reassign;
use super::screen_settings::{ScreenSettings, remember};
use crate::app::{App, Compare, Start, quoted};
use crate::cli::ViewArgs;
use crate::exit_code::Exit;
use crate::terminal::{self, Message, Screen};
use crate::timeline::{Captures, News, Timeline};

/// Runs the command.
pub fn run(arguments: &ViewArgs) -> Exit {
    if !std::io::stdout().is_terminal() {
        complain(&anyhow::anyhow!("stdout is not a terminal; for text output use decode"));
        return Exit::Usage;
    }
    let settings = match ScreenSettings::of_user(&arguments.screen, arguments.color) {
        Ok(settings) => settings,
        Err(error) => {
            complain(&error);
            return Exit::Usage;
        }
    };
    let captures = match captures_of(arguments) {
        Ok(captures) => captures,
        Err(error) => {
            complain(&error);
            return Exit::Profile;
        }
    };
    match show(arguments, captures, &settings) {
        Ok(()) => Exit::Clean,
        Err(error) => {
            complain(&error);
            Exit::Capture
        }
    }
}

fn captures_of(arguments: &ViewArgs) -> anyhow::Result<Captures> {
    let session = session_options(&arguments.input)?;
    let rules = Arc::new(setup(&arguments.input, &session.catalogue, None)?);
    check_rules_of(arguments.filter.as_ref(), &rules)?;
    let paths = captures(&arguments.input);
    Ok(Captures {
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
pub fn open(arguments: &ViewArgs, words: &[String]) -> anyhow::Result<(App, Receiver<News>)> {
    let command = command("view", words.iter().cloned());
    let (news, found) = channel();
    let captures = captures_of(arguments)?;
    let settings = ScreenSettings::of_options(&arguments.screen, arguments.color);
    let start = start(arguments, &settings, command, (&captures, &news))?;
    let timeline = Timeline::open(captures, news)?;
    Ok((App::new(timeline, settings.theme, start), found))
}

fn show(arguments: &ViewArgs, captures: Captures, settings: &ScreenSettings) -> anyhow::Result<()> {
    let (messages, inbox) = channel();
    let (news, found) = channel();
    let command = command("view", std::env::args().skip(1));
    let start = start(arguments, settings, command, (&captures, &news))?;
    let timeline = Timeline::open(captures, news)?;
    ensure_keys(arguments)?;
    forward(found, messages.clone())?;
    let mut app = App::new(timeline, settings.theme, start);
    let mut screen = Screen::take()?;
    terminal::listen(messages, settings.may_answer)?;
    terminal::run(&mut app, &mut screen, &inbox)?;
    drop(screen);
    remember(&app, settings)
}

/// The comparison with another capture, if one is requested.
///
/// # Errors
/// If that capture is missing, or the captures of the view are several ones.
fn comparison(
    arguments: &ViewArgs,
    captures: &Captures,
    news: &Sender<News>,
) -> anyhow::Result<Option<(String, Compare)>> {
    let Some(good) = &arguments.against else { return Ok(None) };
    let job = against::job(good, &arguments.input, &captures.session)?;
    Ok(Some((file_name(good), against::comparer(job, news.clone()))))
}

/// Forwards results of the background threads to the application.
///
/// # Errors
/// If the thread cannot be started.
pub(super) fn forward(found: Receiver<News>, messages: Sender<Message>) -> anyhow::Result<()> {
    let run = move || {
        for news in found {
            if messages.send(Message::News(news)).is_err() {
                return;
            }
        }
    };
    std::thread::Builder::new().name("news".into()).spawn(run).context("cannot start a thread")?;
    Ok(())
}

/// Checks that stdin is a terminal, unless it is a capture; in that case keys are read from `/dev/tty`.
fn ensure_keys(arguments: &ViewArgs) -> anyhow::Result<()> {
    let is_piped = captures(&arguments.input).iter().any(|path| path.as_os_str() == "-");
    ensure!(is_piped || std::io::stdin().is_terminal(), "stdin is not a terminal; keys cannot be read");
    Ok(())
}

/// # Errors
/// As for [`comparison`].
fn start(
    arguments: &ViewArgs,
    settings: &ScreenSettings,
    command: String,
    (captures, news): (&Captures, &Sender<News>),
) -> anyhow::Result<Start> {
    Ok(Start {
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
        against: comparison(arguments, captures, news)?,
    })
}

fn file_name(path: &Path) -> String {
    path.file_name().map_or_else(|| path.display().to_string(), |name| name.to_string_lossy().into_owned())
}

/// The command line without the options whose state the view adds itself.
pub fn command(name: &str, given: impl Iterator<Item = String>) -> String {
    let mut words = vec!["cobscope".to_owned(), name.to_owned()];
    let mut given = given.peekable();
    given.next_if(|word| word == name);
    while let Some(word) = given.next() {
        let own = ["--pane", "--layout", "--at", "--filter"];
        if own.contains(&word.as_str()) {
            given.next();
        } else if word != "--all" && !own.iter().any(|name| word.starts_with(&format!("{name}="))) {
            words.push(quoted(&word));
        }
    }
    words.join(" ")
}
