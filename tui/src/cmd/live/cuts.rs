//! Captures around triggers, with a line on stdout for each trigger and each capture.

use std::path::Path;
use std::sync::mpsc::Receiver;
use std::time::{Duration, Instant};

use anyhow::{Context as _, ensure};
use cobscope_decoder::capture::{BusNames, Notice};
use cobscope_decoder::frame::{Frame, Timestamp};
use cobscope_decoder::session::{BusSnapshot, SessionOptions};
use cobscope_decoder::sink::escape;

use super::arguments::LiveArgs;
use super::cut_lines::{CutLine, LineStyle, limit as limit_reached};
use super::program::ProgramRunner;
use super::triggers::LiveTriggers;
use crate::exit_code::ExitStatus;
use crate::record::format;
use crate::record::{CutNews, CutOptions, RecordStatus, Recorder, StateText};
use crate::run::cut;
use crate::run::messages::print_note;
use crate::run::output::print_text;
use cobscope_decoder::figures::format_limit;

/// Time in addition to `--after` after which a stopped session no longer waits for frames.
const LATEST: Duration = Duration::from_secs(1);

/// Recorder of captures around triggers.
pub(super) struct CutRecorder {
    recorder: Recorder,
    news: Receiver<CutNews>,
    runner: Option<ProgramRunner>,
    style: LineStyle,
    /// Place and size of the ring.
    ring: String,
    after: Duration,
    /// Time of the first frame.
    first: Option<Timestamp>,
    /// Time of the latest frame or notice.
    now: Option<Timestamp>,
    /// End of the latest window.
    until: Option<Timestamp>,
    /// Moment of the last trigger.
    raised: Option<Instant>,
    has_refused: bool,
    exit: ExitStatus,
}

impl CutRecorder {
    /// Recorder of the options; `None` without triggers. `session` are the options of the decoder.
    ///
    /// # Errors
    /// If the folder or a file of the ring cannot be created.
    pub(super) fn open(arguments: &LiveArgs, session: SessionOptions) -> anyhow::Result<Option<Self>> {
        let own = &arguments.triggers;
        let Some(folder) = arguments.record.as_deref().filter(|_| own.is_any()) else { return Ok(None) };
        create(folder)?;
        let options = CutOptions {
            folder: folder.to_owned(),
            before: own.before,
            after: own.after,
            ring_bytes: own.ring_size,
            ring_files: own.ring_files,
            files: own.trigger_files,
            bytes: own.trigger_size,
        };
        let in_files = own
            .ring_files
            .map_or_else(String::new, |size| format!(", of up to {} in files", format_limit(size)));
        let ring = format!("ring of up to {} in memory{in_files}", format_limit(own.ring_size));
        let runner = own.on_trigger.as_deref().map(ProgramRunner::start).transpose()?;
        let now = jiff::Zoned::now().datetime();
        let (recorder, news) = Recorder::on_triggers(options, session, state_text(arguments), now)?;
        Ok(Some(Self {
            recorder,
            news,
            runner,
            style: LineStyle::of(&arguments.lines),
            ring,
            after: own.after,
            first: None,
            now: None,
            until: None,
            raised: None,
            has_refused: false,
            exit: ExitStatus::Clean,
        }))
    }

    /// Prints the folder and the ring.
    pub(super) fn greet(&self) {
        let folder = self.recorder.status().path;
        print_note(&format!("recording around triggers to {}; {}", folder.display(), self.ring));
    }

    /// Adds a frame with its triggers.
    pub(super) fn frame(&mut self, frame: &Frame, names: &BusNames, triggers: &mut LiveTriggers) {
        self.first = self.first.or(frame.time);
        self.now = self.now.max(frame.time);
        self.raise(triggers);
        self.recorder.frame(frame, names.name_of(frame.bus));
    }

    /// Adds a notice with its triggers.
    pub(super) fn notice(&mut self, notice: &Notice, names: &BusNames, triggers: &mut LiveTriggers) {
        if let Notice::Quiet(time) | Notice::Link { time, .. } = notice {
            self.now = self.now.max(Some(*time));
        }
        self.raise(triggers);
        self.recorder.notice(notice, names.name_of(notice.bus()));
    }

    fn raise(&mut self, triggers: &mut LiveTriggers) {
        for trigger in triggers.raised() {
            let after = i64::try_from(self.after.as_nanos()).unwrap_or(i64::MAX);
            let end = trigger.time.or(self.now).map(|time| Timestamp(time.0.saturating_add(after)));
            self.until = self.until.max(end);
            self.raised = Some(Instant::now());
            self.recorder.trigger(trigger);
        }
    }

    /// Whether the window of a trigger is open and frames for it can still arrive.
    pub(super) fn is_waiting(&self) -> bool {
        let is_open = self.until.is_some_and(|until| self.now.is_none_or(|now| now <= until));
        is_open && self.raised.is_some_and(|raised| raised.elapsed() < self.after + LATEST)
    }

    /// Advances the time and prints news.
    pub(super) fn tick(&mut self) {
        self.recorder.tick(Instant::now());
        self.print_news();
    }

    /// Status of writing.
    pub(super) fn status(&self) -> RecordStatus {
        self.recorder.status()
    }

    /// Completes the open capture; prints the last news and the total.
    pub(super) fn finish(mut self) -> ExitStatus {
        self.recorder.tick(Instant::now());
        let status = self.recorder.stop();
        self.print_news();
        if let Some(runner) = self.runner.take() {
            runner.finish();
        }
        print_note(&format!("recorded {}", status.of_cuts()));
        status.remark_texts().iter().for_each(|remark| print_note(remark));
        if status.is_incomplete() { self.exit.max(ExitStatus::Capture) } else { self.exit }
    }

    fn print_news(&mut self) {
        while let Ok(news) = self.news.try_recv() {
            self.remark(&news);
            let line = CutLine { news: &news, first: self.first };
            match self.style {
                LineStyle::Text => self.exit = self.exit.max(print_text(line.text().as_bytes())),
                LineStyle::Json => self.exit = self.exit.max(print_text(line.json().as_bytes())),
                LineStyle::Note => print_note(line.text().trim()),
            }
            if let (CutNews::Complete(cut), Some(runner)) = (&news, &self.runner) {
                cut.paths.iter().for_each(|path| runner.run(path));
            }
        }
    }

    /// Prints a note on the first trigger that is not recorded.
    fn remark(&mut self, news: &CutNews) {
        if let CutNews::Refused { reason, .. } = news
            && !self.has_refused
        {
            self.has_refused = true;
            print_note(&format!("live: {} reached; later triggers are not recorded", limit_reached(*reason)));
        }
    }
}

/// Text of the bus file next to a capture.
fn state_text(arguments: &LiveArgs) -> StateText {
    let input = arguments.input.clone();
    Box::new(move |buses, path, title| {
        cut::snapshot_text(BusSnapshot::snapshot_of(buses), &input, path, title)
    })
}

/// Creates the folder of the captures, unless it exists, and checks that files can be created in it.
fn create(folder: &Path) -> anyhow::Result<()> {
    let text = folder.display().to_string();
    let shown = escape(&text);
    let is_folder = folder.is_dir();
    let is_file = !is_folder && (text == "-" || format::format_of(folder).is_some());
    ensure!(!is_file, "--record {shown}: captures of triggers need a folder");
    if !is_folder {
        std::fs::create_dir(folder).with_context(|| format!("{shown}: cannot create the folder"))?;
    }
    // A trigger can be days later.
    tempfile::tempfile_in(folder).map(drop).with_context(|| format!("{shown}: cannot create files in it"))
}
