//! SYNC and the markers of a conformance test.

use crate::event::EventKind;
use crate::frame::Frame;
use crate::session::context::MachineContext;
use crate::session::machine::ProtocolMachine;
use crate::wire::canopen::{sync, test_marker};

/// SYNC with its counter.
#[derive(Debug, Clone, Default)]
pub(in crate::session) struct SyncMachine {
    /// Data byte of the last SYNC.
    last: Option<u8>,
    /// Whether the data byte counts, by the last SYNCs with different data.
    counting: CounterEvidence,
}

/// Evidence for a counter in the data byte. A byte that never changes is no counter and proves no loss.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
enum CounterEvidence {
    /// No second value yet.
    #[default]
    Open,
    /// The byte did not change at a SYNC.
    Constant,
    /// The byte counted up. Then it may stop: the first equal value is news, further ones are not.
    Counting {
        /// The byte was equal at the last SYNC.
        has_stopped: bool,
    },
}

/// Markers of the CiA conformance test tool; not evidence of CANopen, because any frame may look like one.
#[derive(Debug, Clone)]
pub(in crate::session) struct ConformanceMarks;

impl SyncMachine {
    /// Stores the data byte; returns it as counter, and the expected counter if it differs.
    ///
    /// A step back to 1 is always valid, because the overflow value (1019) may be unknown (CiA 301 §7.2.5.3). Nothing is
    /// expected before the byte counted up once, and a byte that remains equal is not a counter.
    fn take_counter(&mut self, byte: Option<u8>) -> (Option<u8>, Option<u8>) {
        let before = std::mem::replace(&mut self.last, byte);
        let (Some(before), Some(now)) = (before, byte) else { return (byte, None) };
        let expected = if before >= 240 { 1 } else { before + 1 };
        let (counting, is_news) = match (self.counting, now == before) {
            (_, false) if now == expected => (CounterEvidence::Counting { has_stopped: false }, false),
            (CounterEvidence::Counting { has_stopped: false }, true) => {
                (CounterEvidence::Counting { has_stopped: true }, now != 1)
            }
            (_, true) => (CounterEvidence::Constant, false),
            (CounterEvidence::Counting { .. }, false) => {
                (CounterEvidence::Counting { has_stopped: false }, now != 1)
            }
            (known, false) => (known, false),
        };
        self.counting = counting;
        let counter = byte.filter(|_| counting != CounterEvidence::Constant);
        (counter, Some(expected).filter(|_| is_news))
    }
}

impl ProtocolMachine for SyncMachine {
    type Route<'a> = ();
    /// Whether it is a CANopen SYNC, on which devices act.
    type Product = bool;

    fn on_frame(&mut self, (): (), frame: &Frame, cx: &mut MachineContext<'_>) -> bool {
        if frame.length <= 1 {
            cx.bus.protocols.canopen.count_sync();
        } else {
            cx.bus.protocols.canopen.add_contradiction();
        }
        if !cx.is_decoded(None, frame) {
            return false;
        }
        let first = cx.bus.last_sync.replace(frame.id).is_none();
        let (counter, expected) = self.take_counter(sync::parse(frame.data()));
        let routine = !first && expected.is_none();
        cx.emit_event(frame, None, routine, EventKind::Sync { counter, expected });
        true
    }
}

impl ProtocolMachine for ConformanceMarks {
    type Route<'a> = ();
    type Product = ();

    fn on_frame(&mut self, (): (), frame: &Frame, cx: &mut MachineContext<'_>) {
        match test_marker::parse(frame.data()).filter(|_| cx.bus.protocols.canopen.is_confirmed()) {
            Some(marker) => cx.emit_event(frame, None, false, EventKind::TestCase(marker)),
            None => cx.emit_undecoded(frame, None),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn counters_run_to_their_overflow_and_start_at_one() {
        let mut state = SyncMachine::default();
        let gaps: Vec<_> =
            [1, 2, 3, 1, 2, 5, 6].iter().map(|counter| state.take_counter(Some(*counter)).1).collect();
        assert_eq!(gaps, [None, None, None, None, None, Some(3), None]);
        assert_eq!(state.take_counter(None), (None, None));
    }

    /// Counters and gaps of SYNCs with these data bytes.
    fn counted(bytes: &[u8]) -> Vec<(Option<u8>, Option<u8>)> {
        let mut state = SyncMachine::default();
        bytes.iter().map(|byte| state.take_counter(Some(*byte))).collect()
    }

    #[test]
    fn a_constant_byte_is_no_counter() {
        // The first value is shown: it may be the start of a counter.
        assert_eq!(counted(&[0; 4]), [(Some(0), None), (None, None), (None, None), (None, None)]);
        // Two values that do not follow each other prove no counter.
        assert_eq!(counted(&[7, 9]), [(Some(7), None), (Some(9), None)]);
        // A constant byte that starts to count is a counter from then on.
        assert_eq!(counted(&[4, 4, 5, 7])[2..], [(Some(5), None), (Some(7), Some(6))]);
    }

    #[test]
    fn a_counter_that_stops_is_reported_once() {
        let all = counted(&[1, 2, 3, 3, 3, 3, 4, 5]);
        assert_eq!(all[3], (Some(3), Some(4)));
        assert_eq!(all[4..6], [(None, None); 2]);
        assert_eq!(all[6..], [(Some(4), None), (Some(5), None)]);
        // A producer that starts again counts from 1.
        assert!(counted(&[1, 2, 1, 1, 2]).iter().all(|(_, expected)| expected.is_none()));
    }

    /// Whatever precedes the counting: from the second counted value on, gaps are the same.
    #[test]
    fn what_precedes_the_counting_changes_nothing_after_it() {
        for before in [&[][..], &[0], &[0, 0, 0], &[9, 3], &[240, 7, 7]] {
            let all = counted(&[before, &[20, 21, 22, 25, 26, 26, 27]].concat());
            let after = &all[before.len() + 1..];
            let gaps: Vec<_> = after.iter().map(|(_, expected)| *expected).collect();
            assert_eq!(gaps, [None, None, Some(23), None, Some(27), None], "{before:?}");
        }
    }
}
