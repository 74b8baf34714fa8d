//! Bursts of error frames: one line for the first one, one at the end of the burst.

use std::fmt::Write as _;

use crate::event::{Event, EventKind, FrameRange};
use crate::frame::{BusIndex, Timestamp};
use crate::session::Bus;
use crate::wire::error_frame::ErrorFrameFields;
use crate::words::count_noun;

/// Maximum time between two error frames of one burst, in ns.
const BURST: i64 = 1_000_000_000;

/// Maximum number of buses with a burst.
const BUSES: usize = 64;

/// Error frames that follow each other on one bus.
#[derive(Debug, Clone)]
struct ErrorBurst {
    bus: BusIndex,
    /// Name of the bus, for lines of the second and further buses.
    name: String,
    error: ErrorFrameFields,
    first: Option<Timestamp>,
    last: Option<Timestamp>,
    frames: FrameRange,
    /// Number of error frames after the printed one.
    more: u64,
}

/// Bursts of all buses.
#[derive(Debug, Clone, Default)]
pub(super) struct ErrorBursts(Vec<ErrorBurst>);

/// End of a burst for output.
pub(super) struct BurstEnd {
    pub(super) bus: String,
    pub(super) time: Option<Timestamp>,
    pub(super) frames: FrameRange,
    pub(super) text: String,
}

impl ErrorBursts {
    /// Whether an event is a further error frame of a burst, which is not printed.
    pub(super) fn absorbs_event(&mut self, event: &Event, bus: &Bus) -> bool {
        let EventKind::CanError(error) = &event.kind else { return false };
        if error.is_only_counters() {
            return false;
        }
        let known = self.0.iter_mut().find(|burst| burst.bus == event.bus);
        let known = known.filter(|burst| burst.is_alike(*error) && !burst.is_over(event.time));
        if let Some(burst) = known {
            burst.more = burst.more.saturating_add(1);
            burst.last = event.time;
            burst.frames.last = event.frames.last;
            return true;
        }
        self.0.retain(|burst| burst.bus != event.bus);
        if self.0.len() < BUSES {
            self.0.push(ErrorBurst {
                bus: event.bus,
                name: if event.bus.0 == 0 { String::new() } else { bus.name().to_owned() },
                error: *error,
                first: event.time,
                last: event.time,
                frames: event.frames,
                more: 0,
            });
        }
        false
    }

    /// Whether no burst can end.
    pub(super) fn is_empty(&self) -> bool {
        self.0.is_empty()
    }

    /// Bursts that have ended before an event, or all at the end of the output.
    pub(super) fn ended_bursts(&mut self, event: Option<&Event>) -> Vec<BurstEnd> {
        let has_ended = |burst: &ErrorBurst| match event {
            None => true,
            Some(event) => {
                let other = match &event.kind {
                    EventKind::CanError(error) => event.bus == burst.bus && !burst.is_alike(*error),
                    _ => false,
                };
                other || burst.is_over(event.time)
            }
        };
        let (over, open) = std::mem::take(&mut self.0).into_iter().partition(has_ended);
        self.0 = open;
        let over: Vec<ErrorBurst> = over;
        over.iter().filter(|burst| burst.more > 0).map(ErrorBurst::burst_end).collect()
    }
}

impl ErrorBurst {
    /// Counters differ between error frames of one burst.
    fn is_alike(&self, error: ErrorFrameFields) -> bool {
        (self.error.classes, self.error.controller, self.error.protocol, self.error.location)
            == (error.classes, error.controller, error.protocol, error.location)
    }

    fn is_over(&self, now: Option<Timestamp>) -> bool {
        now.zip(self.last).is_some_and(|(now, last)| now.since(last) > BURST)
    }

    fn burst_end(&self) -> BurstEnd {
        let mut text = format!("burst of {}", count_noun(self.more.saturating_add(1), "error frame"));
        if let Some((first, last)) = self.first.zip(self.last) {
            let milliseconds = last.since(first).max(0) / 1_000_000;
            let _ = write!(text, " in {}.{:03} s", milliseconds / 1_000, milliseconds % 1_000);
        }
        BurstEnd { bus: self.name.clone(), time: self.last, frames: self.frames, text }
    }
}
