//! SYNC and TIME.

use crate::event::EventKind;
use crate::frame::Frame;
use crate::session::{Bus, Observer};
use crate::wire::canopen::{sync, time};

/// What is known of the SYNC.
#[derive(Debug, Clone, Default)]
pub(in crate::session) struct SyncState {
    seen: bool,
    counter: Option<u8>,
}

impl SyncState {
    /// Takes the next counter; gives the one that should have come if another came.
    ///
    /// The overflow value (1019) may be unknown, so a step back to 1 is always right (CiA 301 §7.2.5.3).
    fn take(&mut self, counter: Option<u8>) -> Option<u8> {
        let before = std::mem::replace(&mut self.counter, counter);
        let (before, now) = (before?, counter?);
        let expected = if before >= 240 { 1 } else { before + 1 };
        (now != expected && now != 1).then_some(expected)
    }
}

impl Bus {
    pub(in crate::session) fn on_sync(&mut self, frame: &Frame, out: &mut dyn Observer) {
        if !self.is_decoded(frame, out) {
            return;
        }
        self.clock.saw_periodic();
        let counter = sync::parse(frame.data());
        let first = !std::mem::replace(&mut self.sync.seen, true);
        let expected = self.sync.take(counter);
        let routine = !first && expected.is_none();
        self.emit(frame, 0, routine, EventKind::Sync { counter, expected }, out);
    }

    pub(in crate::session) fn on_time(&mut self, frame: &Frame, out: &mut dyn Observer) {
        if !self.is_decoded(frame, out) {
            return;
        }
        match time::parse(frame.data()) {
            Ok(time) => {
                let kind = EventKind::Time { milliseconds: time.milliseconds, days: time.days };
                self.emit(frame, 0, false, kind, out);
            }
            Err(error) => self.malformed(frame, 0, error, "TIME has six bytes", out),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn counters_run_to_their_overflow_and_start_at_one() {
        let mut state = SyncState::default();
        let gaps: Vec<_> = [1, 2, 3, 1, 2, 5, 6].iter().map(|counter| state.take(Some(*counter))).collect();
        assert_eq!(gaps, [None, None, None, None, None, Some(3), None]);
        assert_eq!(state.take(None), None);
    }
}
