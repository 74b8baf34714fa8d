//! The pass over one capture that most commands make.

use std::io::Write as _;
use std::path::Path;

use anyhow::Context as _;
use cobscope_decoder::capture::{Batch, BusNames, Item, Notice};
use cobscope_decoder::decoder::Decoder;
use cobscope_decoder::frame::Frame;
use cobscope_decoder::session::{Observer, SessionOptions};

use super::input::{captures, read_options, session_options, unknown_buses};
use super::messages::{complain, warn};
use super::output;
use crate::cli::InputArgs;
use crate::exit_code::Exit;
use crate::source;

/// Something that looks at a capture's events and can have enough.
pub(super) trait Watcher: Observer {
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
pub(super) struct Decoded {
    /// The decoder behind the last frame.
    pub(super) decoder: Decoder,
    /// Title of the capture's format.
    pub(super) format: &'static str,
    /// Why reading ended early, if it did.
    pub(super) failure: Option<anyhow::Error>,
    /// What else is to be said of it.
    pub(super) warnings: Vec<String>,
    /// What of it could not be read.
    pub(super) unreadable: Unreadable,
}

impl Decoded {
    /// Says what could not be read, where the output has no place for it.
    pub(super) fn tell_unreadable(&self, path: &Path) {
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
pub(super) struct Unreadable {
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
pub(super) fn decode_capture(
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
pub(super) fn decode_quietly(
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
pub(super) fn cut_off(notices: &[(usize, Notice)]) -> Option<String> {
    let is_cut = |notice: &Notice| matches!(notice, Notice::CutOff { .. });
    notices.iter().find(|(_, notice)| is_cut(notice)).map(|(_, notice)| notice.to_string())
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
pub(super) fn report(
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
