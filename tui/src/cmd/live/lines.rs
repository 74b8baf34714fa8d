//! Live buses as text, with rules.

use std::collections::BTreeSet;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Receiver, RecvTimeoutError};
use std::time::{Duration, Instant};

use cobscope_decoder::capture::Notice;
use cobscope_decoder::frame::{Frame, Timestamp};
use cobscope_decoder::session::SessionOptions;
use cobscope_decoder::sink::findings::{CaptureResult, FINDING_FORMATS, FindingTextOptions, FindingsReport};
use cobscope_decoder::words::count_noun;
use cobscope_decoder::{Reading, Summary};

use super::arguments::LiveArgs;
use super::cuts::CutRecorder;
use super::interruption::interrupted;
use super::pump::{PendingDeliveries, ReadingThread};
use super::sources::{is_down, open, recorder, shown};
use super::triggers;
use super::viewer::LiveViewer;
use crate::exit_code::ExitStatus;
use crate::record::RecordFailure;
use crate::run::input::{build_setup, check_rules_of, session_options};
use crate::run::messages::{Refusal, print_note};
use crate::run::output::{files_read, is_colored, print_text, write_result};
use crate::run::print::EventPrinter;
use crate::run::remarks;
use crate::source::live::{Arrival, LiveBusState, LiveSource, SharedLiveState, SourceSpec, socketcan};
use crate::words::unheard_note;

/// Maximum wait for frames before other work is done.
const WAIT: Duration = Duration::from_millis(50);

/// Maximum number of messages that are remembered so that they are printed once.
const MOST_NOTED: usize = 256;

/// Prints live events until the user stops.
pub(super) fn run(arguments: &LiveArgs, specs: Vec<SourceSpec>) -> Result<ExitStatus, Refusal> {
    watch(arguments, || open(arguments, specs))
}

/// As `run`; `sources` opens the sources after all other checks succeeded.
pub(super) fn watch(
    arguments: &LiveArgs,
    sources: impl FnOnce() -> anyhow::Result<Vec<Box<dyn LiveSource>>>,
) -> Result<ExitStatus, Refusal> {
    let ready = session_options(&arguments.input).and_then(|options| {
        let setup = build_setup(&arguments.input, &options.catalogue, None)?;
        Ok((options, Arc::new(setup)))
    });
    let (options, setup) = ready.map_err(|error| (ExitStatus::Profile, error))?;
    check_rules_of(arguments.select.filter.as_ref(), &setup).map_err(|error| (ExitStatus::Usage, error))?;
    triggers::check(&arguments.triggers, &setup, &options.catalogue)
        .map_err(|error| (ExitStatus::Usage, error))?;
    let printer = EventPrinter::new(&arguments.lines, &arguments.select, true, &files_read(&arguments.input))
        .map_err(|error| (ExitStatus::Usage, error))?;
    let interrupted = interrupted().map_err(|error| (ExitStatus::Capture, error))?;
    let sources = sources().map_err(|error| (ExitStatus::Capture, error))?;
    let recorder = recorder(arguments).map_err(|error| (ExitStatus::Usage, error))?;
    let cuts = CutRecorder::open(arguments, options.clone()).map_err(|error| (ExitStatus::Usage, error))?;
    let (pump, inbox) = ReadingThread::start(sources, recorder, arguments.frames_wanted)
        .map_err(|error| (ExitStatus::Capture, error))?;
    let opened = pump.state.get().buses.clone();
    greet(&pump.state.get());
    if let Some(cuts) = &cuts {
        cuts.greet();
    }
    let viewer = LiveViewer::new(arguments, printer);
    let setup = viewer.needs_rules(arguments).then_some(setup);
    let mut watch = LiveSession {
        reading: Reading::of_options(options.clone(), setup, viewer),
        options,
        cuts,
        last: None,
        opened: opened.into_iter().map(|bus| bus.name).collect(),
        reached: BTreeSet::new(),
        noted: BTreeSet::new(),
    };
    watch.run(arguments, &inbox, &pump.state, &interrupted);
    drop(inbox);
    Ok(conclude(watch, pump, arguments))
}

/// Ends reading, recording and output; prints what was lost.
fn conclude(mut watch: LiveSession, pump: ReadingThread, arguments: &LiveArgs) -> ExitStatus {
    let state = pump.state.clone();
    let outcome = pump.finish();
    let live = state.get().clone();
    watch.report_troubles(&live);
    let watched = watch.bus_names();
    let exit = watch.finish(arguments);
    // The input may name buses after the last frame that was decoded.
    for bus in live.buses.iter().filter(|bus| watched.contains(&bus.name)) {
        print_note(&format!("{}; {} lost", shown(bus), count_noun(bus.lost, "frame")));
    }
    if let Some(outcome) = &outcome {
        print_note(&format!("recorded {outcome}"));
        outcome.remark_texts().iter().for_each(|remark| print_note(remark));
    }
    if live.failure.is_some() || outcome.is_some_and(|outcome| outcome.is_incomplete()) {
        return exit.max(ExitStatus::Capture);
    }
    exit
}

/// Prints the sources, their mode, and the note that no frame is sent.
fn greet(live: &LiveBusState) {
    for bus in &live.buses {
        if is_down(bus) {
            print_note(&socketcan::how_to_bring_up(&bus.name, bus.bit_rate));
        } else {
            print_note(&format!("{}; cobscope sends no frames", shown(bus)));
        }
    }
    if let Some(record) = &live.record {
        print_note(&format!("recording to {}", record.path.display()));
    }
}

/// State of a live session.
struct LiveSession {
    reading: Reading<LiveViewer>,
    options: SessionOptions,
    cuts: Option<CutRecorder>,
    last: Option<Timestamp>,
    /// Buses of the sources at the start.
    opened: Vec<String>,
    /// Buses with frames or notices so far.
    reached: BTreeSet<u8>,
    /// Messages on recording and sources already printed.
    noted: BTreeSet<String>,
}

impl LiveSession {
    /// Processes frames until a stop condition is met.
    fn run(
        &mut self,
        arguments: &LiveArgs,
        inbox: &Receiver<PendingDeliveries>,
        state: &SharedLiveState,
        interrupted: &AtomicBool,
    ) {
        let patience = arguments.timeout.map(Duration::from_millis);
        let mut received = Instant::now();
        while !interrupted.load(Ordering::Relaxed) && !self.is_done() {
            match inbox.recv_timeout(WAIT) {
                Ok(arrived) => {
                    if arrived.items.iter().any(|item| matches!(item, Arrival::Frame(_))) {
                        received = Instant::now();
                    }
                    self.take(arrived);
                }
                Err(RecvTimeoutError::Timeout) => {}
                Err(RecvTimeoutError::Disconnected) => return,
            }
            if let Some(cuts) = &mut self.cuts {
                cuts.tick();
            }
            self.report_troubles(&state.get());
            if patience.is_some_and(|patience| received.elapsed() >= patience) {
                return;
            }
        }
    }

    /// Whether a stop condition is met and no window is open.
    fn is_done(&self) -> bool {
        let is_waiting = self.cuts.as_ref().is_some_and(CutRecorder::is_waiting);
        let viewer = self.reading.part();
        viewer.has_failed() || (viewer.is_over() && !is_waiting)
    }

    /// Reports new failures of recording and sources; totals follow at the end.
    fn report_troubles(&mut self, live: &LiveBusState) {
        let cuts = self.cuts.as_ref().map(CutRecorder::status);
        let statuses = live.record.iter().chain(&cuts);
        let failures = statuses.flat_map(|status| status.failure.iter().chain(&status.other_failure));
        let failures = failures.map(|RecordFailure { path, reason, .. }| {
            format!("{}: {reason}; output continues", path.display())
        });
        let controllers = live.buses.iter().filter_map(|bus| {
            let state = bus.controller.as_ref()?.split(',').next()?;
            (!matches!(state, "error active" | "stopped")).then(|| format!("{}: {state}", bus.name))
        });
        for text in failures.chain(live.failure.clone()).chain(controllers) {
            if !self.noted.contains(&text) {
                if self.noted.len() >= MOST_NOTED {
                    self.noted.clear();
                }
                print_note(&text);
                self.noted.insert(text);
            }
        }
    }

    fn take(&mut self, PendingDeliveries { names, items }: PendingDeliveries) {
        self.reading.set_buses(names);
        for item in items {
            match item {
                Arrival::Frame(frame) => self.frame(&frame),
                Arrival::Notice(notice) => self.notice(&notice),
            }
            // The size of a delivery depends on the load of the machine: the end must not.
            if self.is_done() {
                break;
            }
        }
        // The reader of the output expects lines without delay.
        self.reading.part_mut().flush();
    }

    fn notice(&mut self, notice: &Notice) {
        if let Notice::LostFrames { bus, .. } | Notice::Link { bus, .. } = notice {
            self.reached.insert(bus.0);
        }
        self.reading.notice(notice);
        if let Some(cuts) = &mut self.cuts {
            let (names, viewer) = self.reading.names_and_part();
            cuts.notice(notice, names, &mut viewer.triggers);
        }
    }

    fn frame(&mut self, frame: &Frame) {
        self.reached.insert(frame.bus.0);
        if self.reading.first().is_none() {
            let frame = Frame { number: 1, ..*frame };
            self.reading.part_mut().begin(&frame);
        }
        self.last = frame.time.or(self.last);
        let number = self.reading.push(frame);
        if let Some(cuts) = &mut self.cuts {
            let (names, viewer) = self.reading.names_and_part();
            cuts.frame(&Frame { number, ..*frame }, names, &mut viewer.triggers);
        }
    }

    /// Names of the buses of the sources, and of those that the input has named so far.
    fn bus_names(&self) -> Vec<String> {
        let mut names: Vec<String> = Vec::new();
        let reached =
            self.reached.iter().filter_map(|bus| self.reading.names().names().get(usize::from(*bus)));
        for name in self.opened.iter().chain(reached) {
            if !names.contains(name) {
                names.push(name.clone());
            }
        }
        names
    }

    /// Name of the capture in the report: its buses, or the sources as typed if the input has named none.
    fn capture_name(&self, arguments: &LiveArgs) -> String {
        let names = self.bus_names();
        if names.is_empty() {
            let sources = arguments.input.captures.iter().map(|path| path.display().to_string());
            return sources.collect::<Vec<_>>().join(" ");
        }
        names.join(" ")
    }

    /// Ends the session and prints the result of `check`.
    fn finish(mut self, arguments: &LiveArgs) -> ExitStatus {
        let capture = self.capture_name(arguments);
        // Before the end of the decoder, at which no frame can be recorded any more.
        self.reading.part_mut().flush();
        let recorded = self.cuts.take().map_or(ExitStatus::Clean, CutRecorder::finish);
        let Summary { findings, part: viewer, decoder, first } = self.reading.finish();
        let buses = decoder.buses();
        let mut texts = remarks::decoding_limits("live", buses);
        texts.extend(remarks::possible_profiles("live", buses));
        texts.extend(unheard_note("live", buses, &self.options));
        for text in &texts {
            print_note(text);
        }
        let LiveViewer { mut printer, triggers, .. } = viewer;
        triggers.remarks().iter().for_each(|text| print_note(text));
        let written = write_result(printer.finish());
        let written = written.max(recorded);
        if !arguments.check {
            return written;
        }
        let (frames, first, last) = (decoder.frame_count(), first.and_then(|first| first.time), self.last);
        let judged = CaptureResult { capture, frames, first, last, findings, ..CaptureResult::default() };
        let report = FindingsReport {
            captures: vec![judged],
            least: arguments.fail_on.lowest_severity(),
            ..FindingsReport::default()
        };
        let mut verdict = Vec::new();
        let color = is_colored(arguments.lines.color, arguments.lines.output.is_some());
        let options = FindingTextOptions { color, verbose: arguments.lines.verbose, coverage: false };
        // Falls back to text, the first format, if there is no findings format of that name.
        let name = arguments.lines.format.0.map(|format| format.name);
        let same = FINDING_FORMATS.iter().find(|format| name == Some(format.name));
        if let Some(format) = same.or(FINDING_FORMATS.first()) {
            // Writing to memory cannot fail.
            let _ = (format.write)(&report, options, &mut verdict);
        }
        let exit = match frames {
            // As for a capture without frames: nothing was checked.
            0 => {
                print_note(&format!(
                    "{}: contains no frames",
                    report.captures.first().map_or("live", |one| &one.capture)
                ));
                ExitStatus::Capture
            }
            _ if report.has_failed() => ExitStatus::Findings,
            _ => ExitStatus::Clean,
        };
        exit.max(written).max(print_text(&verdict))
    }
}
