//! Live buses as one stream of pcapng, for a program that reads it while it grows.

use std::io::{self, BufWriter, ErrorKind, Write};
use std::path::Path;
use std::sync::atomic::Ordering;
use std::sync::mpsc::{Receiver, RecvTimeoutError};
use std::time::Duration;

use anyhow::Context as _;
use cobscope_decoder::capture::{BusNames, FrameWriter, WRITABLE, WriteOptions};
use cobscope_decoder::decoder::Decoder;
use cobscope_decoder::event::Event;
use cobscope_decoder::frame::Frame;
use cobscope_decoder::session::{Bus, SessionOptions};
use cobscope_decoder::words::count_noun;

use super::arguments::LiveArgs;
use super::interruption::interrupted;
use super::pump::{PendingDeliveries, ReadingThread};
use super::sources::open;
use crate::device_name;
use crate::exit_code::ExitStatus;
use crate::output_file::{self, ExistingFile};
use crate::path_text::path_text;
use crate::run::frame_comment::add_event;
use crate::run::input::session_options;
use crate::run::messages::{Refusal, print_note};
use crate::run::output::creation_error;
use crate::source::live::{Arrival, SourceSpec};

/// Maximum wait for frames before signals are looked for.
const WAIT: Duration = Duration::from_millis(50);

/// Format of a stream.
const FORMAT: &str = "pcapng";

/// Whether `path` is stdout or a pipe, to which a capture is written as a stream.
pub(super) fn is_stream(path: &Path) -> bool {
    let is_pipe = || path.metadata().is_ok_and(|found| !found.is_file() && !found.is_dir());
    path.as_os_str() == "-" || device_name::is_device(path) || is_pipe()
}

/// Writes the frames of the sources to `path`, stdout for `-`, until the reader or the user stops; with
/// `has_comments`, each frame has its meaning as a comment.
///
/// # Errors
/// If a source cannot be opened, or the output cannot be written; a reader that stops is none.
pub(in crate::cmd) fn run(
    arguments: &LiveArgs,
    specs: Vec<SourceSpec>,
    path: &Path,
    has_comments: bool,
) -> Result<ExitStatus, Refusal> {
    let options = session_options(&arguments.input).map_err(|error| (ExitStatus::Profile, error))?;
    let interrupted = interrupted().map_err(|error| (ExitStatus::Capture, error))?;
    let output: Box<dyn Write + Send> = if path.as_os_str() == "-" {
        Box::new(io::stdout())
    } else {
        let created = output_file::create_at_once(path, ExistingFile::Keep);
        Box::new(created.map_err(|error| (ExitStatus::Usage, creation_error(path, &error)))?)
    };
    let sources = open(arguments, specs).map_err(|error| (ExitStatus::Capture, error))?;
    let (pump, inbox) = ReadingThread::start(sources, None, arguments.frames_wanted)
        .map_err(|error| (ExitStatus::Capture, error))?;
    let stream = LiveStream::new(output, has_comments.then_some(options));
    let mut stream = stream.map_err(|error| (ExitStatus::Capture, error))?;
    let mut written = Ok(());
    while !interrupted.load(Ordering::Relaxed) && written.is_ok() {
        match inbox.recv_timeout(WAIT) {
            Ok(arrived) => written = stream.take(&arrived),
            Err(RecvTimeoutError::Timeout) => {}
            Err(RecvTimeoutError::Disconnected) => break,
        }
    }
    stop(pump, inbox);
    match written.and_then(|()| stream.writer.finish()) {
        Err(error) if error.kind() == ErrorKind::BrokenPipe => Ok(ExitStatus::Clean),
        Err(error) => Err((ExitStatus::Capture, anyhow::Error::new(error).context(path_text(path)))),
        Ok(()) => Ok(ExitStatus::Clean),
    }
}

/// Ends the sources; reports what they lost.
fn stop(pump: ReadingThread, inbox: Receiver<PendingDeliveries>) {
    drop(inbox);
    let state = pump.state.clone();
    pump.finish();
    let live = state.get().clone();
    for bus in live.buses.iter().filter(|bus| bus.lost > 0) {
        print_note(&format!("{}: {} lost", bus.name, count_noun(bus.lost, "frame")));
    }
    if let Some(failure) = &live.failure {
        print_note(failure);
    }
}

/// The output, and the decoder for comments.
struct LiveStream {
    writer: Box<dyn FrameWriter>,
    decoder: Option<Decoder>,
    frames: u64,
    comment: String,
}

impl LiveStream {
    fn new(output: Box<dyn Write + Send>, options: Option<SessionOptions>) -> anyhow::Result<Self> {
        let format =
            WRITABLE.iter().find(|format| format.name == FORMAT).context("no format for a stream")?;
        let writer = (format.writer)(Box::new(BufWriter::new(output)), &WriteOptions::default());
        Ok(Self { writer, decoder: options.map(Decoder::new), frames: 0, comment: String::new() })
    }

    /// Writes items; all of them are in the stream when it returns.
    fn take(&mut self, arrived: &PendingDeliveries) -> io::Result<()> {
        for item in &arrived.items {
            match item {
                Arrival::Frame(frame) => {
                    self.frames = self.frames.saturating_add(1);
                    self.frame(&Frame { number: self.frames, ..*frame }, &arrived.names)?;
                }
                Arrival::Notice(notice) => {
                    if let Some(decoder) = &mut self.decoder {
                        decoder.on_notice(notice, &arrived.names, &mut |_: &Event, _: &Bus| {});
                    }
                    self.writer.notice(notice, arrived.names.name_of(notice.bus()))?;
                }
            }
        }
        self.writer.flush()
    }

    fn frame(&mut self, frame: &Frame, names: &BusNames) -> io::Result<()> {
        let Self { writer, decoder, comment, .. } = self;
        comment.clear();
        if let Some(decoder) = decoder {
            decoder.push(frame, names, &mut |event: &Event, bus: &Bus| add_event(comment, event, bus));
        }
        let bus = names.name_of(frame.bus);
        if comment.is_empty() {
            writer.write(frame, bus)
        } else {
            writer.write_commented(frame, bus, comment)
        }
    }
}
