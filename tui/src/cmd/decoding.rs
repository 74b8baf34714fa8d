//! Decoding of one capture, shared by most commands.

use anyhow::Context as _;
use cobscope_decoder::capture::{Batch, BusNames, Item, Notice};
use cobscope_decoder::decoder::Decoder;
use cobscope_decoder::frame::Frame;
use cobscope_decoder::session::{Bus, Observer, SessionOptions};
use cobscope_decoder::sink::escape;

use super::input::{read_options, series, session_options, unknown_buses};
use super::messages::{complain, exit_of, warn};
use super::output;
use super::remarks;
use crate::cli::InputArgs;
use crate::exit_code::Exit;
use crate::select::Span;
use crate::source::{Series, SeriesFrames, time_span};
use crate::words::unheard_until;

/// Observer of a capture that can end decoding early.
pub(super) trait CaptureObserver: Observer {
    /// Whether the observer needs no more events.
    fn is_done(&self) -> bool {
        false
    }

    /// Whether the observer prints to the terminal during decoding.
    fn is_on_terminal(&self) -> bool {
        false
    }

    /// Whether reading may use another core; not if the cores are used for other captures.
    fn has_another_core(&self) -> bool {
        true
    }

    /// Called with the first frame of a capture, before any event; `span` reads the capture to its end.
    ///
    /// # Errors
    /// If the request is not possible for this capture.
    fn begin(&mut self, _first: &Frame, _span: Span<'_>) -> anyhow::Result<()> {
        Ok(())
    }

    /// Whether to call [`CaptureObserver::frame`] for each frame.
    fn wants_frames(&self) -> bool {
        false
    }

    /// Called for each frame, before its events; `false` ends the capture before the frame.
    fn frame(&mut self, _frame: &Frame, _names: &BusNames) -> bool {
        true
    }

    /// The moment at which the observer ended the capture, as text; `None` if all frames were read.
    fn early_end(&self) -> Option<String> {
        None
    }

    /// Called with the next frames, before the events of the first one. Returns the number of frames of which the observer
    /// took note; 0 ends the capture before the first one.
    fn frames(&mut self, frames: &[Frame], names: &BusNames) -> usize {
        usize::from(frames.first().is_some_and(|frame| self.frame(frame, names)))
    }

    /// Whether to call [`CaptureObserver::frame_decoded`] for each frame.
    fn wants_decoded_frames(&self) -> bool {
        false
    }

    /// Called for each frame, after its events; `bus` is in the state after the frame.
    fn frame_decoded(&mut self, _frame: &Frame, _bus: &Bus) {}

    /// Called for each notice, before its event.
    fn notice(&mut self, _notice: &Notice, _names: &BusNames) {}
}

/// Result of decoding a capture.
pub(super) struct DecodedCapture {
    /// Decoder in the state after the last frame.
    pub(super) decoder: Decoder,
    /// Title of the capture format.
    pub(super) format: &'static str,
    /// Error that ended reading early.
    pub(super) failure: Option<anyhow::Error>,
    /// Warnings for the user.
    pub(super) warnings: Vec<String>,
    /// Unreadable lines and records.
    pub(super) unreadable: UnreadableInput,
}

impl DecodedCapture {
    /// Reports unreadable lines and records.
    pub(super) fn report_unreadable(&self, name: &str) {
        if let Some(text) = self.unreadable_text(name) {
            warn(&text);
        }
    }

    /// Number of unreadable lines and records, with the first one; `None` without any.
    pub(super) fn unreadable_text(&self, name: &str) -> Option<String> {
        let UnreadableInput { count, first: Some(first) } = &self.unreadable else { return None };
        Some(match count {
            1 => format!("{name}: 1 line or record unreadable ({first}); all others decoded"),
            count => {
                format!("{name}: {count} lines or records unreadable (first: {first}); all others decoded")
            }
        })
    }
}

/// Unreadable lines and records.
#[derive(Default)]
pub(super) struct UnreadableInput {
    count: u64,
    /// Position and reason of the first one.
    first: Option<String>,
}

impl UnreadableInput {
    fn see(&mut self, notices: &[(usize, Notice)], frames: &SeriesFrames) {
        for (_, notice) in notices.iter().filter(|(_, notice)| matches!(notice, Notice::Unreadable { .. })) {
            self.count += 1;
            self.first.get_or_insert_with(|| {
                if frames.is_joined() { format!("{} {notice}", frames.file()) } else { notice.to_string() }
            });
        }
    }
}

/// Decodes one capture and prints warnings.
///
/// # Errors
/// If the capture cannot be opened or recognised, or contains no frames.
pub(super) fn decode_capture(
    series: &Series,
    input: &InputArgs,
    options: &SessionOptions,
    watcher: &mut dyn CaptureObserver,
) -> anyhow::Result<DecodedCapture> {
    let decoded = decode_quietly(series, input, options, watcher)?;
    for warning in &decoded.warnings {
        warn(warning);
    }
    Ok(decoded)
}

/// Decodes one capture.
///
/// # Errors
/// If the capture cannot be opened or recognised, or contains no frames.
pub(super) fn decode_quietly(
    series: &Series,
    input: &InputArgs,
    options: &SessionOptions,
    watcher: &mut dyn CaptureObserver,
) -> anyhow::Result<DecodedCapture> {
    let name = || series.name();
    let mut frames = SeriesFrames::open(series, read_options(input), watcher.has_another_core())?;
    if watcher.is_on_terminal() {
        frames.hide_progress();
    }
    let mut decoder = Decoder::new(options.clone());
    let mut batch = Batch::new();
    let mut has_frames = false;
    let mut failure = None;
    let mut unreadable = UnreadableInput::default();
    let mut part = None;
    while !watcher.is_done() {
        match frames.read(&mut batch) {
            Ok(true) => {}
            Ok(false) => break,
            Err(error) => {
                failure = failure.or(Some(error));
                if frames.has_more_parts() {
                    continue;
                }
                break;
            }
        }
        if frames.is_joined() && part != Some(frames.part()) {
            part = Some(frames.part());
            decoder.begin_part(&frames.file());
        }
        if let Some(first) = batch.frames().first().filter(|_| !has_frames) {
            watcher
                .begin(first, &mut || time_span(&series.parts, &read_options(input)))
                .with_context(name)?;
            has_frames = true;
        }
        unreadable.see(batch.notices(), &frames);
        if !push_batch(&mut decoder, &batch, frames.buses(), watcher) {
            break;
        }
        // An observer that stopped early ignores a truncated end.
        if failure.is_none() && !watcher.is_done() {
            let reason = cut_off(batch.notices());
            failure = reason.map(|reason| anyhow::Error::msg(reason).context(frames.file()));
        }
        frames.tick();
    }
    frames.finish_progress();
    decoder.finish(frames.buses(), watcher);
    // After an incomplete read not all buses are known.
    let warnings = if watcher.is_done() {
        Vec::new()
    } else {
        warnings(&name(), (input, options), frames.buses(), (&decoder, watcher.early_end()))
    };
    match failure {
        Some(failure) if !has_frames => Err(failure),
        None if !has_frames => anyhow::bail!("{}: contains no frames", name()),
        failure => {
            Ok(DecodedCapture { decoder, format: frames.format().title, failure, warnings, unreadable })
        }
    }
}

/// Notes on buses and nodes that are absent, and on frames that are not decoded.
fn warnings(
    name: &str,
    (input, options): (&InputArgs, &SessionOptions),
    names: &BusNames,
    (decoder, early_end): (&Decoder, Option<String>),
) -> Vec<String> {
    let mut warnings = unknown_buses(name, input, options, names);
    let (capture, buses) = (escape(name).into_owned(), decoder.buses());
    warnings.extend(remarks::limits(&capture, buses));
    warnings.extend(unheard_until(&capture, buses, options, early_end.as_deref()));
    warnings
}

/// Position and reason of a truncated end, if one of the notices reports it.
pub(super) fn cut_off(notices: &[(usize, Notice)]) -> Option<String> {
    let is_cut = |notice: &Notice| matches!(notice, Notice::CutOff { .. });
    notices.iter().find(|(_, notice)| is_cut(notice)).map(|(_, notice)| notice.to_string())
}

/// Decodes a batch; `false` if the observer ended the capture.
fn push_batch(
    decoder: &mut Decoder,
    batch: &Batch,
    names: &BusNames,
    watcher: &mut dyn CaptureObserver,
) -> bool {
    let wants_frames = watcher.wants_frames();
    if batch.notices().is_empty() && !watcher.wants_decoded_frames() {
        let mut rest = batch.frames();
        while !rest.is_empty() {
            let count = if wants_frames { watcher.frames(rest, names) } else { rest.len() };
            let Some((next, after)) = rest.split_at_checked(count).filter(|_| count > 0) else {
                return false;
            };
            decoder.push_all(next, names, watcher);
            rest = after;
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
                if let Some(bus) =
                    decoder.buses().get(usize::from(frame.bus.0)).filter(|_| watcher.wants_decoded_frames())
                {
                    watcher.frame_decoded(frame, bus);
                }
            }
            Item::Notice(notice) => {
                watcher.notice(notice, names);
                decoder.notice(notice, names, watcher);
            }
        }
    }
    true
}

/// Creates a report for each capture and prints all of them, including those for truncated captures.
pub(super) fn report(
    input: &InputArgs,
    one: impl FnMut(&Series, &SessionOptions, &mut String) -> anyhow::Result<Option<anyhow::Error>>,
) -> Exit {
    match session_options(input) {
        Ok(options) => report_with(input, &options, one),
        Err(error) => {
            complain(&error);
            Exit::Profile
        }
    }
}

/// As [`report`], with options that were read before.
pub(super) fn report_with(
    input: &InputArgs,
    options: &SessionOptions,
    mut one: impl FnMut(&Series, &SessionOptions, &mut String) -> anyhow::Result<Option<anyhow::Error>>,
) -> Exit {
    let mut exit = Exit::Clean;
    let mut text = String::new();
    for series in series(input) {
        if let Some(error) = one(&series, options, &mut text).unwrap_or_else(Some) {
            complain(&error);
            exit = exit.max(exit_of(&error));
        }
    }
    exit.max(output::print(text.as_bytes()))
}
