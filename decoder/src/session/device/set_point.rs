//! Set points: changes, effective time and effectiveness.

use std::sync::Arc;

use crate::event::{EventKind, FrameRange};
use crate::frame::Frame;
use crate::profile::device::SYNC_AGE;
use crate::profile::{DecodedValue, ObjectMeaning, ObjectRole, PayloadLayout, PdoName, ValueCarrier};
use crate::session::bus::{
    Bus, FrameMoment, SetPointGates, SetPointState, ShortPayload, WatchPlan, nonzero_identifier,
};
use crate::session::context::MachineContext;
use crate::session::machine::{ProtocolMachine, TimedMachine};
use crate::session::timers::DeadlineSubject;
use crate::wire::NodeId;

/// Applies changed set points of an RPDO or message.
pub(in crate::session) fn set_points_changed(
    id: NodeId,
    carrier: &ValueCarrier,
    (layout, short): (&PayloadLayout, Option<ShortPayload>),
    plan: &WatchPlan,
    frame: &Frame,
    cx: &mut MachineContext<'_>,
) {
    let moment = FrameMoment { what: (), frame: frame.number, time: cx.bus.clock.now() };
    if is_received_elsewhere(id, carrier, frame, &cx.bus) {
        return;
    }
    let Some(waits) = cx.bus.node(id).map(|node| node.waits_for_sync(carrier)) else { return };
    for watched in &plan.fields {
        let Some(field) = layout.fields.get(watched.place) else { continue };
        let Some(meaning) = field.meaning.as_ref().filter(|it| it.role == Some(ObjectRole::SetPoint)) else {
            continue;
        };
        let Some(raw) = field.extract_bits(frame.data()) else { continue };
        let value = field.data_type.decode_raw(raw);
        let Some(place) = set_point(&mut cx.bus, id, carrier, meaning) else { continue };
        let Some(point) = set_point_mut(&mut cx.bus, id, place) else { continue };
        point.assumed = layout.assumed;
        (point.id, point.arrived) = (Some(frame.id), frame.number);
        // A short PDO with the value in force changes nothing; a complete one puts the value into force.
        if point.is_unchanged(&value) && (point.short.is_none() || short.is_some()) {
            point.waiting = None;
        } else if waits && short.is_none() {
            point.waiting = Some((value, moment));
        } else {
            point.short = short;
            emit_set_point(id, place, value, moment, frame, cx);
        }
    }
    if waits {
        await_sync(cx, id, moment.time.saturating_add(SYNC_AGE));
    }
}

/// Whether the node receives its commands on another identifier, which is in use too.
fn is_received_elsewhere(id: NodeId, carrier: &ValueCarrier, frame: &Frame, bus: &Bus) -> bool {
    let ValueCarrier::Pdo(name) = carrier else { return false };
    let cob_id = bus.node(id).and_then(|node| node.configured_cob_id(*name));
    let configured = cob_id.and_then(nonzero_identifier).filter(|configured| *configured != frame.id);
    configured.is_some_and(|configured| bus.routes.find_slot(configured).is_some())
}

/// Updates the identifier of the set points in an RPDO at the first PDO after its COB-ID may have changed.
#[cold]
pub(in crate::session) fn confirm_identifier(
    id: NodeId,
    name: PdoName,
    frame: &Frame,
    cx: &mut MachineContext<'_>,
) {
    let carrier = ValueCarrier::Pdo(name);
    if is_received_elsewhere(id, &carrier, frame, &cx.bus) {
        return;
    }
    let Some(node) = cx.bus.nodes.known_node_mut(id) else { return };
    let mut is_any = false;
    for point in node.behaviour.set_points.iter_mut().filter(|point| point.carrier == carrier) {
        (point.id, point.arrived) = (Some(frame.id), frame.number);
        is_any = true;
    }
    if is_any && cx.bus.node(id).is_some_and(|node| node.configured_cob_id(name).is_some()) {
        reassess_set_points(id, frame, cx);
    }
}

/// Queues a SYNC deadline, unless one is queued already.
fn await_sync(cx: &mut MachineContext<'_>, id: NodeId, deadline: i64) {
    let Some(node) = cx.bus.nodes.node_mut(id) else { return };
    if !std::mem::replace(&mut node.behaviour.sync_queued, true) {
        cx.timers.add_deadline(deadline, DeadlineSubject::SetPoint(id));
    }
}

fn set_point_mut(bus: &mut Bus, id: NodeId, place: usize) -> Option<&mut SetPointState> {
    bus.nodes.node_mut(id)?.behaviour.set_points.get_mut(place)
}

/// Index of a set point, created or updated with its present meaning.
fn set_point(
    bus: &mut Bus,
    id: NodeId,
    carrier: &ValueCarrier,
    meaning: &Arc<ObjectMeaning>,
) -> Option<usize> {
    let points = &mut bus.nodes.node_mut(id)?.behaviour.set_points;
    let known = points.iter().position(|it| it.meaning.object == meaning.object && it.carrier == *carrier);
    if let Some(place) = known {
        points.get_mut(place)?.meaning = Arc::clone(meaning);
        return Some(place);
    }
    points.push(SetPointState {
        carrier: carrier.clone(),
        id: None,
        arrived: 0,
        meaning: Arc::clone(meaning),
        reported: None,
        effective: None,
        gates: Vec::new(),
        waiting: None,
        late: false,
        short: None,
        assumed: false,
    });
    Some(points.len() - 1)
}

/// Device state of all nodes; the state of each is in its node.
#[derive(Debug, Clone)]
pub(in crate::session) struct DeviceMachine;

impl ProtocolMachine for DeviceMachine {
    type Route<'a> = ();
    type Product = ();

    /// A SYNC makes the waiting set points effective.
    fn on_frame(&mut self, (): (), frame: &Frame, cx: &mut MachineContext<'_>) {
        let moment = FrameMoment { what: (), frame: frame.number, time: cx.bus.clock.now() };
        for place in 0..cx.bus.nodes.all().len() {
            let Some(node) = cx.bus.nodes.all_mut().get_mut(place) else { return };
            if node.assigned.is_none() || node.sync != frame.id {
                continue;
            }
            node.behaviour.sync = Some(moment);
            let id = node.id;
            for place in 0..node.behaviour.set_points.len() {
                let waiting = set_point_mut(&mut cx.bus, id, place).and_then(|point| point.waiting.take());
                if let Some((value, incoming)) = waiting {
                    emit_set_point(id, place, value, incoming, frame, cx);
                }
            }
            let Some(node) = cx.bus.nodes.node_mut(id) else { return };
            let late = node.behaviour.set_points.iter_mut().map(|point| std::mem::take(&mut point.late));
            if late.fold(false, |any, late| any | late) {
                reassess_set_points(id, frame, cx);
            }
        }
    }

    fn on_silence(&mut self, delay: i64, bus: &mut Bus) {
        for node in bus.nodes.all_mut() {
            node.behaviour.postpone_deadlines(delay);
        }
    }
}

impl TimedMachine for DeviceMachine {
    /// Node whose set points wait for SYNC.
    type Deadline = NodeId;

    /// Emits set points that waited too long as not effective.
    fn on_deadline(&mut self, id: NodeId, now: i64, cx: &mut MachineContext<'_>) {
        let Some(node) = cx.bus.nodes.node_mut(id) else { return };
        node.behaviour.sync_queued = false;
        for place in 0..node.behaviour.set_points.len() {
            let Some(point) = set_point_mut(&mut cx.bus, id, place) else { return };
            let Some(incoming) = point.waiting.as_ref().map(|(_, incoming)| *incoming) else { continue };
            let deadline = incoming.time.saturating_add(SYNC_AGE);
            if deadline >= now {
                await_sync(cx, id, deadline);
                continue;
            }
            if let Some((value, incoming)) = point.waiting.take() {
                point.late = true;
                // The event has the time of the deadline, and the frame with the set point as evidence.
                let time = cx.bus.clock.stamp_of(deadline);
                let frame = Frame { number: incoming.frame, time, ..Frame::EMPTY };
                emit_set_point(id, place, value, incoming, &frame, cx);
            }
        }
    }
}

/// Emits a new value with its effectiveness from `frame` on.
fn emit_set_point(
    id: NodeId,
    place: usize,
    value: DecodedValue,
    incoming: FrameMoment<()>,
    frame: &Frame,
    cx: &mut MachineContext<'_>,
) {
    let now = cx.bus.clock.now();
    let runs = cx.bus.clock.has_timestamps();
    let Some(node) = cx.bus.node(id) else { return };
    let Some(point) = node.behaviour.set_points.get(place) else { return };
    let verdict = SetPointGates::new(node, point.gated_subject(), now).gate_verdict();
    let waited = incoming.frame != frame.number
        && runs
        && node.behaviour.sync.is_some_and(|it| it.frame == frame.number);
    let mut reported = point.set_point_event(&value, &verdict);
    reported.sync_after = waited.then(|| now.saturating_sub(incoming.time));
    let quantity = reported.to.clone();
    let mut event = cx.event_of(frame, Some(id), EventKind::SetPoint(Box::new(reported)));
    event.frames = FrameRange { first: incoming.frame, last: frame.number };
    if let Some(point) = set_point_mut(&mut cx.bus, id, place) {
        point.reported = Some((value, quantity));
        point.effective = Some(verdict.effective);
        point.gates = verdict.gates;
    }
    cx.send_event(&event);
}

/// Re-evaluates the gates and emits set points whose effectiveness changed.
pub(in crate::session) fn reassess_set_points(id: NodeId, frame: &Frame, cx: &mut MachineContext<'_>) {
    let now = cx.bus.clock.now();
    let Some(node) = cx.bus.node(id) else { return };
    let mut changes = Vec::new();
    for (place, point) in node.behaviour.set_points.iter().enumerate() {
        let Some((value, _)) = &point.reported else { continue };
        let verdict = SetPointGates::new(node, point.gated_subject(), now).gate_verdict();
        if point.effective != Some(verdict.effective) {
            changes.push((place, point.set_point_event(value, &verdict), verdict));
        }
    }
    for (place, event, verdict) in changes {
        if let Some(point) = set_point_mut(&mut cx.bus, id, place) {
            point.effective = Some(verdict.effective);
            point.gates = verdict.gates;
        }
        cx.emit_event(frame, id, false, EventKind::SetPoint(Box::new(event)));
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::event::Event;
    use crate::frame::{BusIndex, CanId, Timestamp};
    use crate::profile::Catalogue;
    use crate::session::BusDecoder;
    use crate::session::{AssignedBy, Assignment, SessionOptions};

    const PROFILE: &str = r#"
        id = "acme-pump"
        extends = ["cia301"]
        [[object]]
        index = 0x2000
        name = "set point"
        type = "INTEGER16"
        role = "set-point"
        [[pdo]]
        pdo = "RPDO1"
        mapping = "fixed"
        effect = "at-sync"
        fields = [{ object = "2000:00", bits = 16 }]
        [[gate]]
        name = "SYNC"
        open = { sync = true }
    "#;

    /// RPDO1 with two set points of 16 bits; its transmission type decides whether it waits for SYNC.
    const BY_TYPE: &str = r#"
        id = "acme-pump"
        extends = ["cia301"]
        [[object]]
        index = 0x2000
        name = "set point"
        type = "INTEGER16"
        role = "set-point"
        [[object]]
        index = 0x2001
        name = "ramp"
        type = "INTEGER16"
        [[pdo]]
        pdo = "RPDO1"
        mapping = "fixed"
        fields = [{ object = "2000:00", bits = 16 }, { object = "2001:00", bits = 16 }]
        [[gate]]
        name = "operational"
        open = { nmt = "operational" }
        [[gate]]
        name = "hardware enable"
        open = { visible = false }
    "#;

    type EmittedRow = (Option<i64>, String, &'static str, FrameRange);

    /// Set points emitted for frames, each with time in ms, identifier and data.
    fn set_points_of(frames: &[(i64, u16, &[u8])]) -> Vec<EmittedRow> {
        set_points_with_gates(PROFILE, frames).into_iter().map(|(row, _)| row).collect()
    }

    /// Set points with the names of their closed, unknown and invisible gates.
    fn set_points_with_gates(profile: &str, frames: &[(i64, u16, &[u8])]) -> Vec<(EmittedRow, String)> {
        let mut catalogue = Catalogue::default();
        catalogue.add_text("pump.toml", profile).unwrap();
        let device = catalogue.device("acme-pump").unwrap();
        let assignment = Assignment { bus: None, node: NodeId::Canopen(2), device, by: AssignedBy::Option };
        let options = SessionOptions { assignments: vec![assignment], ..SessionOptions::default() };
        let mut bus = BusDecoder::new(BusIndex(0), "can0", Arc::new(options));
        let mut reported = Vec::new();
        for (number, (time, id, data)) in (1..).zip(frames) {
            let mut frame = Frame::data_frame(CanId::from_standard(*id), data);
            frame.number = number;
            frame.time = Some(Timestamp(time * 1_000_000));
            bus.push(&frame, &mut |event: &Event, _: &Bus| {
                if let EventKind::SetPoint(point) = &event.kind {
                    let time = event.time.map(|time| time.0 / 1_000_000);
                    let gates = [point.gates.join("+"), point.invisible.join("+")].join("/");
                    let row = (time, point.to.text.clone(), point.effective.name(), event.frames);
                    reported.push((row, gates));
                }
            });
        }
        reported
    }

    #[test]
    fn a_set_point_takes_effect_at_sync_or_is_reported_after_a_second() {
        let heartbeat: (u16, &[u8]) = (0x705, &[5]);
        let mut frames: Vec<(i64, u16, &[u8])> = vec![
            (0, 0x702, &[0]),
            (10, 0x202, &[1, 0]),
            (20, 0x080, &[]),
            (500, 0x202, &[2, 0]),
            (900, 0x202, &[3, 0]),
        ];
        // The bus continues without SYNC.
        frames.extend((1..40).map(|step| (900 + step * 100, heartbeat.0, heartbeat.1)));
        frames.push((5000, 0x080, &[]));
        let reported = set_points_of(&frames);
        assert_eq!(reported[0], (Some(20), "1".into(), "yes", FrameRange { first: 2, last: 3 }));
        // 900 + 1000 ms: the value replaced before a SYNC never took effect and is not emitted.
        assert_eq!(reported[1], (Some(1900), "3".into(), "no", FrameRange::one(5)));
        // The late SYNC arrives.
        assert_eq!(reported[2], (Some(5000), "3".into(), "yes", FrameRange::one(45)));
        assert_eq!(reported.len(), 3);
    }

    /// Frames as value, time, effectiveness and gates.
    fn verdicts_by_type(frames: &[(i64, u16, &[u8])]) -> Vec<String> {
        let reported = set_points_with_gates(BY_TYPE, frames);
        let verdict = |((time, value, effective, _), gates): ((Option<i64>, _, _, _), _)| {
            format!("{} {value} {effective} {gates}", time.unwrap_or(-1))
        };
        reported.into_iter().map(verdict).collect()
    }

    /// CiA 301 §7.5.2.35: types 0 to 240 take effect at the next SYNC, 254 and 255 at once.
    #[test]
    fn a_synchronous_rpdo_without_sync_has_no_effect() {
        for (kind, expected) in [
            (1, vec!["1500 7 no SYNC/hardware enable", "4000 7 yes /hardware enable"]),
            (240, vec!["1500 7 no SYNC/hardware enable", "4000 7 yes /hardware enable"]),
            (254, vec!["500 7 yes /hardware enable"]),
            (255, vec!["500 7 yes /hardware enable"]),
        ] {
            let write = [0x2F, 0x00, 0x14, 0x02, kind, 0, 0, 0];
            let mut frames: Vec<(i64, u16, &[u8])> = vec![
                (0, 0x702, &[0]),
                (10, 0x602, &write),
                (20, 0x582, &[0x60, 0x00, 0x14, 0x02, 0, 0, 0, 0]),
                (30, 0x000, &[1, 2]),
                (40, 0x702, &[5]),
                (500, 0x202, &[7, 0, 0, 0]),
            ];
            frames.extend((6..40).map(|step| (step * 100, 0x705, &[5][..])));
            frames.push((4000, 0x080, &[]));
            assert_eq!(verdicts_by_type(&frames), expected, "type {kind}");
        }
    }

    /// CiA 301 §7.2.2.3: an RPDO with less data than its mapping is not processed.
    #[test]
    fn an_rpdo_that_is_too_short_has_no_effect() {
        let frames: [(i64, u16, &[u8]); 10] = [
            (0, 0x702, &[0]),
            (30, 0x000, &[1, 2]),
            (40, 0x702, &[5]),
            (100, 0x202, &[7, 0, 0, 0]),
            // The value in force, then another one, twice.
            (200, 0x202, &[7, 0]),
            (300, 0x202, &[8, 0, 0]),
            (400, 0x202, &[8, 0, 0]),
            // Complete: with the same value, and longer than the mapping.
            (500, 0x202, &[8, 0, 0, 0]),
            (600, 0x202, &[9, 0, 0, 0, 0]),
            (700, 0x202, &[9, 0]),
        ];
        let expected = [
            "100 7 yes /hardware enable",
            "300 8 no RPDO length/hardware enable",
            "500 8 yes /hardware enable",
            "600 9 yes /hardware enable",
        ];
        assert_eq!(verdicts_by_type(&frames), expected);
    }
}
