//! The subcommands, one a file.

mod decode;
mod explain;
mod objects;
mod shell;
mod stats;

use std::io::Write as _;
use std::path::{Path, PathBuf};

use anyhow::Context as _;
use cobscope_decoder::bus_file::BusFile;
use cobscope_decoder::capture::{Batch, BusNames, Item, ReadOptions, TimeStyle};
use cobscope_decoder::decoder::Decoder;
use cobscope_decoder::frame::Frame;
use cobscope_decoder::session::{Observer, ProtocolChoice, SessionOptions};

use crate::cli::{Cli, Command, InputArgs, Protocol, StampStyle};
use crate::exit_code::Exit;
use crate::source;

/// Runs what the command line says.
pub fn run(cli: Cli) -> Exit {
    match cli.command {
        Command::Decode(arguments) => decode::run(&arguments),
        Command::Stats(arguments) => stats::run(&arguments),
        Command::Objects(arguments) => objects::run(&arguments),
        Command::Explain { thing } => explain::run(&thing),
        Command::Completions { shell } => shell::completions(shell),
        Command::Man => shell::man(),
    }
}

/// Tells the user what went wrong.
fn complain(error: &anyhow::Error) {
    let _ = writeln!(std::io::stderr(), "cobscope: {error:#}");
}

/// Captures to read: those named, else standard input.
fn captures(input: &InputArgs) -> Vec<PathBuf> {
    if input.captures.is_empty() { vec!["-".into()] } else { input.captures.clone() }
}

fn read_options(input: &InputArgs) -> ReadOptions {
    ReadOptions {
        time_style: input.time.map(|style| match style {
            StampStyle::Absolute => TimeStyle::Absolute,
            StampStyle::Delta => TimeStyle::Delta,
        }),
    }
}

/// What the options say of the buses.
///
/// # Errors
/// A bus file that cannot be read or is broken.
fn session_options(input: &InputArgs) -> anyhow::Result<SessionOptions> {
    #[expect(clippy::cast_possible_truncation, reason = "saturates")]
    let sdo_silence = (input.sdo_timeout * 1e9) as i64;
    Ok(SessionOptions {
        protocol: match input.protocol {
            Protocol::Auto => ProtocolChoice::Auto,
            Protocol::Canopen => ProtocolChoice::Canopen,
            Protocol::None => ProtocolChoice::None,
        },
        sdo_silence,
        bus_file: input.bus.as_deref().map(bus_file).transpose()?.unwrap_or_default(),
        ..SessionOptions::default()
    })
}

fn bus_file(path: &Path) -> anyhow::Result<BusFile> {
    let name = path.display().to_string();
    let text = std::fs::read_to_string(path).with_context(|| format!("{name}: cannot be read"))?;
    BusFile::parse(&text).map_err(|error| anyhow::anyhow!(error.show(&name)))
}

/// Something that looks at events and can have enough.
trait Watcher: Observer {
    /// Whether further events are in vain.
    fn is_done(&self) -> bool {
        false
    }

    /// Whether it prints to the terminal while events come.
    fn is_on_terminal(&self) -> bool {
        false
    }

    /// The first frame of a capture, before any event of it.
    ///
    /// # Errors
    /// When what was asked for cannot be told of such a capture.
    fn begin(&mut self, _first: &Frame) -> anyhow::Result<()> {
        Ok(())
    }
}

/// Decodes one capture into `watcher`; gives the decoder as it is at the end and the number of frames.
fn decode_capture(
    path: &Path,
    input: &InputArgs,
    options: &SessionOptions,
    watcher: &mut dyn Watcher,
) -> anyhow::Result<(Decoder, u64)> {
    let mut capture = source::open(path, &read_options(input))?;
    if watcher.is_on_terminal() {
        capture.progress.hide();
    }
    let mut decoder = Decoder::new(options.clone());
    let mut batch = Batch::new();
    let mut frames = 0;
    let mut failure = None;
    while !watcher.is_done() {
        match capture.reader.read(&mut batch) {
            Ok(true) => {}
            Ok(false) => break,
            Err(error) => {
                failure = Some(anyhow::Error::from(error).context(path.display().to_string()));
                break;
            }
        }
        if frames == 0
            && let Some(first) = batch.frames().first()
        {
            watcher.begin(first).with_context(|| path.display().to_string())?;
        }
        frames += batch.frames().len() as u64;
        push_batch(&mut decoder, &batch, capture.reader.buses(), watcher);
        capture.progress.tick();
    }
    capture.progress.finish();
    decoder.finish(capture.reader.buses(), watcher);
    if let Some(failure) = failure {
        return Err(failure);
    }
    anyhow::ensure!(frames > 0, "{}: holds no frame", path.display());
    Ok((decoder, frames))
}

fn push_batch(decoder: &mut Decoder, batch: &Batch, names: &BusNames, watcher: &mut dyn Watcher) {
    if batch.notices().is_empty() {
        for frame in batch.frames() {
            decoder.push(frame, names, watcher);
        }
        return;
    }
    for item in batch.items() {
        match item {
            Item::Frame(frame) => decoder.push(frame, names, watcher),
            Item::Notice(notice) => decoder.notice(notice, names, watcher),
        }
    }
}
