//! Merges the items of several sources in time order.
//!
//! Sources are read at different moments, so items of several sources wait [`WINDOW`] for earlier ones. The
//! items of a single source do not wait. Without items the time still advances: it is reported in the clock
//! of the frames, so that rules can detect silence.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Receiver, RecvTimeoutError, SyncSender, sync_channel};
use std::time::{Duration, Instant};

use anyhow::Context as _;
use cobscope_decoder::capture::{BusNames, Notice};
use cobscope_decoder::frame::{BusIndex, Timestamp};

use super::clock::{ClockWatch, now};
use super::{Arrival, Arrivals, BusStatus, LiveSource, SourceEnd};

/// Time for which an item waits for earlier ones of other sources.
const WINDOW: Duration = Duration::from_millis(20);

/// Silence after which the time is reported, and interval of further reports.
const QUIET: Duration = Duration::from_millis(250);

/// Interval between two status requests.
const STATUS: Duration = Duration::from_secs(1);

/// Time for which a source waits before it checks for cancellation.
const WAIT: Duration = Duration::from_millis(100);

/// Maximum time to wait for the sources to close: they check for cancellation each `WAIT`.
const CLOSING: Duration = Duration::from_millis(500);

/// Time for which frames collect before they are read.
pub(super) const PACE: Duration = Duration::from_millis(15);

/// Number of frames per read from which reading continues without a pause, and number of held items from which further
/// deliveries wait, so that input faster than its consumer does not fill the memory.
const MANY: usize = 1_024;

/// Maximum number of queued deliveries. Beyond it sources wait, and losses in their buffers are counted.
const DELIVERIES: usize = 64;

/// A message of the thread of a source.
struct SourceDelivery {
    source: usize,
    what: SourceItem,
}

enum SourceItem {
    Items { names: BusNames, items: Vec<Arrival> },
    Status(Vec<BusStatus>),
    Ended(SourceEnd),
}

/// The merged sources.
pub struct SourceGather {
    inbox: Receiver<SourceDelivery>,
    lanes: Vec<SourceState>,
    names: BusNames,
    held: Vec<HeldItem>,
    frames: u64,
    /// Time of the newest item, and moment of its arrival.
    newest: Option<(Timestamp, Instant)>,
    reported_quiet: Option<Instant>,
    failures: Vec<anyhow::Error>,
    stop: Arc<AtomicBool>,
}

/// State of a source.
#[derive(Default)]
struct SourceState {
    /// Merged index of each bus of the source.
    buses: Vec<BusIndex>,
    /// Latest time of its items; other items are compared with it.
    clock: Timestamp,
    status: Vec<BusStatus>,
    lag: Duration,
    has_ended: bool,
}

/// An item that waits for earlier ones.
struct HeldItem {
    time: Timestamp,
    arrived: Instant,
    item: Arrival,
}

impl SourceGather {
    /// Starts a thread per source.
    ///
    /// # Errors
    /// A thread cannot be started.
    pub fn start(sources: Vec<Box<dyn LiveSource>>) -> anyhow::Result<Self> {
        let (outbox, inbox) = sync_channel(DELIVERIES);
        let stop = Arc::new(AtomicBool::new(false));
        let mut lanes = Vec::new();
        for (place, mut source) in sources.into_iter().enumerate() {
            lanes.push(SourceState {
                lag: source.max_lag(),
                status: source.bus_status(),
                ..SourceState::default()
            });
            let (outbox, stop) = (outbox.clone(), Arc::clone(&stop));
            let thread = std::thread::Builder::new().name("source".into());
            let work = move || {
                feed_source(&mut *source, place, &outbox, &stop);
                // Closes the adapter before `SourceGather::drop` sees that the thread has ended.
                drop(source);
                drop(outbox);
            };
            thread.spawn(work).context("cannot start a thread")?;
        }
        let names = BusNames::default();
        let (held, failures) = (Vec::new(), Vec::new());
        Ok(Self { inbox, lanes, names, held, frames: 0, newest: None, reported_quiet: None, failures, stop })
    }

    /// The next items in order, with frame numbers; empty after `wait`. `None` when all sources have ended.
    pub fn next(&mut self, wait: Duration) -> Option<Vec<Arrival>> {
        let wait = if self.held.is_empty() { wait } else { wait.min(WINDOW) };
        match self.inbox.recv_timeout(wait) {
            Ok(delivery) => {
                self.take_delivery(delivery);
                while self.held.len() < MANY
                    && let Ok(delivery) = self.inbox.try_recv()
                {
                    self.take_delivery(delivery);
                }
            }
            Err(RecvTimeoutError::Timeout) => {}
            Err(RecvTimeoutError::Disconnected) if self.held.is_empty() => return None,
            Err(RecvTimeoutError::Disconnected) => return Some(self.release_items(None)),
        }
        let now = Instant::now();
        let mut ready = self.release_items(Some(now));
        ready.extend(self.advance_notice(now).map(Arrival::Notice));
        Some(ready)
    }

    /// Names of all buses so far.
    pub fn names(&self) -> &BusNames {
        &self.names
    }

    /// Status of each bus.
    pub fn status(&self) -> impl Iterator<Item = &BusStatus> {
        self.lanes.iter().flat_map(|lane| &lane.status)
    }

    /// Removes and returns the failures of sources.
    pub fn take_failures(&mut self) -> Vec<anyhow::Error> {
        std::mem::take(&mut self.failures)
    }

    fn take_delivery(&mut self, SourceDelivery { source, what }: SourceDelivery) {
        let Some(lane) = self.lanes.get_mut(source) else { return };
        match what {
            SourceItem::Status(status) => lane.status = status,
            SourceItem::Ended(ended) => {
                lane.has_ended = true;
                if let SourceEnd::Failed(error) = ended {
                    self.failures.push(error);
                }
            }
            SourceItem::Items { names, items } => {
                let arrived = Instant::now();
                for mut item in items {
                    match &mut item {
                        Arrival::Frame(frame) => {
                            frame.bus = lane.merged_bus(frame.bus, &names, &mut self.names);
                        }
                        Arrival::Notice(
                            Notice::LostFrames { bus, .. }
                            | Notice::Link { bus, .. }
                            | Notice::ClockSet { bus, .. },
                        ) => {
                            *bus = lane.merged_bus(*bus, &names, &mut self.names);
                        }
                        Arrival::Notice(_) => {}
                    }
                    let time = match &item {
                        Arrival::Frame(frame) => frame.time,
                        Arrival::Notice(
                            Notice::Link { time, .. } | Notice::Quiet(time) | Notice::ClockSet { time, .. },
                        ) => Some(*time),
                        Arrival::Notice(_) => None,
                    };
                    // A clock that steps back does not delay other items: the items of a source keep their
                    // order.
                    lane.clock = time.map_or(lane.clock, |time| time.max(lane.clock));
                    self.newest = self.newest.max(Some((lane.clock, arrived)));
                    self.held.push(HeldItem { time: lane.clock, arrived, item });
                }
            }
        }
    }

    /// Items that need not wait any longer, in order; all items without `now`.
    fn release_items(&mut self, now: Option<Instant>) -> Vec<Arrival> {
        let is_alone = self.lanes.iter().filter(|lane| !lane.has_ended).count() < 2;
        let Some(now) = now.filter(|_| !is_alone) else {
            let all = std::mem::take(&mut self.held);
            return self.order_items(all);
        };
        let old = self.held.iter().filter(|held| now.saturating_duration_since(held.arrived) >= WINDOW);
        let Some(until) = old.map(|held| held.time).max() else { return Vec::new() };
        let (ready, held) = std::mem::take(&mut self.held).into_iter().partition(|held| held.time <= until);
        self.held = held;
        self.order_items(ready)
    }

    fn order_items(&mut self, mut items: Vec<HeldItem>) -> Vec<Arrival> {
        // A stable sort keeps items with equal times in order of arrival.
        items.sort_by_key(|held| held.time);
        let mut items: Vec<Arrival> = items.into_iter().map(|held| held.item).collect();
        for item in &mut items {
            if let Arrival::Frame(frame) = item {
                self.frames += 1;
                frame.number = self.frames;
            }
        }
        items
    }

    /// Reports the advance of time without items.
    fn advance_notice(&mut self, now: Instant) -> Option<Notice> {
        let (time, arrived) = self.newest?;
        let silence = now.saturating_duration_since(arrived);
        let is_reported =
            self.reported_quiet.is_some_and(|reported| now.saturating_duration_since(reported) < QUIET);
        let lag = self.lanes.iter().filter(|lane| !lane.has_ended).map(|lane| lane.lag).max()?;
        let known = silence.saturating_sub(lag + WINDOW);
        if is_reported || known < QUIET || !self.held.is_empty() {
            return None;
        }
        self.reported_quiet = Some(now);
        Some(Notice::Quiet(time.plus(i64::try_from(known.as_nanos()).unwrap_or(i64::MAX))))
    }
}

impl Drop for SourceGather {
    fn drop(&mut self) {
        self.stop.store(true, Ordering::Relaxed);
        // The program may end next: adapters are closed first. Deliveries are dropped so that no thread waits for room.
        let begin = Instant::now();
        loop {
            let left = CLOSING.saturating_sub(begin.elapsed());
            if self.inbox.recv_timeout(left).is_err() || left.is_zero() {
                break;
            }
        }
    }
}

impl SourceState {
    /// Merged index of a bus of a source. Buses of two sources with the same name are different buses.
    fn merged_bus(&mut self, own: BusIndex, own_names: &BusNames, names: &mut BusNames) -> BusIndex {
        while self.buses.len() <= usize::from(own.0) {
            let name = own_names.names().get(self.buses.len()).map_or("", String::as_str);
            let is_taken = |name: &str| names.names().iter().any(|known| known == name);
            let mut unique = name.to_owned();
            let mut twin = 2;
            while is_taken(&unique) && twin < u16::MAX {
                unique = format!("{name}@{twin}");
                twin += 1;
            }
            self.buses.push(names.index_of(unique.as_bytes()).unwrap_or(BusIndex(u8::MAX)));
        }
        self.buses.get(usize::from(own.0)).copied().unwrap_or_default()
    }
}

/// Reads a source until it ends or is cancelled.
fn feed_source(
    source: &mut dyn LiveSource,
    place: usize,
    outbox: &SyncSender<SourceDelivery>,
    stop: &AtomicBool,
) {
    let send = |what| outbox.send(SourceDelivery { source: place, what }).is_ok();
    let mut arrivals = Arrivals::default();
    let mut asked = Instant::now();
    let mut known = 0;
    let mut clock = source.has_local_times().then(|| ClockWatch::new(now(), Instant::now()));
    while !stop.load(Ordering::Relaxed) {
        let ended = source.receive_items(&mut arrivals, WAIT).err();
        let mut items = std::mem::take(&mut arrivals.items);
        let time = now();
        if let Some(step) = clock.as_mut().and_then(|clock| clock.step_since(time, Instant::now())) {
            let buses = (0..arrivals.names.names().len()).filter_map(|bus| u8::try_from(bus).ok());
            let set = |bus| Arrival::Notice(Notice::ClockSet { bus: BusIndex(bus), time, step });
            items.splice(..0, buses.map(set));
        }
        // Reading can end with these items: the status of their buses precedes them.
        let buses = arrivals.names.names().len();
        if buses > known && !send(SourceItem::Status(source.bus_status())) {
            return;
        }
        known = buses;
        let count = items.len();
        if count > 0 && !send(SourceItem::Items { names: arrivals.names.clone(), items }) {
            return;
        }
        // Frames collect during the pause: a wake-up costs a thousand times as much as a frame.
        if (1..MANY).contains(&count) && ended.is_none() {
            std::thread::sleep(PACE);
        }
        if let Some(ended) = ended {
            send(SourceItem::Status(source.bus_status()));
            send(SourceItem::Ended(ended));
            return;
        }
        if asked.elapsed() >= STATUS {
            asked = Instant::now();
            if !send(SourceItem::Status(source.bus_status())) {
                return;
            }
        }
    }
    send(SourceItem::Status(source.bus_status()));
}

#[cfg(test)]
mod tests {
    use std::collections::VecDeque;

    use cobscope_decoder::frame::{CanId, Frame, LinkState};

    use super::*;

    /// Returns its items one by one, then ends.
    struct Scripted {
        bus: &'static str,
        times: VecDeque<i64>,
    }

    impl LiveSource for Scripted {
        fn receive_items(&mut self, arrivals: &mut Arrivals, _wait: Duration) -> Result<(), SourceEnd> {
            let Some(time) = self.times.pop_front() else { return Err(SourceEnd::Complete) };
            let bus = arrivals.names.index_of(self.bus.as_bytes()).unwrap();
            let frame = Frame::data_frame(CanId::from_standard(0x123), &[]);
            arrivals.items.push(Arrival::Frame(Frame { bus, time: Some(Timestamp(time)), ..frame }));
            Ok(())
        }

        fn bus_status(&mut self) -> Vec<BusStatus> {
            Vec::new()
        }

        fn max_lag(&self) -> Duration {
            Duration::ZERO
        }
    }

    fn scripted(bus: &'static str, times: &[i64]) -> Box<dyn LiveSource> {
        Box::new(Scripted { bus, times: times.iter().copied().collect() })
    }

    /// Two sources without items.
    fn two(inbox: Receiver<SourceDelivery>) -> SourceGather {
        SourceGather {
            inbox,
            lanes: vec![SourceState::default(), SourceState::default()],
            names: BusNames::default(),
            held: Vec::new(),
            frames: 0,
            newest: None,
            reported_quiet: None,
            failures: Vec::new(),
            stop: Arc::default(),
        }
    }

    /// All items as bus, number and time.
    fn all(mut gather: SourceGather) -> Vec<(String, u64, i64)> {
        let mut found = Vec::new();
        while let Some(items) = gather.next(Duration::from_mins(1)) {
            for item in items {
                let Arrival::Frame(frame) = item else { panic!("{item:?}") };
                let name = gather.names().names()[usize::from(frame.bus.0)].clone();
                found.push((name, frame.number, frame.time.unwrap().0));
            }
        }
        found
    }

    /// The moments are simulated, so that the load of the machine does not matter.
    #[test]
    fn several_sources_are_one_in_order_of_time() {
        let (_outbox, inbox) = sync_channel(1);
        let now = Instant::now();
        let held = |time: i64, age: u64| {
            let frame =
                Frame { time: Some(Timestamp(time)), ..Frame::data_frame(CanId::from_standard(1), &[]) };
            let arrived = now.checked_sub(Duration::from_millis(age)).unwrap();
            HeldItem { time: Timestamp(time), arrived, item: Arrival::Frame(frame) }
        };
        let mut gather = two(inbox);
        gather.held = vec![held(10, 25), held(30, 21), held(50, 5), held(20, 19), held(40, 1)];
        let mut release = |later: u64| {
            let items = gather.release_items(Some(now + Duration::from_millis(later)));
            let time = |item| match item {
                Arrival::Frame(frame) => (frame.number, frame.time.unwrap().0),
                Arrival::Notice(notice) => panic!("{notice:?}"),
            };
            items.into_iter().map(time).collect::<Vec<_>>()
        };
        // Items older than 20 ms are released, together with later arrivals that have earlier times.
        assert_eq!(release(0), [(1, 10), (2, 20), (3, 30)]);
        assert_eq!(release(10), []);
        assert_eq!(release(15), [(4, 40), (5, 50)]);
    }

    #[test]
    fn one_source_keeps_its_order_and_two_of_one_name_are_two_buses() {
        let found = all(SourceGather::start(vec![scripted("can0", &[10, 5, 20])]).unwrap());
        assert_eq!(found.iter().map(|(_, _, time)| *time).collect::<Vec<_>>(), [10, 5, 20]);
        let found = all(SourceGather::start(vec![scripted("can0", &[1]), scripted("can0", &[2])]).unwrap());
        assert_eq!(found.iter().map(|(bus, ..)| bus.len()).sum::<usize>(), "can0".len() + "can0@2".len());
    }

    /// The moments are simulated.
    #[test]
    fn silence_is_reported_in_the_clock_of_the_frames() {
        let (_outbox, inbox) = sync_channel(1);
        let start = Instant::now();
        let mut gather = two(inbox);
        gather.lanes = vec![SourceState { lag: Duration::from_millis(10), ..SourceState::default() }];
        gather.newest = Some((Timestamp(1_000_000_000), start));
        let mut at = |millis| gather.advance_notice(start + Duration::from_millis(millis));
        assert_eq!(at(200), None);
        // Of 400 ms, 10 ms may still be under way and 20 ms are the window.
        assert_eq!(at(400), Some(Notice::Quiet(Timestamp(1_370_000_000))));
        assert_eq!(at(500), None, "told every 250 ms");
        assert_eq!(at(1_400), Some(Notice::Quiet(Timestamp(2_370_000_000))));
    }

    #[test]
    fn notices_stay_with_the_frames_around_them() {
        let (outbox, inbox) = sync_channel(4);
        let mut gather = two(inbox);
        let mut names = BusNames::default();
        let bus = names.index_of(b"can0").unwrap();
        let frame = |time| {
            let frame = Frame::data_frame(CanId::from_standard(1), &[]);
            Arrival::Frame(Frame { bus, time: Some(Timestamp(time)), ..frame })
        };
        let link =
            |time, state| Arrival::Notice(Notice::Link { bus, time: Timestamp(time), state, bit_rate: None });
        let items = vec![frame(5), link(6, LinkState::Down), link(8, LinkState::Up), frame(9)];
        outbox
            .send(SourceDelivery { source: 1, what: SourceItem::Items { names: names.clone(), items } })
            .unwrap();
        outbox
            .send(SourceDelivery { source: 0, what: SourceItem::Items { names, items: vec![frame(7)] } })
            .unwrap();
        drop(outbox);
        let mut order = Vec::new();
        while let Some(items) = gather.next(Duration::from_mins(1)) {
            order.extend(items.into_iter().map(|item| match item {
                Arrival::Frame(frame) => frame.time.unwrap().0,
                Arrival::Notice(Notice::Link { time, .. }) => time.0,
                Arrival::Notice(other) => panic!("{other:?}"),
            }));
        }
        assert_eq!(order, [5, 6, 7, 8, 9]);
    }
}
