//! Periodic messages that stopped: SYNC, guarding requests, RPDOs.

use crate::frame::Timestamp;
use crate::profile::PdoName;

/// Minimum gap that counts as silence, in ns.
const SHORTEST: i64 = 20_000_000;

/// Maximum number of periodic messages per node. A node has up to 512 RPDOs, but few of them are used.
const LIMIT: usize = 16;

/// Kind of periodic message.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum MessageRhythm {
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
    pub what: MessageRhythm,
    /// Time since the last one, in ns.
    pub gap: i64,
    /// Interval before it stopped, in ns.
    pub usual: i64,
    /// Frame of the last one.
    pub last_frame: u64,
}

/// Times of the last messages of one kind.
#[derive(Debug, Clone, Copy)]
pub(super) struct MessageTimes {
    last: Timestamp,
    /// Frame of the last one.
    frame: u64,
    /// Last intervals, newest first; 0 for none.
    intervals: [i64; 4],
}

impl MessageTimes {
    /// Before the first message.
    /// The first interval after it is longer than any other.
    pub(super) const NONE: Self = Self { last: Timestamp(i64::MIN), frame: 0, intervals: [0; 4] };

    /// Records a message.
    #[inline]
    pub(super) fn add_message(&mut self, time: Timestamp, frame: u64) {
        let [first, second, third, _] = self.intervals;
        self.intervals = [time.since(self.last).max(1), first, second, third];
        (self.last, self.frame) = (time, frame);
    }

    /// The silence at `now`; `None` if the message was not periodic or is not overdue.
    fn silence_at(&self, what: MessageRhythm, now: Timestamp) -> Option<StoppedMessage> {
        let longest = self.intervals.into_iter().max()?;
        let shortest = self.intervals.into_iter().min()?;
        let had_beat = shortest > 0 && longest <= shortest.saturating_mul(2);
        let gap = now.since(self.last);
        let is_silent = gap > longest.saturating_mul(2) && gap > SHORTEST;
        (had_beat && is_silent).then_some(StoppedMessage {
            what,
            gap,
            usual: longest,
            last_frame: self.frame,
        })
    }
}

/// Messages of one kind.
#[derive(Debug, Clone, Copy)]
struct ListedMessages {
    what: MessageRhythm,
    /// Index of the identifier whose times are current; those in `beat` are then older.
    identifier: Option<usize>,
    beat: MessageTimes,
}

/// Periodic messages of a node or of a bus, in order of appearance.
#[derive(Debug, Clone, Default)]
pub(super) struct PeriodicMessages(Vec<ListedMessages>);

impl PeriodicMessages {
    /// Records a message.
    pub(super) fn add_message(&mut self, what: MessageRhythm, time: Option<Timestamp>, frame: u64) {
        let Some(time) = time else { return };
        if let Some(listed) = self.list_entry(what) {
            listed.beat.add_message(time, frame);
        }
    }

    /// Entry for one kind of message, made at its first use; `None` if there are too many.
    fn list_entry(&mut self, what: MessageRhythm) -> Option<&mut ListedMessages> {
        let known = self.0.iter().position(|listed| listed.what == what);
        let place = known.unwrap_or(self.0.len());
        if known.is_none() && place < LIMIT {
            self.0.push(ListedMessages { what, identifier: None, beat: MessageTimes::NONE });
        }
        self.0.get_mut(place)
    }

    /// Messages that are overdue at `now`; `beat_of` has the times of an identifier.
    pub(super) fn overdue_messages(
        &self,
        now: Option<Timestamp>,
        beat_of: impl Fn(usize) -> Option<MessageTimes>,
    ) -> impl Iterator<Item = StoppedMessage> {
        self.0.iter().filter_map(move |listed| {
            let current = listed.identifier.and_then(&beat_of);
            current.unwrap_or(listed.beat).silence_at(listed.what, now?)
        })
    }

    /// Takes the times of one kind of message from an identifier from now on; `beat_of` has the present times of an
    /// identifier. The times so far.
    pub(super) fn take_times(
        &mut self,
        what: MessageRhythm,
        identifier: usize,
        beat_of: impl Fn(usize) -> Option<MessageTimes>,
    ) -> MessageTimes {
        let Some(listed) = self.list_entry(what) else { return MessageTimes::NONE };
        let before = listed.identifier.replace(identifier).and_then(beat_of);
        before.unwrap_or(listed.beat)
    }

    /// Keeps the times of an identifier, which from now on are those of another message.
    pub(super) fn keep_times(&mut self, identifier: usize, beat: MessageTimes) {
        for listed in self.0.iter_mut().filter(|listed| listed.identifier == Some(identifier)) {
            (listed.identifier, listed.beat) = (None, beat);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn quiet_after(intervals: &[i64], gap: i64) -> Option<StoppedMessage> {
        let mut beats = PeriodicMessages::default();
        let mut time = Timestamp(0);
        beats.add_message(MessageRhythm::Sync, Some(time), 1);
        for interval in intervals {
            time = time.plus(*interval * 1_000_000);
            beats.add_message(MessageRhythm::Sync, Some(time), 2);
        }
        beats.overdue_messages(Some(time.plus(gap * 1_000_000)), |_| None).next()
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

    #[test]
    fn the_times_of_an_identifier_are_those_of_its_message() {
        let name = |number| {
            MessageRhythm::Rpdo(PdoName { direction: crate::profile::PdoDirection::Receive, number })
        };
        let ms = |time: i64| Timestamp(time * 1_000_000);
        let (mut beats, mut of_identifier) = (PeriodicMessages::default(), [MessageTimes::NONE; 2]);
        let beat_of = |all: [MessageTimes; 2]| move |identifier: usize| all.get(identifier).copied();
        of_identifier[0] = beats.take_times(name(1), 0, beat_of(of_identifier));
        for time in 0..5 {
            of_identifier[0].add_message(ms(10 * time), 1);
        }
        // RPDO1 moves to another identifier, and the first identifier is that of RPDO2 from now on.
        of_identifier[1] = beats.take_times(name(1), 1, beat_of(of_identifier));
        beats.keep_times(0, of_identifier[0]);
        of_identifier[0] = beats.take_times(name(2), 0, beat_of(of_identifier));
        of_identifier[1].add_message(ms(52), 2);
        let quiet: Vec<_> = beats.overdue_messages(Some(ms(100)), beat_of(of_identifier)).collect();
        let expected = StoppedMessage { what: name(1), gap: 48_000_000, usual: 12_000_000, last_frame: 2 };
        assert_eq!(quiet, [expected]);
    }
}
