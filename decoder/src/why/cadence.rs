//! Messages that came with a beat, and stopped: SYNC, guarding requests, RPDOs.

use crate::frame::Timestamp;
use crate::profile::PdoName;

/// A gap below this is no silence, in nanoseconds.
const SHORTEST: i64 = 20_000_000;

/// Beats of one node; it has at most 512 RPDOs, of which few come.
const LIMIT: usize = 16;

/// What comes with a beat.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Rhythm {
    /// SYNC.
    Sync,
    /// Guarding requests to the node.
    Guarding,
    /// An RPDO of the node.
    Rpdo(PdoName),
}

/// Something that came with a beat and did not come any more.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Quiet {
    /// What.
    pub what: Rhythm,
    /// Nanoseconds since the last one.
    pub gap: i64,
    /// Nanoseconds from one to the next before.
    pub usual: i64,
    /// Frame of the last one.
    pub last_frame: u64,
}

/// One beat.
#[derive(Debug, Clone, Copy)]
struct Beat {
    what: Rhythm,
    last: Timestamp,
    frame: u64,
    /// The last intervals, newest first, 0 = none.
    intervals: [i64; 4],
}

impl Beat {
    fn came(&mut self, time: Timestamp, frame: u64) {
        let [first, second, third, _] = self.intervals;
        self.intervals = [time.since(self.last).max(1), first, second, third];
        (self.last, self.frame) = (time, frame);
    }

    /// Whether it is silent, if it had a beat at all.
    fn quiet(&self, now: Timestamp) -> Option<Quiet> {
        let longest = self.intervals.into_iter().max()?;
        let shortest = self.intervals.into_iter().min()?;
        let had_beat = shortest > 0 && longest <= shortest.saturating_mul(2);
        let gap = now.since(self.last);
        let is_silent = gap > longest.saturating_mul(2) && gap > SHORTEST;
        (had_beat && is_silent).then_some(Quiet {
            what: self.what,
            gap,
            usual: longest,
            last_frame: self.frame,
        })
    }
}

/// Beats of a node, or of a bus.
#[derive(Debug, Clone, Default)]
pub(super) struct Beats(Vec<Beat>);

impl Beats {
    /// One more came.
    pub(super) fn came(&mut self, what: Rhythm, time: Option<Timestamp>, frame: u64) {
        let Some(time) = time else { return };
        let has_room = self.0.len() < LIMIT;
        match self.0.iter_mut().find(|beat| beat.what == what) {
            Some(beat) => beat.came(time, frame),
            None if has_room => {
                self.0.push(Beat { what, last: time, frame, intervals: [0; 4] });
            }
            None => {}
        }
    }

    /// Those that are silent.
    pub(super) fn quiet(&self, now: Option<Timestamp>) -> impl Iterator<Item = Quiet> {
        self.0.iter().filter_map(move |beat| beat.quiet(now?))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn quiet_after(intervals: &[i64], gap: i64) -> Option<Quiet> {
        let mut beats = Beats::default();
        let mut time = Timestamp(0);
        beats.came(Rhythm::Sync, Some(time), 1);
        for interval in intervals {
            time = time.plus(*interval * 1_000_000);
            beats.came(Rhythm::Sync, Some(time), 2);
        }
        beats.quiet(Some(time.plus(gap * 1_000_000))).next()
    }

    #[test]
    fn a_beat_that_stopped() {
        // The longest of the last four counts: 12 ms; silent from 24 ms on.
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
