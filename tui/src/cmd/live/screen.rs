//! Live buses in the terminal UI.

use std::io::{BufWriter, IsTerminal as _};
use std::sync::Arc;
use std::sync::mpsc::{Receiver, channel};
use std::thread::JoinHandle;

use anyhow::{Context as _, ensure};
use cobscope_decoder::capture::{FrameWriter, WRITABLE, WriteOptions};
use cobscope_decoder::frame::BusIndex;
use cobscope_decoder::series::JoinOptions;

use super::arguments::LiveArgs;
use super::pump::{PendingDeliveries, ReadingThread};
use super::sources::{open, recorder};
use crate::app::{App, ViewSettings};
use crate::cmd::view::{command_line, forward_news};
use crate::exit_code::ExitStatus;
use crate::record::RecordStatus;
use crate::run::input::{build_setup, read_options, session_options};
use crate::run::messages::{Refusal, print_note};
use crate::run::screen::{ScreenSettings, reassign, remember_settings};
use crate::source::live::{Arrival, SourceSpec};
use crate::source::{DecompressedBytes, StoreWriter};
use crate::terminal::{self, TerminalScreen};
use crate::timeline::{LiveBuses, Timeline, TimelineCaptures};

/// Buffer size of the store, in bytes.
const PIECE: usize = 64 * 1024;

/// Format of the store; it can contain all frames and notices.
const FORMAT: &str = "pcapng";

/// Shows live buses until the user quits.
pub(super) fn run(arguments: &LiveArgs, specs: Vec<SourceSpec>) -> Result<ExitStatus, Refusal> {
    let ready = session_options(&arguments.input).and_then(|session| {
        let rules = Arc::new(build_setup(&arguments.input, &session.catalogue, None)?);
        Ok((session, rules))
    });
    let (session, rules) = ready.map_err(|error| (ExitStatus::Profile, error))?;
    let settings = ScreenSettings::of_user(&arguments.screen, arguments.lines.color)
        .map_err(|error| (ExitStatus::Usage, error))?;
    let has_stdin = specs.contains(&SourceSpec::Stdin);
    let sources = open(arguments, specs).map_err(|error| (ExitStatus::Capture, error))?;
    let recorder = recorder(arguments).map_err(|error| (ExitStatus::Usage, error))?;
    let (pump, inbox) = ReadingThread::start(sources, recorder, arguments.frames_wanted)
        .map_err(|error| (ExitStatus::Capture, error))?;
    let (store, writer) = DecompressedBytes::for_live("live".into(), arguments.keep)
        .map_err(|error| (ExitStatus::Capture, error))?;
    let spool = spool(inbox, writer).map_err(|error| (ExitStatus::Capture, error))?;
    let live = Some(LiveBuses { store, state: pump.state.clone() });
    let read = read_options(&arguments.input);
    let captures = TimelineCaptures {
        paths: Vec::new(),
        align: false,
        join: JoinOptions::OFF,
        read,
        session,
        rules,
        live,
    };
    let shown = show(arguments, captures, &settings, has_stdin);
    let outcome = pump.finish();
    // The spool ends when the pump ends.
    let _ = spool.join();
    let is_incomplete = outcome.as_ref().is_some_and(RecordStatus::is_incomplete);
    if let Some(outcome) = outcome {
        for text in std::iter::once(format!("recorded {outcome}")).chain(outcome.remark_texts()) {
            print_note(&text);
        }
    }
    let exit = if is_incomplete { ExitStatus::Capture } else { ExitStatus::Clean };
    shown.map(|()| exit).map_err(|error| (ExitStatus::Capture, error))
}

fn show(
    arguments: &LiveArgs,
    captures: TimelineCaptures,
    settings: &ScreenSettings,
    has_stdin: bool,
) -> anyhow::Result<()> {
    ensure!(has_stdin || std::io::stdin().is_terminal(), "stdin is not a terminal; keys cannot be read");
    let (messages, inbox) = channel();
    let (news, found) = channel();
    let timeline = Timeline::open(captures, news)?;
    forward_news(found, messages.clone())?;
    let filter = arguments.select.filter.clone();
    let start = ViewSettings {
        command: command_line("live", std::env::args().skip(1)),
        pane: settings.pane,
        preferences: settings.preferences.clone(),
        defaults: settings.defaults.clone(),
        keymap: settings.keymap.clone(),
        reassign: reassign(&arguments.input),
        write_report: Box::new(|_, _| {
            anyhow::bail!("a report needs a file; open the recorded capture with view")
        }),
        at: None,
        filter: filter.map(|filter| (filter.to_string(), filter)),
        all: arguments.lines.all,
        follows: true,
        // Buses can appear at any time.
        named: Vec::new(),
        against: None,
    };
    let mut app = App::new(timeline, settings.theme, start);
    let mut screen = TerminalScreen::enter_screen()?;
    terminal::start_threads(messages, settings.may_answer)?;
    terminal::run_loop(&mut app, &mut screen, &inbox)?;
    drop(screen);
    remember_settings(&app, settings)
}

/// Writes received items to the store.
fn spool(inbox: Receiver<PendingDeliveries>, store: StoreWriter) -> anyhow::Result<JoinHandle<()>> {
    let format = WRITABLE.iter().find(|format| format.name == FORMAT).context("no format for the store")?;
    let thread = std::thread::Builder::new().name("spool".into());
    let written = store.store();
    let mut writer =
        (format.writer)(Box::new(BufWriter::with_capacity(PIECE, store)), &WriteOptions::default());
    writer.flush().context("cannot write the temporary file")?;
    let run = move || {
        let mut failure = None;
        for PendingDeliveries { names, items } in inbox {
            if let Err(error) = write(&mut *writer, names.names(), &items) {
                failure = Some(format!("cannot write the temporary file: {error}"));
                break;
            }
        }
        written.end_input(failure);
    };
    thread.spawn(run).context("cannot start a thread")
}

fn write(writer: &mut dyn FrameWriter, names: &[String], items: &[Arrival]) -> std::io::Result<()> {
    let name = |bus: BusIndex| names.get(usize::from(bus.0)).map_or("", String::as_str);
    for item in items {
        match item {
            Arrival::Frame(frame) => writer.write(frame, name(frame.bus))?,
            Arrival::Notice(notice) => {
                writer.notice(notice, name(notice.bus()))?;
            }
        }
    }
    writer.flush()
}
