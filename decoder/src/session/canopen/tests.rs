//! Tests with frames on a bus: the life of a node over all its frames.

use std::sync::Arc;

use crate::event::{Event, EventKind, MonitoringMethod};
use crate::frame::{BusIndex, CanId, Frame, FrameFlags, Timestamp};
use crate::session::bus::Bus;
use crate::session::{BusDecoder, Node, SessionOptions};
use crate::wire::NodeId;

const MS: i64 = 1_000_000;

/// A frame at a time in ms; without data a remote frame.
type TimedFrame = (i64, u16, Option<Vec<u8>>);

/// Loss (true) and return of node 9: whether other frames continue, time without frame or message in ms, and monitoring.
type Change = (bool, bool, i64, MonitoringMethod);

/// Changes of node 9 by frames, sorted by time; and whether it is lost at the end.
fn life(mut frames: Vec<TimedFrame>) -> (Vec<Change>, bool) {
    frames.sort_by_key(|(time, ..)| *time);
    let mut bus = BusDecoder::new(BusIndex(0), "can0", Arc::new(SessionOptions::default()));
    let mut changes = Vec::new();
    for (number, (time, id, data)) in (1..).zip(frames) {
        let mut frame = Frame::data_frame(CanId::from_standard(id), data.as_deref().unwrap_or_default());
        if data.is_none() {
            frame.flags = FrameFlags::REMOTE;
        }
        (frame.number, frame.time) = (number, Some(Timestamp(time * MS)));
        bus.push(&frame, &mut |event: &Event, _: &Bus| {
            let (is_loss, silence) = match &event.kind {
                EventKind::NodeLost(silence) => (true, silence),
                EventKind::NodeBack(silence) => (false, silence),
                _ => return,
            };
            if event.node != Some(NodeId::Canopen(9)) {
                return;
            }
            changes.push((is_loss, silence.others_continue, silence.gap / MS, silence.monitored_by));
        });
    }
    let is_lost = bus.bus().node(NodeId::Canopen(9)).is_some_and(Node::is_lost);
    (changes, is_lost)
}

fn heartbeats(times: impl Iterator<Item = i64>) -> impl Iterator<Item = TimedFrame> {
    times.map(|time| (time, 0x709, Some(vec![5])))
}

/// TPDO1 with changing data.
fn tpdos(times: impl Iterator<Item = i64>) -> impl Iterator<Item = TimedFrame> {
    times.map(|time| (time, 0x189, Some(time.to_le_bytes()[..2].to_vec())))
}

/// Heartbeats of another node until a time in ms, so that the bus is not silent.
fn other_node(end: i64) -> impl Iterator<Item = TimedFrame> {
    (0..end / 50).map(|place| (place * 50 + 7, 0x70A, Some(vec![5])))
}

#[test]
fn a_heartbeat_that_stops_while_pdos_continue_is_missing_and_the_node_is_not_lost() {
    for (period, pdo) in [(100, 20), (500, 50), (1_000, 100), (500, 400)] {
        let end = period * 9;
        let frames = |beats: &[std::ops::Range<i64>], pdos: std::ops::Range<i64>| {
            let beats: Vec<i64> = beats.iter().flat_map(Clone::clone).map(|beat| beat * period).collect();
            let all = heartbeats(beats.into_iter());
            let tpdos = tpdos(pdos.step_by(usize::try_from(pdo).unwrap()).map(|time| time + 3));
            all.chain(tpdos).chain(other_node(end)).collect::<Vec<_>>()
        };
        let by = MonitoringMethod::Heartbeat;
        // Heartbeats 0 to 4, PDOs until the end: reported once, no return by a PDO.
        let (changes, is_lost) = life(frames(std::slice::from_ref(&(0..5)), 0..end));
        assert_eq!((changes, is_lost), (vec![(true, true, 2 * period, by)], false), "{period} {pdo}");
        // The heartbeat is back with its real gap.
        let (changes, is_lost) = life(frames(&[0..5, 8..10], 0..end));
        let back = (false, true, 4 * period, by);
        assert_eq!((changes, is_lost), (vec![(true, true, 2 * period, by), back], false), "{period} {pdo}");
        // PDOs stop with the heartbeat: the node is lost.
        let (changes, is_lost) = life(frames(std::slice::from_ref(&(0..5)), 0..4 * period + 1));
        let [(true, false, _, lost_by)] = changes[..] else { panic!("{period} {pdo}: {changes:?}") };
        assert!(is_lost && lost_by == by);
    }
}

#[test]
fn guarding_without_response_is_no_loss_while_the_node_answers_sdo() {
    let guarding = (0..60).map(|place| (place * 500, 0x709, None));
    let replies = (0..10).map(|place| {
        let toggle = if place % 2 == 0 { 0x05 } else { 0x85 };
        (place * 500 + 3, 0x709, Some(vec![toggle]))
    });
    let sdo = |from: i64| {
        (0..80).flat_map(move |place| {
            let time = from + place * 400;
            let data = |command: u8| Some(vec![command, 0, 0x10, 0, 0, 0, 0, 0]);
            [(time, 0x609, data(0x40)), (time + 5, 0x589, data(0x43))]
        })
    };
    let frames =
        |from: i64| guarding.clone().chain(replies.clone()).chain(sdo(from)).chain(other_node(30_000));
    // SDO continues over the end of the responses.
    assert_eq!(life(frames(1_000).collect()), (vec![], false));
    // The node is silent for 3.5 s, then only guarding stays without response: it is not lost, and not back either.
    let (changes, is_lost) = life(frames(8_000).collect());
    let found: Vec<_> = changes.iter().map(|change| (change.0, change.1, change.3)).collect();
    let by = MonitoringMethod::Guarding;
    assert_eq!(found, [(true, false, by), (true, true, by)]);
    assert!(!is_lost);
    // A response ends it, with the time since the response before: 28.003 s - 4.503 s.
    let reply = (28_003, 0x709, Some(vec![0x05]));
    let (changes, _) = life(frames(8_000).chain([reply]).collect());
    assert_eq!(changes.last(), Some(&(false, true, 23_500, by)));
}

/// A node with a heartbeat restarts. Without a heartbeat for 5 s and three earlier intervals, it is lost, or only its
/// heartbeat is missing if other frames follow; a reset by NMT, a late heartbeat and 1017 = 0 cause no loss.
#[test]
fn a_heartbeat_that_does_not_return_after_a_restart_is_missing() {
    for period in [100, 500, 1_000, 3_000] {
        let boot = 10 * period + period / 3;
        let limit = (3 * period).max(5_000);
        let end = boot + limit + 2_000;
        let before = || heartbeats((0..10).map(move |beat| beat * period)).chain(other_node(end));
        let restart = || [(boot, 0x709, Some(vec![0]))];
        let by = MonitoringMethod::Heartbeat;
        let (changes, is_lost) = life(before().chain(restart()).collect());
        assert_eq!((changes, is_lost), (vec![(true, false, limit, by)], true), "{period}");
        let pdos = || tpdos((boot + 3..end).step_by(100));
        let (changes, is_lost) = life(before().chain(restart()).chain(pdos()).collect());
        assert_eq!((changes, is_lost), (vec![(true, true, limit, by)], false), "{period}");
        let late = heartbeats(std::iter::once(boot + limit - 1));
        assert_eq!(life(before().chain(restart()).chain(late).collect()).0, vec![], "{period}");
        let return_at = boot + limit + 1_000;
        let (changes, _) =
            life(before().chain(restart()).chain(heartbeats(std::iter::once(return_at))).collect());
        assert_eq!(changes.len(), 2, "{period}");
        let reset = (boot - 20, 0x000, Some(vec![0x81, 9]));
        assert_eq!(life(before().chain([reset]).chain(restart()).collect()).0, vec![], "{period}");
        let off = [
            (boot + 10, 0x609, Some(vec![0x2B, 0x17, 0x10, 0, 0, 0, 0, 0])),
            (boot + 11, 0x589, Some(vec![0x60, 0x17, 0x10, 0, 0, 0, 0, 0])),
        ];
        assert_eq!(life(before().chain(restart()).chain(off).collect()).0, vec![], "{period}");
    }
}
