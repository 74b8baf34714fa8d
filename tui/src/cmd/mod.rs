//! The subcommands, one a file.

mod check;
mod convert;
mod databases;
mod decode;
mod describe;
mod device_files;
mod explain;
mod input;
mod live;
mod objects;
mod output;
mod print;
mod profile_markdown;
mod profile_page;
mod profiles;
mod rules;
mod shell;
mod stats;
mod view;
mod want;
mod why;

use std::io::{IsTerminal as _, Write as _};
use std::path::Path;
use std::sync::mpsc::Receiver;

use anyhow::Context as _;
use cobscope_decoder::capture::{Batch, BusNames, Item, Notice};
use cobscope_decoder::decoder::Decoder;
use cobscope_decoder::frame::Frame;
use cobscope_decoder::session::{Observer, SessionOptions};

use crate::app::App;
use crate::cli::{Cli, Color, Command, InputArgs};
use crate::exit_code::Exit;
use crate::source;
use crate::timeline::News;
use crate::words::unknown_bus;
use input::{captures, read_options, session_options, warn};
pub(crate) use rules::rule_sections;

/// Runs what the command line says.
pub fn run(cli: Cli) -> Exit {
    if cli.command.captures().is_some_and(<[_]>::is_empty) && std::io::stdin().is_terminal() {
        complain(&anyhow::anyhow!("no capture: name a file, or - to read what is typed here"));
        return Exit::Usage;
    }
    if let Err(error) = cli.command.check_nodes() {
        complain(&anyhow::Error::msg(error));
        return Exit::Usage;
    }
    match cli.command {
        Command::View(arguments) => view::run(&arguments),
        Command::Live(arguments) => live::run(&arguments),
        Command::Decode(arguments) => decode::run(&arguments),
        Command::Convert(arguments) => convert::run(&arguments),
        Command::Stats(arguments) => stats::run(&arguments),
        Command::Objects(arguments) => objects::run(&arguments),
        Command::Check(arguments) => check::run(&arguments),
        Command::Rules(arguments) => rules::run(&arguments),
        Command::Why(arguments) => why::run(&arguments),
        Command::Explain { thing, device, profiles } => explain::run(&thing, device.as_deref(), &profiles),
        Command::Profiles { command, profiles } => profiles::run(&command, &input::catalogue(&profiles)),
        Command::Completions { shell } => shell::completions(shell),
        Command::Man { of } => shell::man(of.as_deref()),
    }
}

/// The live command over datagrams.
///
/// # Errors
/// What the command itself would complain about.
#[cfg(all(target_os = "linux", feature = "socketcan"))]
pub fn live_over_datagrams(live: &crate::cli::LiveArgs, socket: std::net::UdpSocket) -> anyhow::Result<()> {
    live::over_datagrams(live, socket)
}

/// The terminal UI without a terminal.
///
/// # Errors
/// What the command itself would complain about.
pub fn open_view(view: &crate::cli::ViewArgs, words: &[String]) -> anyhow::Result<(App, Receiver<News>)> {
    view::open(view, view::command("view", words.iter().cloned()))
}

/// Tells the user what went wrong.
fn complain(error: &anyhow::Error) {
    let _ = writeln!(std::io::stderr(), "cobscope: {error:#}");
}

/// Something that looks at a capture's events and can have enough.
trait Watcher: Observer {
    /// Whether further events are in vain.
    fn is_done(&self) -> bool {
        false
    }

    /// Whether it prints to the terminal while events come.
    fn is_on_terminal(&self) -> bool {
        false
    }

    /// Whether another core may read meanwhile: it is not if others judge their captures on it.
    fn has_another_core(&self) -> bool {
        true
    }

    /// The first frame of a capture, before any event of it.
    ///
    /// # Errors
    /// When what was asked for cannot be told of such a capture.
    fn begin(&mut self, _first: &Frame) -> anyhow::Result<()> {
        Ok(())
    }

    /// Whether [`Watcher::frame`] wants each frame.
    fn wants_frames(&self) -> bool {
        false
    }

    /// A frame, before its events; `false` ends the capture before it.
    fn frame(&mut self, _frame: &Frame, _names: &BusNames) -> bool {
        true
    }

    /// What else the capture tells, before its event.
    fn notice(&mut self, _notice: &Notice, _names: &BusNames) {}
}

/// A capture that was decoded as far as it could be read.
struct Decoded {
    /// The decoder behind the last frame.
    decoder: Decoder,
    /// Title of the capture's format.
    format: &'static str,
    /// Why reading ended early, if it did.
    failure: Option<anyhow::Error>,
    /// What else is to be said of it.
    warnings: Vec<String>,
    /// What of it could not be read.
    unreadable: Unreadable,
}

impl Decoded {
    /// Says what could not be read, where the output has no place for it.
    fn tell_unreadable(&self, path: &Path) {
        let Unreadable { count, first: Some(first) } = &self.unreadable else { return };
        let text = match count {
            1 => format!("{}: a line or record could not be read: {first}", path.display()),
            count => format!("{}: {count} lines or records could not be read, first {first}", path.display()),
        };
        warn(&text);
    }
}

/// Lines and records that could not be read.
#[derive(Default)]
struct Unreadable {
    count: u64,
    /// Place and reason of the first.
    first: Option<String>,
}

impl Unreadable {
    fn see(&mut self, notices: &[(usize, Notice)]) {
        for (_, notice) in notices.iter().filter(|(_, notice)| matches!(notice, Notice::Unreadable { .. })) {
            self.count += 1;
            self.first.get_or_insert_with(|| notice.to_string());
        }
    }
}

/// Decodes one capture into `watcher`, and says what there is to be said of it.
///
/// # Errors
/// When the capture cannot be opened or recognised, or holds no frame.
fn decode_capture(
    path: &Path,
    input: &InputArgs,
    options: &SessionOptions,
    watcher: &mut dyn Watcher,
) -> anyhow::Result<Decoded> {
    let decoded = decode_quietly(path, input, options, watcher)?;
    for warning in &decoded.warnings {
        let _ = writeln!(std::io::stderr(), "cobscope: {warning}");
    }
    Ok(decoded)
}

/// Decodes one capture into `watcher`.
///
/// # Errors
/// When the capture cannot be opened or recognised, or holds no frame.
fn decode_quietly(
    path: &Path,
    input: &InputArgs,
    options: &SessionOptions,
    watcher: &mut dyn Watcher,
) -> anyhow::Result<Decoded> {
    let name = || path.display().to_string();
    let (mut frames, mut progress) =
        source::open(path, &read_options(input))?.frames(watcher.has_another_core());
    if watcher.is_on_terminal() {
        progress.hide();
    }
    let mut decoder = Decoder::new(options.clone());
    let mut batch = Batch::new();
    let mut has_frames = false;
    let mut failure = None;
    let mut unreadable = Unreadable::default();
    while !watcher.is_done() {
        match frames.read(&mut batch) {
            Ok(true) => {}
            Ok(false) => break,
            Err(error) => {
                failure = Some(anyhow::Error::from(error).context(name()));
                break;
            }
        }
        if let Some(first) = batch.frames().first().filter(|_| !has_frames) {
            watcher.begin(first).with_context(name)?;
            has_frames = true;
        }
        unreadable.see(batch.notices());
        if !push_batch(&mut decoder, &batch, frames.buses(), watcher) {
            break;
        }
        // Who has enough before the end does not ask how the capture ends.
        if failure.is_none() && !watcher.is_done() {
            failure = cut_off(batch.notices()).map(|reason| anyhow::Error::msg(reason).context(name()));
        }
        progress.tick();
    }
    progress.finish();
    decoder.finish(frames.buses(), watcher);
    // Of a capture that was not read to its end not all buses are known.
    let warnings =
        if watcher.is_done() { Vec::new() } else { unknown_buses(path, input, options, frames.buses()) };
    match failure {
        Some(failure) if !has_frames => Err(failure),
        None if !has_frames => anyhow::bail!("{}: holds no frame", path.display()),
        failure => Ok(Decoded { decoder, format: frames.format().title, failure, warnings, unreadable }),
    }
}

/// Where and how the capture is cut off, if that is among what a reader says.
fn cut_off(notices: &[(usize, Notice)]) -> Option<String> {
    let is_cut = |notice: &Notice| matches!(notice, Notice::CutOff { .. });
    notices.iter().find(|(_, notice)| is_cut(notice)).map(|(_, notice)| notice.to_string())
}

/// Names of buses the user gave, and by what.
fn named_buses(input: &InputArgs, options: &SessionOptions) -> Vec<(String, &'static str)> {
    let of_file = options.bus_file.buses.iter().map(|(name, _)| (name, "the bus file"));
    let of_nodes = input.node.iter().filter_map(|node| Some((node.bus.as_ref()?, "--node")));
    let of_files = input.eds.iter().filter_map(|file| Some((file.node.bus.as_ref()?, "--eds")));
    let all = of_file.chain(of_nodes).chain(of_files);
    all.map(|(name, by)| (name.clone(), by)).collect()
}

/// What is said of buses that are named and that a capture does not have.
fn unknown_buses(path: &Path, input: &InputArgs, options: &SessionOptions, names: &BusNames) -> Vec<String> {
    let capture = path.display().to_string();
    let has: Vec<&str> = names.names().iter().map(String::as_str).collect();
    let wanted = named_buses(input, options);
    wanted.iter().filter_map(|(name, by)| unknown_bus(&capture, name, by, &has)).collect()
}

/// Whether output is coloured.
fn is_colored(color: Color, is_file: bool) -> bool {
    match color {
        Color::Always => true,
        Color::Never => false,
        Color::Auto => {
            let wanted = std::env::var_os("NO_COLOR").is_none_or(|value| value.is_empty());
            wanted && !is_file && std::io::stdout().is_terminal()
        }
    }
}

/// Passes a batch on; `false` when the watcher ends the capture within it.
fn push_batch(decoder: &mut Decoder, batch: &Batch, names: &BusNames, watcher: &mut dyn Watcher) -> bool {
    let wants_frames = watcher.wants_frames();
    if batch.notices().is_empty() {
        for frame in batch.frames() {
            if wants_frames && !watcher.frame(frame, names) {
                return false;
            }
            decoder.push(frame, names, watcher);
        }
        return true;
    }
    for item in batch.items() {
        match item {
            Item::Frame(frame) => {
                if wants_frames && !watcher.frame(frame, names) {
                    return false;
                }
                decoder.push(frame, names, watcher);
            }
            Item::Notice(notice) => {
                watcher.notice(notice, names);
                decoder.notice(notice, names, watcher);
            }
        }
    }
    true
}

/// Makes a report of each capture and prints them all; what could be read of a broken one counts too.
fn report(
    input: &InputArgs,
    mut one: impl FnMut(&Path, &SessionOptions, &mut String) -> anyhow::Result<Option<anyhow::Error>>,
) -> Exit {
    let options = match session_options(input) {
        Ok(options) => options,
        Err(error) => {
            complain(&error);
            return Exit::Profile;
        }
    };
    let mut exit = Exit::Clean;
    let mut text = String::new();
    for path in captures(input) {
        if let Some(error) = one(&path, &options, &mut text).unwrap_or_else(Some) {
            complain(&error);
            exit = exit.max(Exit::Capture);
        }
    }
    exit.max(output::print(text.as_bytes()))
}
