//! SYNC and the markers of a conformance test.

use crate::event::EventKind;
use crate::frame::Frame;
use crate::session::context::MachineContext;
use crate::session::machine::ProtocolMachine;
use crate::wire::canopen::{sync, test_marker};

/// SYNC with its counter.
#[derive(Debug, Clone, Default)]
pub(in crate::session) struct SyncMachine {
    /// Counter of the last SYNC.
    counter: Option<u8>,
}

/// Markers of the CiA conformance test tool; not evidence of CANopen, because any frame may look like one.
#[derive(Debug, Clone)]
pub(in crate::session) struct ConformanceMarks;

impl SyncMachine {
    /// Stores the counter; returns the expected counter if it differs.
    ///
    /// A step back to 1 is always valid, because the overflow value (1019) may be unknown (CiA 301 §7.2.5.3).
    fn take_counter(&mut self, counter: Option<u8>) -> Option<u8> {
        let before = std::mem::replace(&mut self.counter, counter);
        let (before, now) = (before?, counter?);
        let expected = if before >= 240 { 1 } else { before + 1 };
        (now != expected && now != 1).then_some(expected)
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
        let counter = sync::parse(frame.data());
        let first = cx.bus.last_sync.replace(frame.id).is_none();
        let expected = self.take_counter(counter);
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
            [1, 2, 3, 1, 2, 5, 6].iter().map(|counter| state.take_counter(Some(*counter))).collect();
        assert_eq!(gaps, [None, None, None, None, None, Some(3), None]);
        assert_eq!(state.take_counter(None), None);
    }
}
