//! Captures as one line of time that can be gone to and fro.
//!
//! ```text
//!            ┌─ index ──▶ marks, progress          one pass, leaves a world every 262,144 frames
//! captures ──┼─ survey ─▶ findings, exchanges …    one pass, judges
//!            ├─ matches ▶ which frames are shown   one pass a filter
//!            ├─ traces ─▶ signals over time        from the nearest mark
//!            └─ seek ───▶ rows and world at a place, from the nearest mark
//! ```
//!
//! Each is a thread; what they find lies in [`Shared`], and a piece of [`News`] says that it changed.

mod load;
mod matches;
mod news;
mod order;
mod row;
mod shared;
pub mod signal;
mod survey;
mod threads;
mod traces;
mod walk;

use std::path::PathBuf;
use std::sync::atomic::Ordering;
use std::sync::mpsc::{Sender, channel};
use std::sync::{Arc, PoisonError, RwLockReadGuard};

use anyhow::Context as _;
use cobscope_decoder::capture::{Batch, ReadOptions, Reader};
use cobscope_decoder::frame::Timestamp;
use cobscope_decoder::replay::World;
use cobscope_decoder::rules::Setup;
use cobscope_decoder::session::SessionOptions;

pub use load::{LoadOverTime, Step};
pub use matches::{Matcher, Matches};
pub use news::News;
pub use order::{Order, Search, Target, Window};
pub use row::Row;
pub use shared::{Lane, Progress, Shared};
pub use signal::SignalKey;
pub use survey::{Exchange, MOST_EXCHANGES, Occurred, Opened, Survey, bit_rate_change};
pub use threads::Export;
pub use traces::{MOST_SIGNALS, Points, Traces};

pub use crate::bucket::Bucket;
use crate::source::live::LiveState;
use crate::source::{Arranged, Store, arrange};

/// What a timeline is made of.
pub struct Captures {
    /// Files; `-` is standard input.
    pub paths: Vec<PathBuf>,
    /// Lets all begin at the same moment.
    pub align: bool,
    /// How they are read.
    pub read: ReadOptions,
    /// How they are understood.
    pub session: SessionOptions,
    /// How they are judged.
    pub rules: Arc<Setup>,
    /// Live buses instead of files.
    pub live: Option<LiveBuses>,
}

/// Live buses: what came of them, and how they are.
#[derive(Clone)]
pub struct LiveBuses {
    /// What came.
    pub store: Arc<Store>,
    /// How they are.
    pub state: LiveState,
}

/// Captures being read in the background.
pub struct Timeline {
    shared: Arc<Shared>,
    orders: Sender<Order>,
    news: Sender<News>,
    first: Option<Timestamp>,
    live: Option<LiveState>,
}

impl Timeline {
    /// Opens captures and begins to read them; what is found goes to `news`.
    ///
    /// # Errors
    /// When a capture cannot be opened or is in no known format, or when captures with and without dates
    /// are to be put on one line of time without `align`.
    pub fn open(captures: Captures, news: Sender<News>) -> anyhow::Result<Self> {
        let live = captures.live.as_ref().map(|live| live.state.clone());
        let (lanes, first) = match &captures.live {
            Some(live) => (vec![live_lane(live)], None),
            None => lanes(&captures)?,
        };
        let shared = Arc::new(Shared::new(lanes, captures.session, captures.read));
        let (orders, inbox) = channel();
        let rules = captures.rules;
        spawn("index", &shared, &news, |shared, news| threads::index::run(shared, news))?;
        spawn("survey", &shared, &news, move |shared, news| threads::survey::run(shared, &rules, news))?;
        spawn("seek", &shared, &news, move |shared, news| threads::seek::run(shared, &inbox, news))?;
        Ok(Self { shared, orders, news, first, live })
    }

    /// Time of the first frame of all.
    pub fn first(&self) -> Option<Timestamp> {
        self.first
    }

    /// Wants to know what is at a place.
    pub fn order(&self, order: Order) {
        // Without its thread there is nobody to answer, and that was told.
        let _ = self.orders.send(order);
    }

    /// Looks for the events that are shown; an earlier search ends.
    pub fn search(&self, matcher: Matcher) {
        let mut current = self.shared.matches.write().unwrap_or_else(PoisonError::into_inner);
        if let Some(old) = current.take() {
            old.stop();
        }
        if matcher.takes_all() {
            return;
        }
        let found = Arc::new(Matches::new(matcher));
        *current = Some(Arc::clone(&found));
        drop(current);
        let told = spawn("matches", &self.shared, &self.news, move |shared, news| {
            threads::matches::run(shared, &found, news);
        });
        if let Err(error) = told {
            let _ = self.news.send(News::Failed(format!("{error:#}")));
        }
    }

    /// Writes a part of the captures to a file; what came of it is told.
    pub fn export(&self, export: Export) {
        let told = spawn("export", &self.shared, &self.news, move |shared, news| {
            threads::export::run(shared, &export, news);
        });
        if let Err(error) = told {
            let _ = self.news.send(News::Failed(format!("{error:#}")));
        }
    }

    /// The search for the events that are shown.
    pub fn matches(&self) -> Option<Arc<Matches>> {
        self.shared.matches.read().unwrap_or_else(PoisonError::into_inner).clone()
    }

    /// Begins to follow signals from a time on, to another one or to the end.
    pub fn trace(&self, signals: Vec<SignalKey>, from: Timestamp, to: Option<Timestamp>) -> Arc<Traces> {
        let traces = Arc::new(Traces::new(signals, from, to));
        self.shared.tracing.fetch_add(1, Ordering::Relaxed);
        let job = Arc::clone(&traces);
        let told = spawn("traces", &self.shared, &self.news, move |shared, news| {
            threads::traces::run(shared, &job, news);
        });
        if let Err(error) = told {
            self.shared.tracing.fetch_sub(1, Ordering::Relaxed);
            let _ = self.news.send(News::Failed(format!("{error:#}")));
        }
        traces
    }

    /// Whether signals are being followed.
    pub fn is_tracing(&self) -> bool {
        self.shared.tracing.load(Ordering::Acquire) > 0
    }

    /// How far the index has come.
    pub fn progress(&self) -> &Progress {
        &self.shared.progress
    }

    /// What the whole capture comes to, so far.
    pub fn survey(&self) -> RwLockReadGuard<'_, Survey> {
        self.shared.survey.read().unwrap_or_else(PoisonError::into_inner)
    }

    /// The world at the end, once it is known.
    pub fn end(&self) -> Option<Arc<World>> {
        self.shared.end.lock().unwrap_or_else(PoisonError::into_inner).clone()
    }

    /// Why reading ended early, if it did.
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

    /// Whether more of a capture may come.
    pub fn grows(&self) -> bool {
        self.shared.grows()
    }

    /// What grew has been seen: further growth is told again.
    pub fn see_growth(&self) {
        self.shared.has_told_growth.store(false, Ordering::Release);
    }

    /// How the buses are, where they are live.
    pub fn live(&self) -> Option<&LiveState> {
        self.live.as_ref()
    }

    /// Frames at the beginning of a live bus that are not kept any more.
    pub fn dropped(&self) -> u64 {
        self.shared.first_kept().map_or(0, |mark| mark.frames)
    }

    /// The captures.
    pub fn lanes(&self) -> &[Lane] {
        &self.shared.lanes
    }

    /// Decompressed bytes there are by now, and whether that is all.
    pub fn length(&self) -> (u64, bool) {
        let lengths = self.shared.lanes.iter().map(|lane| lane.store.length());
        lengths.fold((0, true), |(sum, all), (length, is_all)| (sum + length, all && is_all))
    }
}

impl Drop for Timeline {
    fn drop(&mut self) {
        if let Some(matches) = self.matches() {
            matches.stop();
        }
        self.shared.stop();
    }
}

fn spawn(
    name: &str,
    shared: &Arc<Shared>,
    news: &Sender<News>,
    run: impl FnOnce(&Arc<Shared>, &Sender<News>) + Send + 'static,
) -> anyhow::Result<()> {
    let (shared, news) = (Arc::clone(shared), news.clone());
    let thread = std::thread::Builder::new().name(name.into());
    thread.spawn(move || run(&shared, &news)).context("no thread can be started")?;
    Ok(())
}

/// Nothing of a live bus need have come.
fn live_lane(live: &LiveBuses) -> Lane {
    let store = Arc::clone(&live.store);
    Lane { store, group: 0, shift: 0, format: "live", is_live: true }
}

/// Opens each capture, and puts their clocks side by side.
fn lanes(captures: &Captures) -> anyhow::Result<(Vec<Lane>, Option<Timestamp>)> {
    let mut lanes: Vec<Lane> = Vec::new();
    let (mut names, mut firsts) = (Vec::new(), Vec::new());
    for path in &captures.paths {
        let store = Store::open(path)?;
        let name = store.name().to_owned();
        let mut reader = Reader::open(store.reader(0), &captures.read).with_context(|| name.clone())?;
        let mut batch = Batch::new();
        while batch.frames().is_empty() && reader.read(&mut batch).with_context(|| name.clone())? {}
        let first = batch.frames().first().with_context(|| format!("{name}: holds no frame"))?;
        firsts.push(first.time);
        names.push(name);
        let format = reader.format().title;
        lanes.push(Lane { store, group: 0, shift: 0, format, is_live: false });
    }
    for (lane, Arranged { group, shift }) in lanes.iter_mut().zip(arrange(&names, &firsts, captures.align)?) {
        (lane.group, lane.shift) = (group, shift);
    }
    let times = firsts.iter().flatten();
    let first = if captures.align { times.max() } else { times.min() };
    Ok((lanes, first.copied()))
}

#[cfg(test)]
mod tests {
    use cobscope_decoder::replay::Spot;
    use std::io::BufWriter;
    use std::sync::mpsc::Receiver;
    use std::time::Duration;

    use cobscope_decoder::capture::{FrameWriter, Notice, WRITABLE, WriteOptions};
    use cobscope_decoder::frame::{BusIndex, CanId, Frame};

    use super::*;

    /// How long something may take on a busy machine before it counts as not happening.
    const LIMIT: Duration = Duration::from_mins(1);

    fn until(news: &Receiver<News>, is_so: impl Fn(&News) -> bool) -> News {
        loop {
            let next = news.recv_timeout(LIMIT).unwrap();
            if is_so(&next) {
                return next;
            }
        }
    }

    /// Heartbeats, one a millisecond.
    fn write(writer: &mut dyn FrameWriter, numbers: std::ops::Range<u64>) {
        for number in numbers {
            let node = 1 + u16::try_from(number % 4).unwrap();
            let time = Some(Timestamp(i64::try_from(number).unwrap() * 1_000_000));
            let frame = Frame { time, ..Frame::data_frame(CanId::standard(0x700 + node), &[5]) };
            writer.write(&frame, "can0").unwrap();
        }
        writer.flush().unwrap();
    }

    /// What is dropped at the beginning of a live bus cannot be gone to, and what is kept can.
    #[test]
    fn a_live_bus_is_kept_in_part_and_says_so() {
        const FRAMES: u64 = 600_000;
        let (store, written) = Store::live("live".into(), 0).unwrap();
        let format = WRITABLE.iter().find(|format| format.name == "pcapng").unwrap();
        let mut writer = (format.writer)(Box::new(BufWriter::new(written)), &WriteOptions::default());
        writer.flush().unwrap();
        let (news, found) = channel();
        let live = Some(LiveBuses { store: Arc::clone(&store), state: LiveState::default() });
        let (read, session, rules) = (ReadOptions::default(), SessionOptions::default(), Arc::default());
        let timeline =
            Timeline::open(Captures { paths: Vec::new(), align: false, read, session, rules, live }, news);
        let timeline = timeline.unwrap();
        // No faster than it is indexed: what is dropped before that is never seen.
        for begin in (0..FRAMES).step_by(10_000) {
            write(&mut *writer, begin..begin + 10_000);
            while timeline.progress().frames() < begin + 10_000 {
                std::thread::yield_now();
            }
        }
        let dropped = timeline.dropped();
        assert!(dropped > 0 && dropped < FRAMES / 2, "{dropped}");
        let matcher = Matcher::default();
        let order = |target| Order {
            serial: 1,
            target,
            before: 10,
            after: 10,
            matcher: matcher.clone(),
            search: None,
        };
        let go = |target| {
            timeline.order(order(target));
            match until(&found, |news| matches!(news, News::Window(_) | News::Failed(_))) {
                News::Window(window) => window,
                News::Failed(text) => panic!("{text}"),
                _ => unreachable!(),
            }
        };
        assert!(go(Target::Spot(Spot::before(1))).world.frames() >= dropped, "the first that is kept");
        let window = go(Target::Spot(Spot::behind(FRAMES - 100)));
        assert_eq!(window.world.frames(), FRAMES - 100);
        assert_eq!(go(Target::End).world.frames(), FRAMES, "without waiting for more");
        // Time that passes without a frame is told, and closes what it closes.
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
        store.end(None);
        until(&found, |news| matches!(news, News::Indexed));
        assert_eq!(timeline.end().unwrap().time(), Some(time));
    }
}
