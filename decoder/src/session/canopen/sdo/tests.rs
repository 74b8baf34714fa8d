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

/// Read of 1018:01, and its response.
const OTHER: [u8; 8] = [0x40, 0x18, 0x10, 1, 0, 0, 0, 0];
const OTHER_VALUE: [u8; 8] = [0x43, 0x18, 0x10, 1, 0, 0, 0, 0];

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

const WRITE: [u8; 8] = [0x21, 0x00, 0x20, 0x01, 0x40, 0, 0, 0];
const WRITE_CONFIRMED: [u8; 8] = [0x60, 0x00, 0x20, 0x01, 0, 0, 0, 0];
const SEGMENT: [u8; 8] = [0x00, 0xA1, 0xA2, 0xA3, 0xA4, 0xA5, 0xA6, 0xA7];
const SEGMENT_CONFIRMED: [u8; 8] = [0x20, 0, 0, 0, 0, 0, 0, 0];
const ABORT: [u8; 8] = [0x80, 0x00, 0x20, 0x01, 0, 0, 0x04, 0x05];

/// Messages of a server that contradict a download, or continue it without a segment of the client.
const CONTRARY: [u8; 4] = [0x00, 0x10, 0x41, 0xC1];
const IN_ROW: [u8; 2] = [0x30, 0x20];

/// A flood of any messages of a server within a download is one transfer, aborted by the client, with the bytes that the
/// client sent; no message is invented. Each byte of the pattern selects a message.
#[test]
fn a_server_that_floods_starts_no_transfer() {
    for pattern in 0..256_usize {
        let flood: Vec<u8> = (0..5)
            .map(|place| match pattern >> place & 1 {
                0 => CONTRARY[(pattern >> 5) % 4],
                _ => IN_ROW[place % 2],
            })
            .collect();
        if flood.iter().all(|command| IN_ROW.contains(command)) {
            continue;
        }
        let mut frames = vec![
            (0, 0x605, WRITE),
            (1, 0x585, WRITE_CONFIRMED),
            (2, 0x605, SEGMENT),
            (3, 0x585, SEGMENT_CONFIRMED),
        ];
        frames.extend(
            (4..).zip(&flood).map(|(time, command)| (time, 0x585, [*command, 0, 0, 0, 0, 0x20, 0, 0])),
        );
        frames.push((300, 0x605, ABORT));
        let (all, _) = transfers(&frames);
        let [only] = all.as_slice() else { panic!("{flood:02X?}: {all:#?}") };
        assert_eq!((only.outcome, only.object), (SdoOutcome::Aborted, Some(ObjectAddress::new(0x2000, 1))));
        assert_eq!(
            (only.data.as_slice(), only.unseen, only.missing_segments),
            (&SEGMENT[1..], 0, 0),
            "{flood:02X?}"
        );
        assert_eq!(only.unrequested_responses, 5, "{flood:02X?}");
    }
}

/// Confirmations of two segments that the capture lacks may be missing; those of three are a flood.
#[test]
fn few_confirmations_without_a_segment_are_missing_segments() {
    for count in 0..6_u8 {
        let mut frames = vec![
            (0, 0x605, WRITE),
            (1, 0x585, WRITE_CONFIRMED),
            (2, 0x605, SEGMENT),
            (3, 0x585, SEGMENT_CONFIRMED),
        ];
        let further = (0..count).map(|place| {
            (4 + i64::from(place), 0x585, [IN_ROW[usize::from(place) % 2], 0, 0, 0, 0, 0, 0, 0])
        });
        frames.extend(further);
        frames.push((300, 0x605, ABORT));
        let (all, _) = transfers(&frames);
        let is_flood = count > 2;
        assert_eq!(all.len(), 1);
        assert_eq!(all[0].unrequested_responses, if is_flood { count.into() } else { 0 }, "{count}");
        let missing = [0, 7, 14].get(usize::from(count)).copied().unwrap_or(0);
        assert_eq!((all[0].unseen, all[0].data.len()), (missing, 7), "{count}");
    }
}

/// The client continues the upload whose start the capture lacks: its segments were no flood.
#[test]
fn held_responses_belong_to_the_transfer_that_the_client_continues() {
    let upload = |toggle: u8, byte: u8| [toggle, byte, byte, byte, byte, byte, byte, byte];
    let frames = [
        (0, 0x605, WRITE),
        (1, 0x585, WRITE_CONFIRMED),
        (2, 0x585, upload(0x00, 1)),
        (3, 0x605, [0x70, 0, 0, 0, 0, 0, 0, 0]),
        (4, 0x585, upload(0x11, 2)),
    ];
    let (all, _) = transfers(&frames);
    let found: Vec<_> = all.iter().map(|it| (it.outcome, it.data.len(), it.unrequested_responses)).collect();
    assert_eq!(found, [(SdoOutcome::Superseded, 0, 0), (SdoOutcome::Complete, 14, 0)]);
}

/// Without an open transfer, a flood after an exchange is one event.
#[test]
fn a_flood_without_a_transfer_is_one_event() {
    let mut frames = vec![(0, 0x605, READ), (1, 0x585, value(1))];
    let commands = [0x00, 0x10, 0x20, 0x30].into_iter().cycle().take(80);
    frames.extend((10..).zip(commands).map(|(time, command)| (time, 0x585, [command, 0, 0, 0, 0, 0, 0, 0])));
    frames.extend([(200, 0x605, READ), (201, 0x585, value(1))]);
    let (all, _) = transfers(&frames);
    let found: Vec<_> =
        all.iter().map(|it| (it.is_unrequested, it.frame_count, it.missing_segments)).collect();
    assert_eq!(found, [(false, 2, 0), (true, 80, 0), (false, 2, 0)]);
}

/// Responses on the identifier of the requests: valid and invalid values of uploads, confirmations of downloads. Anything
/// that may be a request is one.
#[test]
fn a_response_on_the_request_identifier_is_no_request() {
    let write = [0x2B, 0x17, 0x10, 0, 0xE8, 3, 0, 0];
    let cases = [
        (READ, value(1), true),
        (READ, [0x40, 0, 0x10, 0, 0x80, 0, 0, 0], true),
        (READ, READ, false),
        (READ, [0x43, 1, 0x10, 0, 1, 0, 0, 0], false),
        (READ, [0x60, 0, 0x10, 0, 0, 0, 0, 0], false),
        ([0x40, 0, 0x10, 0, 9, 0, 0, 0], [0x40, 0, 0x10, 0, 8, 0, 0, 0], false),
        (write, [0x60, 0x17, 0x10, 0, 0, 0, 0, 0], true),
        (write, [0x60, 0, 0, 0, 0, 0, 0, 0], false),
        (write, write, false),
    ];
    for (request, second, is_response) in cases {
        let proof = [(0, 0x605, READ), (1, 0x585, value(1))];
        let late = [
            (10, 0x605, request),
            (14, 0x605, second),
            (100_000, 0x605, OTHER),
            (100_001, 0x585, OTHER_VALUE),
        ];
        let (all, _) = transfers(&[proof, [late[0], late[1]], [late[2], late[3]]].concat());
        let misplaced: Vec<_> = all.iter().filter_map(|it| it.misplaced).map(|it| it.frame).collect();
        assert_eq!(misplaced, if is_response { vec![4] } else { Vec::new() }, "{request:02X?} {second:02X?}");
        // A response where it belongs takes precedence.
        let answer = if request[0] == 0x40 { value(7) } else { [0x60, 0x17, 0x10, 0, 0, 0, 0, 0] };
        let (all, _) = transfers(&[proof.to_vec(), vec![late[0], late[1], (15, 0x585, answer)]].concat());
        assert!(all.iter().all(|it| it.misplaced.is_none()), "{all:#?}");
    }
}

/// The response of another server belongs to the only request for its object; the store of neither takes it.
#[test]
fn a_response_of_another_server_is_linked_to_its_request() {
    let proof = [(0, 0x606, READ), (1, 0x586, value(1))];
    for (after, requests, is_linked) in [(3, 1, true), (49, 1, true), (51, 1, false), (3, 2, false)] {
        let mut frames = proof.to_vec();
        frames.extend([(10_000, 0x606, READ), (10_000, 0x607, READ)].iter().take(requests));
        frames.push((10_000 + after * 1_000, 0x585, value(9)));
        frames.push((200_000, 0x606, OTHER));
        frames.push((200_001, 0x586, OTHER_VALUE));
        let (all, stored) = transfers(&frames);
        let misplaced: Vec<_> = all.iter().filter_map(|it| it.misplaced).map(|it| it.id).collect();
        assert_eq!(
            misplaced,
            vec![CanId::from_standard(0x585); usize::from(is_linked)],
            "{after} {requests}"
        );
        assert_eq!(stored, Some(9).filter(|_| !is_linked));
    }
}
