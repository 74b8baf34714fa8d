//! Periodic messages that stopped: SYNC, guarding requests, RPDOs.

use crate::frame::Timestamp;
use crate::profile::PdoName;

/// Minimum gap that counts as silence, in ns.
const SHORTEST: i64 = 20_000_000;

/// Maximum number of periodic messages per node. A node has up to 512 RPDOs, but few of them are used.
const LIMIT: usize = 16;

/// Kind of periodic message.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Rhythm {
    /// SYNC.
    Sync,
    /// Guarding requests to the node.
    Guarding,
    /// RPDO to the node.
    Rpdo(PdoName),
}

/// A periodic message that stopped.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct StoppedMessage {
    /// Kind of message.
    pub what: Rhythm,
    /// Time since the last one, in ns.
    pub gap: i64,
    /// Interval before it stopped, in ns.
    pub usual: i64,
    /// Frame of the last one.
    pub last_frame: u64,
}

/// Timing of one kind of message.
#[derive(Debug, Clone, Copy)]
struct Beat {
    what: Rhythm,
    last: Timestamp,
    frame: u64,
    /// Last intervals, newest first; 0 for none.
    intervals: [i64; 4],
}

impl Beat {
    fn add(&mut self, time: Timestamp, frame: u64) {
        let [first, second, third, _] = self.intervals;
        self.intervals = [time.since(self.last).max(1), first, second, third];
        (self.last, self.frame) = (time, frame);
    }

    /// The silence at `now`; `None` if the message was not periodic or is not overdue.
    fn quiet(&self, now: Timestamp) -> Option<StoppedMessage> {
        let longest = self.intervals.into_iter().max()?;
        let shortest = self.intervals.into_iter().min()?;
        let had_beat = shortest > 0 && longest <= shortest.saturating_mul(2);
        let gap = now.since(self.last);
        let is_silent = gap > longest.saturating_mul(2) && gap > SHORTEST;
        (had_beat && is_silent).then_some(StoppedMessage {
            what: self.what,
            gap,
            usual: longest,
            last_frame: self.frame,
        })
    }
}

/// Periodic messages of a node or of a bus.
#[derive(Debug, Clone, Default)]
pub(super) struct Beats(Vec<Beat>);

impl Beats {
    /// Records a message.
    pub(super) fn add(&mut self, what: Rhythm, time: Option<Timestamp>, frame: u64) {
        let Some(time) = time else { return };
        let has_room = self.0.len() < LIMIT;
        match self.0.iter_mut().find(|beat| beat.what == what) {
            Some(beat) => beat.add(time, frame),
            None if has_room => {
                self.0.push(Beat { what, last: time, frame, intervals: [0; 4] });
            }
            None => {}
        }
    }

    /// Messages that are overdue at `now`.
    pub(super) fn quiet(&self, now: Option<Timestamp>) -> impl Iterator<Item = StoppedMessage> {
        self.0.iter().filter_map(move |beat| beat.quiet(now?))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn quiet_after(intervals: &[i64], gap: i64) -> Option<StoppedMessage> {
        let mut beats = Beats::default();
        let mut time = Timestamp(0);
        beats.add(Rhythm::Sync, Some(time), 1);
        for interval in intervals {
            time = time.plus(*interval * 1_000_000);
            beats.add(Rhythm::Sync, Some(time), 2);
        }
        beats.quiet(Some(time.plus(gap * 1_000_000))).next()
    }

    #[test]
    fn a_beat_that_stopped() {
        // The longest of the last four intervals is 12 ms, so silence starts after 24 ms.
        let quiet = quiet_after(&[10, 10, 12, 10], 25).unwrap();
        assert_eq!((quiet.usual, quiet.gap, quiet.last_frame), (12_000_000, 25_000_000, 2));
        assert_eq!(quiet_after(&[10, 10, 12, 10], 24), None);
    }

    #[test]
    fn no_beat_no_silence() {
        assert_eq!(quiet_after(&[10, 10, 10], 1000), None);
        assert_eq!(quiet_after(&[10, 10, 25, 10], 1000), None);
        assert_eq!(quiet_after(&[1, 1, 1, 1], 20), None);
    }
}
