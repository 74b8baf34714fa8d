//! Thread that reads from sources, records, and forwards.
//!
//! ```text
//! sources ─▶ gather ─▶ record
//!                  └─▶ consumer: lines, rules, screen
//! ```
//! Recording has priority: a slow consumer loses frames, and their number is reported; the recorded capture
//! is complete.

use std::collections::BTreeMap;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Receiver, SyncSender, TrySendError, sync_channel};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use anyhow::Context as _;
use cobscope_decoder::capture::{BusNames, CapturePlace, Notice};
use cobscope_decoder::frame::BusIndex;

use crate::record::{RecordStatus, Recorder};
use crate::source::live::{Arrival, LiveSource, SharedLiveState, SourceGather};

/// Maximum wait for frames before other work is done.
const WAIT: Duration = Duration::from_millis(50);

/// Capacity of the queue to the consumer, in deliveries.
const WAITING: usize = 256;

/// Items received at once.
pub(super) struct PendingDeliveries {
    /// Names of all buses known so far.
    pub(super) names: BusNames,
    /// Frames and notices in order.
    pub(super) items: Vec<Arrival>,
}

/// The reading thread.
pub(super) struct ReadingThread {
    /// State of buses and recording.
    pub(super) state: SharedLiveState,
    stop: Arc<AtomicBool>,
    thread: JoinHandle<Option<RecordStatus>>,
}

impl ReadingThread {
    /// Starts reading, up to `most` frames; items are delivered through the receiver.
    ///
    /// # Errors
    /// If the thread cannot be started.
    pub(super) fn start(
        sources: Vec<Box<dyn LiveSource>>,
        recorder: Option<Recorder>,
        most: Option<u64>,
    ) -> anyhow::Result<(Self, Receiver<PendingDeliveries>)> {
        let gather = SourceGather::start(sources)?;
        let (outbox, inbox) = sync_channel(WAITING);
        let (state, stop) = (SharedLiveState::default(), Arc::new(AtomicBool::new(false)));
        update_state(&gather, recorder.as_ref(), &state);
        let left = most.unwrap_or(u64::MAX);
        let work =
            PumpThread { gather, recorder, outbox, state: state.clone(), unseen: BTreeMap::new(), left };
        let stopped = Arc::clone(&stop);
        let thread = std::thread::Builder::new().name("pump".into());
        let thread = thread.spawn(move || work.run(&stopped)).context("cannot start a thread")?;
        Ok((Self { state, stop, thread }, inbox))
    }

    /// Stops reading, after the receiver was dropped; returns the result of recording.
    pub(super) fn finish(self) -> Option<RecordStatus> {
        self.stop.store(true, Ordering::Relaxed);
        self.thread.join().ok().flatten()
    }
}

struct PumpThread {
    gather: SourceGather,
    recorder: Option<Recorder>,
    outbox: SyncSender<PendingDeliveries>,
    state: SharedLiveState,
    /// Number of frames per bus that the consumer did not get.
    unseen: BTreeMap<u8, u64>,
    /// Number of frames still to read.
    left: u64,
}

impl PumpThread {
    fn run(mut self, stop: &AtomicBool) -> Option<RecordStatus> {
        while !stop.load(Ordering::Relaxed) {
            let arrived = if self.left > 0 { self.gather.next(WAIT) } else { None };
            let has_ended = arrived.is_none();
            let mut items = arrived.unwrap_or_default();
            self.limit(&mut items);
            self.record(&items);
            update_state(&self.gather, self.recorder.as_ref(), &self.state);
            for failure in self.gather.take_failures() {
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

    /// Drops items after the last requested frame.
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
        for item in items {
            match item {
                Arrival::Frame(frame) => recorder.frame(frame, names.name_of(frame.bus)),
                Arrival::Notice(notice) => recorder.notice(notice, names.name_of(notice.bus())),
            }
        }
        recorder.tick(Instant::now());
    }

    /// Forwards items; `false` if the receiver was dropped.
    fn pass_on(&mut self, mut items: Vec<Arrival>) -> bool {
        let names = self.gather.names().clone();
        if self.recorder.is_none() {
            // Without recording the pump can wait; frames lost by the sources meanwhile are counted there.
            return self.outbox.send(PendingDeliveries { names, items }).is_ok();
        }
        let lost = std::mem::take(&mut self.unseen).into_iter().map(|(bus, count)| {
            let (place, bus, count) = (CapturePlace::Now, BusIndex(bus), Some(count));
            Arrival::Notice(Notice::LostFrames { place, bus, count })
        });
        items.splice(0..0, lost);
        match self.outbox.try_send(PendingDeliveries { names, items }) {
            Ok(()) => true,
            Err(TrySendError::Disconnected(_)) => false,
            Err(TrySendError::Full(PendingDeliveries { items, .. })) => {
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

/// Publishes the state of buses and recording.
fn update_state(gather: &SourceGather, recorder: Option<&Recorder>, state: &SharedLiveState) {
    let mut live = state.get();
    live.buses.clear();
    live.buses.extend(gather.status().cloned());
    live.record = recorder.map(Recorder::status);
}
