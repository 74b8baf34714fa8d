//! Captures on a common time axis, with random access.
//!
//! ```text
//!            ┌─ index ──▶ marks, progress          one pass, stores a state every 262,144 frames
//! captures ──┼─ survey ─▶ findings, transfers …    one pass, runs the rules
//!            ├─ watch ──▶ changes of the files         once per second
//!            ├─ matches ▶ frames with shown events one pass per filter
//!            ├─ traces ─▶ signals over time        from the nearest mark
//!            └─ seek ───▶ rows and state at the cursor, from the nearest mark
//! ```
//!
//! Each is a thread. Its results are in [`SharedResults`]; a [`TimelineNews`] message reports a change.

mod indexed;
mod matches;
mod news;
mod order;
mod shared;
mod survey;
mod threads;
mod traces;
mod walk;

use std::path::PathBuf;
use std::sync::atomic::Ordering;
use std::sync::mpsc::{Sender, channel};
use std::sync::{Arc, PoisonError, RwLockReadGuard};

use anyhow::Context as _;
use cobscope_decoder::capture::{Batch, CaptureReader, ReadOptions};
use cobscope_decoder::frame::Timestamp;
use cobscope_decoder::replay::ReplayState;
use cobscope_decoder::rules::RuleSetup;
use cobscope_decoder::series::{CapturePlacement, arrange_captures};
use cobscope_decoder::session::SessionOptions;

pub use cobscope_decoder::reading::{MOST_TRANSFERS, NmtMoment, OpenedFinding, TransferRow};
pub use cobscope_decoder::replay::{ReplayRow, SignalKey, SignalPoints, signal};
pub use cobscope_decoder::series::JoinOptions;
pub use cobscope_decoder::statistics::{LoadOverTime, LoadStep};
pub use indexed::{IndexedCapture, WalkStart};
pub use matches::{RowMatcher, SearchMatches};
pub use news::TimelineNews;
pub use order::{RowWindow, SeekTarget, TextSearch, WindowRequest};
pub use shared::{IndexProgress, SharedResults, TimelineCapture};
pub use survey::{FindingOccurrence, SurveyResults};
pub use threads::ExportRequest;
pub use traces::{MOST_SIGNALS, SignalTraces};

pub use crate::bucket::SampleBucket;
use crate::source::live::SharedLiveState;
use crate::source::{CaptureFile, DecompressedBytes, mixed_clocks, relate_files};

/// Captures with all options.
pub struct TimelineCaptures {
    /// File paths; `-` is standard input.
    pub paths: Vec<PathBuf>,
    /// Align the start of all captures.
    pub align: bool,
    /// Conditions for parts of one capture.
    pub join: JoinOptions,
    /// Options of the readers.
    pub read: ReadOptions,
    /// Options of the decoder.
    pub session: SessionOptions,
    /// Selection and tolerances of the rules.
    pub rules: Arc<RuleSetup>,
    /// Live buses instead of files.
    pub live: Option<LiveBuses>,
}

/// Live buses: received frames and link states.
#[derive(Clone)]
pub struct LiveBuses {
    /// Received frames.
    pub store: Arc<DecompressedBytes>,
    /// Link states and failures.
    pub state: SharedLiveState,
}

/// Captures that are read by background threads.
pub struct Timeline {
    shared: Arc<SharedResults>,
    orders: Sender<WindowRequest>,
    news: Sender<TimelineNews>,
    rules: Arc<RuleSetup>,
    first: Option<Timestamp>,
    live: Option<SharedLiveState>,
    /// Another timeline has the captures of this one.
    is_replaced: bool,
}

impl Timeline {
    /// Opens captures and starts the threads; they report to `news`.
    ///
    /// # Errors
    /// A capture cannot be opened or has an unknown format; captures with and without dates are combined
    /// without `align`.
    pub fn open(captures: TimelineCaptures, news: Sender<TimelineNews>) -> anyhow::Result<Self> {
        let live = captures.live.as_ref().map(|live| live.state.clone());
        let (lanes, first) = match &captures.live {
            Some(live) => (vec![live_lane(live)], None),
            None => open_captures(&captures)?,
        };
        Self::start_threads(
            SharedResults::new(lanes, captures.session, captures.read),
            captures.rules,
            news,
            (first, live),
        )
    }

    /// Starts the threads.
    fn start_threads(
        shared: SharedResults,
        rules: Arc<RuleSetup>,
        news: Sender<TimelineNews>,
        (first, live): (Option<Timestamp>, Option<SharedLiveState>),
    ) -> anyhow::Result<Self> {
        let shared = Arc::new(shared);
        let (orders, inbox) = channel();
        let setup = Arc::clone(&rules);
        spawn_thread("index", &shared, &news, |shared, news| threads::index::run_index(shared, news))?;
        spawn_thread("survey", &shared, &news, move |shared, news| {
            threads::survey::run_survey(shared, &setup, news);
        })?;
        spawn_thread("watch", &shared, &news, |shared, news| threads::watch::run_watch(shared, news))?;
        spawn_thread("seek", &shared, &news, move |shared, news| {
            threads::seek::run_seeker(shared, &inbox, news);
        })?;
        Ok(Self { shared, orders, news, rules, first, live, is_replaced: false })
    }

    /// Options of the decoder.
    pub fn options(&self) -> &SessionOptions {
        &self.shared.options
    }

    /// Decodes the same captures with other options; the files are not read again.
    ///
    /// # Errors
    /// A thread cannot be started.
    pub fn reopen_with(&mut self, options: SessionOptions) -> anyhow::Result<()> {
        let shared = SharedResults::new(self.shared.lanes.clone(), options, self.shared.read_options.clone());
        let next = Self::start_threads(
            shared,
            Arc::clone(&self.rules),
            self.news.clone(),
            (self.first, self.live.clone()),
        )?;
        self.is_replaced = true;
        *self = next;
        Ok(())
    }

    /// Time of the first frame of all captures.
    pub fn first_time(&self) -> Option<Timestamp> {
        self.first
    }

    /// Requests the content at a position.
    pub fn request_window(&self, order: WindowRequest) {
        // If the thread has ended, its failure was already reported.
        let _ = self.orders.send(order);
    }

    /// Starts a search for the shown events; an earlier search ends.
    pub fn start_search(&self, matcher: RowMatcher) {
        let mut current = self.shared.matches.write().unwrap_or_else(PoisonError::into_inner);
        if let Some(old) = current.take() {
            old.stop_search();
        }
        if matcher.takes_all() {
            return;
        }
        let found = Arc::new(SearchMatches::new(matcher));
        *current = Some(Arc::clone(&found));
        drop(current);
        let reported = spawn_thread("matches", &self.shared, &self.news, move |shared, news| {
            threads::matches::run_search(shared, &found, news);
        });
        if let Err(error) = reported {
            let _ = self.news.send(TimelineNews::Failed(format!("{error:#}")));
        }
    }

    /// Exports a part of the captures; the result arrives as [`TimelineNews::Exported`].
    pub fn start_export(&self, export: ExportRequest) {
        let reported = spawn_thread("export", &self.shared, &self.news, move |shared, news| {
            threads::export::run_export(shared, &export, news);
        });
        if let Err(error) = reported {
            let _ = self.news.send(TimelineNews::Failed(format!("{error:#}")));
        }
    }

    /// Result of the search for the shown events.
    pub fn search_matches(&self) -> Option<Arc<SearchMatches>> {
        self.shared.matches.read().unwrap_or_else(PoisonError::into_inner).clone()
    }

    /// Starts sampling signals from a time to another one or to the end.
    pub fn start_sampling(
        &self,
        signals: Vec<SignalKey>,
        from: Timestamp,
        to: Option<Timestamp>,
    ) -> Arc<SignalTraces> {
        let traces = Arc::new(SignalTraces::new(signals, from, to));
        self.shared.tracing.fetch_add(1, Ordering::Relaxed);
        let job = Arc::clone(&traces);
        let reported = spawn_thread("traces", &self.shared, &self.news, move |shared, news| {
            threads::traces::run_sampling(shared, &job, news);
        });
        if let Err(error) = reported {
            self.shared.tracing.fetch_sub(1, Ordering::Relaxed);
            let _ = self.news.send(TimelineNews::Failed(format!("{error:#}")));
        }
        traces
    }

    /// Whether signals are being sampled.
    pub fn is_tracing(&self) -> bool {
        self.shared.tracing.load(Ordering::Acquire) > 0
    }

    /// Progress of the index.
    pub fn progress(&self) -> &IndexProgress {
        &self.shared.progress
    }

    /// Results about the whole capture so far.
    pub fn survey(&self) -> RwLockReadGuard<'_, SurveyResults> {
        self.shared.survey.read().unwrap_or_else(PoisonError::into_inner)
    }

    /// State of the buses at the end; None until it is read.
    pub fn end_state(&self) -> Option<Arc<ReplayState>> {
        self.shared.end.lock().unwrap_or_else(PoisonError::into_inner).clone()
    }

    /// Reason why reading ended early.
    pub fn failure(&self) -> Option<String> {
        let failure = self.shared.failure.lock().unwrap_or_else(PoisonError::into_inner).clone();
        failure.or_else(|| {
            let mut failures = self
                .shared
                .lanes
                .iter()
                .filter_map(|lane| Some(format!("{}: {}", lane.store.name(), lane.store.failure()?)));
            failures.next()
        })
    }

    /// Name of a capture whose file lost content that is shown.
    pub fn changed_capture(&self) -> Option<String> {
        let mut lanes = self.shared.lanes.iter();
        lanes.find(|lane| lane.store.has_lost_content()).map(|lane| lane.store.short_name())
    }

    /// Whether a capture may still grow.
    pub fn may_grow(&self) -> bool {
        self.shared.may_grow()
    }

    /// Allows the next [`TimelineNews::Grew`] message.
    pub fn see_growth(&self) {
        self.shared.has_reported_growth.store(false, Ordering::Release);
    }

    /// State of live buses; None for files.
    pub fn live(&self) -> Option<&SharedLiveState> {
        self.live.as_ref()
    }

    /// Number of evicted frames at the start of a live bus.
    pub fn dropped_frames(&self) -> u64 {
        self.shared.first_kept().map_or(0, |mark| mark.frames)
    }

    /// The captures in order.
    pub fn open_captures(&self) -> &[TimelineCapture] {
        &self.shared.lanes
    }

    /// Decompressed bytes available, and whether these are all.
    pub fn length(&self) -> (u64, bool) {
        let lengths = self.shared.lanes.iter().map(|lane| lane.store.length());
        lengths.fold((0, true), |(sum, all), (length, is_all)| (sum + length, all && is_all))
    }
}

impl Drop for Timeline {
    fn drop(&mut self) {
        if let Some(matches) = self.search_matches() {
            matches.stop_search();
        }
        if self.is_replaced {
            self.shared.retire_threads();
        } else {
            self.shared.stop_threads();
        }
    }
}

fn spawn_thread(
    name: &str,
    shared: &Arc<SharedResults>,
    news: &Sender<TimelineNews>,
    run: impl FnOnce(&Arc<SharedResults>, &Sender<TimelineNews>) + Send + 'static,
) -> anyhow::Result<()> {
    let (shared, news) = (Arc::clone(shared), news.clone());
    let thread = std::thread::Builder::new().name(name.into());
    thread.spawn(move || run(&shared, &news)).context("cannot start a thread")?;
    Ok(())
}

/// A live bus may have no frame yet.
fn live_lane(live: &LiveBuses) -> TimelineCapture {
    let store = Arc::clone(&live.store);
    TimelineCapture { store, group: 0, shift: 0, continues: false, format: "live", is_live: true }
}

/// Opens the captures and aligns their clocks.
fn open_captures(captures: &TimelineCaptures) -> anyhow::Result<(Vec<TimelineCapture>, Option<Timestamp>)> {
    let mut lanes: Vec<TimelineCapture> = Vec::new();
    let (mut names, mut firsts) = (Vec::new(), Vec::new());
    let is_off = captures.join.is_off || captures.align;
    let join = JoinOptions { is_off, ..captures.join };
    let relations = relate_files(&CaptureFile::files_named(&captures.paths), &captures.read, join);
    for (index, CaptureFile { path, .. }) in relations.files.iter().enumerate() {
        let store = DecompressedBytes::open(path)?;
        let name = store.name().to_owned();
        let mut reader =
            CaptureReader::open(store.reader_at(0), &captures.read).with_context(|| name.clone())?;
        let mut batch = Batch::new();
        while batch.frames().is_empty() && reader.read(&mut batch).with_context(|| name.clone())? {}
        let first = batch.frames().first().with_context(|| format!("{name}: contains no frames"))?;
        firsts.push(first.time.map(|time| time.plus(relations.time_shift(index))));
        names.push(name);
        let format = reader.format().title;
        lanes.push(TimelineCapture { store, group: 0, shift: 0, continues: false, format, is_live: false });
    }
    let mut lanes: Vec<Option<TimelineCapture>> = lanes.into_iter().map(Some).collect();
    let mut arranged = Vec::new();
    for place in
        arrange_captures(&names, &firsts, relations.all_relations(), captures.align).map_err(mixed_clocks)?
    {
        let CapturePlacement { index, group, shift, continues } = place;
        let shift = shift.saturating_add(relations.time_shift(index));
        let lane = lanes.get_mut(index).and_then(Option::take);
        arranged.extend(lane.map(|lane| TimelineCapture { group, shift, continues, ..lane }));
    }
    let lanes = arranged;
    let times = firsts.iter().flatten();
    let first = if captures.align { times.max() } else { times.min() };
    Ok((lanes, first.copied()))
}

#[cfg(test)]
mod tests {
    use cobscope_decoder::replay::EventPosition;
    use std::io::BufWriter;
    use std::sync::mpsc::Receiver;
    use std::time::Duration;

    use cobscope_decoder::capture::{FrameWriter, Notice, WRITABLE, WriteOptions};
    use cobscope_decoder::frame::{BusIndex, CanId, Frame};

    use super::*;

    /// Time limit of a test step on a busy machine.
    const LIMIT: Duration = Duration::from_mins(1);

    fn until(news: &Receiver<TimelineNews>, is_so: impl Fn(&TimelineNews) -> bool) -> TimelineNews {
        loop {
            let next = news.recv_timeout(LIMIT).unwrap();
            if is_so(&next) {
                return next;
            }
        }
    }

    /// Writes heartbeats, one per millisecond.
    fn write(writer: &mut dyn FrameWriter, numbers: std::ops::Range<u64>) {
        for number in numbers {
            let node = 1 + u16::try_from(number % 4).unwrap();
            let time = Some(Timestamp(i64::try_from(number).unwrap() * 1_000_000));
            let frame = Frame { time, ..Frame::data_frame(CanId::from_standard(0x700 + node), &[5]) };
            writer.write(&frame, "can0").unwrap();
        }
        writer.flush().unwrap();
    }

    /// A live bus with the writer of its store.
    fn live_bus() -> (Arc<DecompressedBytes>, Box<dyn FrameWriter>, Timeline, Receiver<TimelineNews>) {
        let (store, written) = DecompressedBytes::for_live("live".into(), 0).unwrap();
        let format = WRITABLE.iter().find(|format| format.name == "pcapng").unwrap();
        let mut writer = (format.writer)(Box::new(BufWriter::new(written)), &WriteOptions::default());
        writer.flush().unwrap();
        let (news, found) = channel();
        let live = Some(LiveBuses { store: Arc::clone(&store), state: SharedLiveState::default() });
        let (read, session, rules) = (ReadOptions::default(), SessionOptions::default(), Arc::default());
        let join = JoinOptions::OFF;
        let timeline = Timeline::open(
            TimelineCaptures { paths: Vec::new(), align: false, join, read, session, rules, live },
            news,
        );
        (store, writer, timeline.unwrap(), found)
    }

    /// Shows the story of an error while the bus is still read, and the link that closes after the last frame.
    #[test]
    fn a_live_bus_has_stories_and_links_as_they_happen() {
        let (store, mut writer, timeline, found) = live_bus();
        write(&mut *writer, 0..4_000);
        let time = Timestamp(4_000_000_000);
        let error = Frame::data_frame(CanId::from_standard(0x81), &[0x10, 0x23, 1, 0, 0, 0, 0, 0]);
        writer.write(&Frame { time: Some(time), ..error }, "can0").unwrap();
        writer.flush().unwrap();
        let first_story = |survey: &SurveyResults| {
            let first = survey.diagnosis.as_ref()?.stories.first()?;
            Some((first.title.clone(), first.lines.first()?.text.clone(), survey.is_complete))
        };
        let (title, text, is_complete) = loop {
            let shown = first_story(&timeline.survey());
            if let Some(shown) = shown {
                break shown;
            }
            assert!(matches!(found.recv_timeout(LIMIT).unwrap(), TimelineNews::Grew));
            timeline.see_growth();
        };
        assert!(title.contains("EMCY 2310") && text.contains("still present") && !is_complete, "{text}");
        let before = timeline.progress().last_position();
        let (time, state) = (time.plus(1_000_000), cobscope_decoder::frame::LinkState::Down);
        writer.notice(&Notice::Link { bus: BusIndex(0), time, state, bit_rate: None }, "can0").unwrap();
        writer.flush().unwrap();
        while timeline.progress().last_position() == before {
            std::thread::yield_now();
        }
        let (target, matcher) = (SeekTarget::End, RowMatcher::default());
        timeline.request_window(WindowRequest {
            serial: 1,
            target,
            before: 5,
            after: 5,
            matcher,
            search: None,
        });
        let TimelineNews::Window(window) = until(&found, |news| matches!(news, TimelineNews::Window(_)))
        else {
            unreachable!()
        };
        assert_eq!(window.rows.last().map(|row| row.kind), Some("LINK"));
        store.end_input(None);
    }

    /// Evicted frames of a live bus cannot be reached, kept frames can.
    #[test]
    fn a_live_bus_is_kept_in_part_and_says_so() {
        const FRAMES: u64 = 600_000;
        let (store, mut writer, timeline, found) = live_bus();
        // Not faster than the index, so that nothing is evicted before it is indexed.
        for begin in (0..FRAMES).step_by(10_000) {
            write(&mut *writer, begin..begin + 10_000);
            while timeline.progress().frames() < begin + 10_000 {
                std::thread::yield_now();
            }
        }
        let dropped = timeline.dropped_frames();
        assert!(dropped > 0 && dropped < FRAMES / 2, "{dropped}");
        let matcher = RowMatcher::default();
        let order = |target| WindowRequest {
            serial: 1,
            target,
            before: 10,
            after: 10,
            matcher: matcher.clone(),
            search: None,
        };
        let go = |target| {
            timeline.request_window(order(target));
            match until(&found, |news| matches!(news, TimelineNews::Window(_) | TimelineNews::Failed(_))) {
                TimelineNews::Window(window) => window,
                TimelineNews::Failed(text) => panic!("{text}"),
                _ => unreachable!(),
            }
        };
        assert!(
            go(SeekTarget::Event(EventPosition::before_frame(1))).world.frames() >= dropped,
            "the first that is kept"
        );
        let window = go(SeekTarget::Event(EventPosition::after_frame(FRAMES - 100)));
        assert_eq!(window.world.frames(), FRAMES - 100);
        assert_eq!(go(SeekTarget::End).world.frames(), FRAMES, "without waiting for more");
        // Time without frames is reported and closes open conditions.
        let quiet = Timestamp(i64::try_from(FRAMES).unwrap() * 1_000_000 + 5_000_000_000);
        writer.notice(&Notice::Quiet(quiet), "can0").unwrap();
        let time = Timestamp(quiet.0 + 1_000_000);
        let link = Notice::Link {
            bus: BusIndex(0),
            time,
            state: cobscope_decoder::frame::LinkState::Down,
            bit_rate: None,
        };
        writer.notice(&link, "can0").unwrap();
        writer.flush().unwrap();
        store.end_input(None);
        until(&found, |news| matches!(news, TimelineNews::Indexed));
        assert_eq!(timeline.end_state().unwrap().last_time(), Some(time));
    }
}
