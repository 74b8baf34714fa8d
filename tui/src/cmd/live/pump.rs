//! Takes what comes, records it, and passes it on.
//!
//! ```text
//! sources ─▶ gather ─▶ record
//!                  └─▶ whoever looks: lines, rules, screen
//! ```
//! The record goes first: who looks too slowly loses, and is told how much; the record does not.

use std::collections::BTreeMap;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Receiver, SyncSender, TrySendError, sync_channel};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use anyhow::Context as _;
use cobscope_decoder::capture::{BusNames, Notice, Place};
use cobscope_decoder::frame::BusIndex;

use crate::record::{RecordStatus, Recorder};
use crate::source::live::{Arrival, Gather, LiveState, Source};

/// How long nothing is waited for at most.
const WAIT: Duration = Duration::from_millis(50);

/// Deliveries that wait for who looks.
const WAITING: usize = 256;

/// What came at once.
pub(super) struct Came {
    /// Names of all buses so far.
    pub(super) names: BusNames,
    /// In order.
    pub(super) items: Vec<Arrival>,
}

/// Sources and record.
pub(super) struct Pump {
    /// How buses and record are.
    pub(super) state: LiveState,
    stop: Arc<AtomicBool>,
    thread: JoinHandle<Option<RecordStatus>>,
}

impl Pump {
    /// Begins to read, `most` frames at most; what comes is to be taken from the receiver.
    ///
    /// # Errors
    /// When no thread can be started.
    pub(super) fn start(
        sources: Vec<Box<dyn Source>>,
        recorder: Option<Recorder>,
        most: Option<u64>,
    ) -> anyhow::Result<(Self, Receiver<Came>)> {
        let gather = Gather::start(sources)?;
        let (outbox, inbox) = sync_channel(WAITING);
        let (state, stop) = (LiveState::default(), Arc::new(AtomicBool::new(false)));
        tell(&gather, recorder.as_ref(), &state);
        let left = most.unwrap_or(u64::MAX);
        let work = Work { gather, recorder, outbox, state: state.clone(), unseen: BTreeMap::new(), left };
        let stopped = Arc::clone(&stop);
        let thread = std::thread::Builder::new().name("pump".into());
        let thread = thread.spawn(move || work.run(&stopped)).context("no thread can be started")?;
        Ok((Self { state, stop, thread }, inbox))
    }

    /// Ends reading, when nobody waits to take more; what came of the record.
    pub(super) fn finish(self) -> Option<RecordStatus> {
        self.stop.store(true, Ordering::Relaxed);
        self.thread.join().ok().flatten()
    }
}

struct Work {
    gather: Gather,
    recorder: Option<Recorder>,
    outbox: SyncSender<Came>,
    state: LiveState,
    /// Frames of each bus that who looks did not get.
    unseen: BTreeMap<u8, u64>,
    /// Frames that are still wanted.
    left: u64,
}

impl Work {
    fn run(mut self, stop: &AtomicBool) -> Option<RecordStatus> {
        while !stop.load(Ordering::Relaxed) {
            let came = if self.left > 0 { self.gather.next(WAIT) } else { None };
            let has_ended = came.is_none();
            let mut items = came.unwrap_or_default();
            self.limit(&mut items);
            self.record(&items);
            tell(&self.gather, self.recorder.as_ref(), &self.state);
            for failure in self.gather.failures() {
                self.state.get().failure = Some(format!("{failure:#}"));
            }
            if has_ended {
                self.state.get().has_ended = true;
                break;
            }
            if !items.is_empty() && !self.pass_on(items) {
                break;
            }
        }
        self.recorder.map(Recorder::finish)
    }

    /// Leaves out what comes behind the last frame that is wanted.
    fn limit(&mut self, items: &mut Vec<Arrival>) {
        let frames = items.iter().enumerate().filter(|(_, item)| matches!(item, Arrival::Frame(_)));
        let mut count = 0;
        let mut end = items.len();
        for (place, _) in frames {
            count += 1;
            if count == self.left {
                end = place + 1;
                break;
            }
        }
        items.truncate(end);
        self.left -= count;
    }

    fn record(&mut self, items: &[Arrival]) {
        let Some(recorder) = &mut self.recorder else { return };
        let names = self.gather.names();
        let name = |bus: BusIndex| names.names().get(usize::from(bus.0)).map_or("", String::as_str);
        for item in items {
            match item {
                Arrival::Frame(frame) => recorder.frame(frame, name(frame.bus)),
                Arrival::Notice(notice) => recorder.notice(notice, name(notice.bus())),
            }
        }
        recorder.tick(Instant::now());
    }

    /// Passes items on; `false` when nobody looks any more.
    fn pass_on(&mut self, mut items: Vec<Arrival>) -> bool {
        let names = self.gather.names().clone();
        if self.recorder.is_none() {
            // Nothing else is lost by waiting; what the sources lose meanwhile they count.
            return self.outbox.send(Came { names, items }).is_ok();
        }
        let lost = std::mem::take(&mut self.unseen).into_iter().map(|(bus, count)| {
            let (place, bus, count) = (Place::Now, BusIndex(bus), Some(count));
            Arrival::Notice(Notice::LostFrames { place, bus, count })
        });
        items.splice(0..0, lost);
        match self.outbox.try_send(Came { names, items }) {
            Ok(()) => true,
            Err(TrySendError::Disconnected(_)) => false,
            Err(TrySendError::Full(Came { items, .. })) => {
                for item in items {
                    let (bus, count) = match item {
                        Arrival::Frame(frame) => (frame.bus, 1),
                        Arrival::Notice(Notice::LostFrames { bus, count, .. }) => (bus, count.unwrap_or(1)),
                        Arrival::Notice(_) => continue,
                    };
                    let unseen = self.unseen.entry(bus.0).or_default();
                    *unseen = unseen.saturating_add(count);
                }
                true
            }
        }
    }
}

/// Says how buses and record are.
fn tell(gather: &Gather, recorder: Option<&Recorder>, state: &LiveState) {
    let mut live = state.get();
    live.buses.clear();
    live.buses.extend(gather.status().cloned());
    live.record = recorder.map(Recorder::status);
}
