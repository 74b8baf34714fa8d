//! Tests with frames on a bus: responses that belong to no request of their own.

use std::sync::Arc;

use crate::event::{Event, EventKind, SdoOutcome, SdoTransfer};
use crate::frame::{BusIndex, CanId, Frame, Timestamp};
use crate::session::bus::Bus;
use crate::session::{BusDecoder, SessionOptions};
use crate::wire::canopen::ObjectAddress;

const US: i64 = 1_000;

/// Transfers of node 5, and the value of 1000:00 in its store at the end; frames with times in µs.
fn transfers(frames: &[(i64, u16, [u8; 8])]) -> (Vec<SdoTransfer>, Option<u64>) {
    let mut bus = BusDecoder::new(BusIndex(0), "can0", Arc::new(SessionOptions::default()));
    let mut all = Vec::new();
    for (number, (time, id, data)) in (1..).zip(frames) {
        let mut frame = Frame::data_frame(CanId::from_standard(*id), data);
        (frame.number, frame.time) = (number, Some(Timestamp(time * US)));
        bus.push(&frame, &mut |event: &Event, _: &Bus| {
            if let EventKind::SdoTransfer(transfer) = &event.kind {
                all.push((**transfer).clone());
            }
        });
    }
    let value = bus.bus().node(5).and_then(|node| node.store().number(ObjectAddress::new(0x1000, 0)));
    (all, value)
}

const READ: [u8; 8] = [0x40, 0, 0x10, 0, 0, 0, 0, 0];

/// Response to [`READ`] with a value.
const fn value(number: u8) -> [u8; 8] {
    [0x43, 0, 0x10, 0, number, 0, 0, 0]
}

#[test]
fn the_second_response_to_a_request_is_of_another_device() {
    let (all, stored) =
        transfers(&[(0, 0x605, READ), (3_000, 0x585, value(0x0F)), (4_100, 0x585, value(0x02))]);
    let found: Vec<_> = all.iter().map(|it| (it.outcome, it.is_unrequested)).collect();
    assert_eq!(found, [(SdoOutcome::Complete, false), (SdoOutcome::Complete, true)]);
    assert_eq!(stored, Some(0x0F));
}

/// A client that reads an object periodically, with a request missing in the capture: its response follows the one before
/// later than the server needs, so it may belong to that request. The server needs 3 ms here.
#[test]
fn a_response_belongs_to_a_missing_request_if_there_was_time_for_it() {
    for after in [1, 1_000, 2_999, 3_000, 3_001, 10_000, 900_000] {
        let frames = [(0, 0x605, READ), (3_000, 0x585, value(1)), (3_000 + after, 0x585, value(2))];
        let (all, stored) = transfers(&frames);
        let is_second = after <= 3_000;
        assert_eq!(all[1].is_unrequested, is_second, "{after} µs");
        assert!(all[1].cut_start);
        assert_eq!(stored, Some(if is_second { 1 } else { 2 }), "{after} µs");
        // A request in between: each response has its own.
        let [first, second, third] = frames;
        let (all, stored) = transfers(&[first, second, (3_000, 0x605, READ), third]);
        assert!(!all[1].is_unrequested && stored == Some(2));
    }
}
