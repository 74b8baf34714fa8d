//! Conclusions from EMCY messages that report communication again and again, with the messages that they follow.

use super::failure::Conclusion;
use crate::finding::{FindingGroup, FindingSubject};
use crate::observation::SenderSilence;
use crate::session::{Bus, BusStream, StreamService};
use crate::wire::NodeId;

/// EMCY codes of CiA 301 table 26: heartbeat or life guard error, PDO too short, PDO too long.
const HEARTBEAT: u16 = 0x8130;
const SHORT: u16 = 0x8210;
const LONG: u16 = 0x8220;

/// Reports after which a message, not a single frame, is the cause.
const REPEATED: u64 = 3;

/// Frames between a message and the EMCY that reports it.
const FRAMES: u64 = 20;

pub(super) fn conclude_reports(
    bus: &Bus,
    silences: &[SenderSilence],
    groups: &[FindingGroup],
) -> Vec<Conclusion> {
    let reports = groups.iter().filter(|group| group.key.bus == bus.index() && group.count >= REPEATED);
    let mut all = Vec::new();
    for group in reports {
        let (FindingSubject::Code(code), Some(node)) = (&group.key.about, group.key.node) else { continue };
        all.extend(match *code {
            HEARTBEAT => short_consumer(bus, node, group, silences),
            SHORT | LONG => wrong_length(bus, node, group),
            _ => None,
        });
    }
    all
}

fn conclusion(
    bus: &Bus,
    (hypothesis, text): (&'static str, String),
    node: NodeId,
    group: &FindingGroup,
) -> Option<Conclusion> {
    let first = group.first_occurrence();
    let began = (bus.monotonic(first.time?), first.frames.first);
    Some(Conclusion {
        hypothesis,
        node: Some(node),
        nodes: vec![node],
        about: FindingSubject::Whole,
        text,
        began,
        is_note: false,
        ended: None,
    })
}

/// A consumer reports missing heartbeats while all senders continue: its consumer time is shorter than their period.
fn short_consumer(
    bus: &Bus,
    node: NodeId,
    group: &FindingGroup,
    silences: &[SenderSilence],
) -> Option<Conclusion> {
    let last = bus.monotonic(group.last_occurrence().time?);
    let first = bus.monotonic(group.first_occurrence().time?);
    let is_silent = |silence: &SenderSilence| {
        silence.is_certain
            && silence.last.0 <= last
            && silence.until.is_none_or(|until| until.0 >= first)
            && silence.sender.node() != Some(node)
    };
    if silences.iter().any(is_silent) {
        return None;
    }
    let text = format!(
        "EMCY 8130 {} times from {{{}}} on, while all heartbeats continue",
        group.count,
        group.first_occurrence().frames.first
    );
    conclusion(bus, ("consumer-short", text), node, group)
}

/// A node reports the length of the same PDO again and again.
fn wrong_length(bus: &Bus, node: NodeId, group: &FindingGroup) -> Option<Conclusion> {
    let report = group.last_occurrence().frames.first;
    let is_before = |stream: &BusStream| {
        stream.service == StreamService::ReceivedPdo
            && stream.node == Some(node)
            && u64::from(stream.count) >= group.count
    };
    let streams: Vec<BusStream> = bus.streams().filter(is_before).collect();
    let stream = match streams.as_slice() {
        [only] => only,
        // The one that was sent just before the last report.
        all => all.iter().filter(|it| it.last_frame + FRAMES >= report).max_by_key(|it| it.last_frame)?,
    };
    let text = format!(
        "EMCY {} {} times from {{{}}} on: message {} of the controller has another length than the node expects",
        group.key.about,
        group.count,
        group.first_occurrence().frames.first,
        stream.id
    );
    conclusion(bus, ("length-differs", text), node, group)
}
