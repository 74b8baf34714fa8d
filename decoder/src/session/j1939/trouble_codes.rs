//! Trouble codes over time: the lists in DM1 and DM2 become single events, raised, recurred, no longer
//! reported, previously active and cleared.
//!
//! ```text
//!            in DM1              not in DM1, or DM1 missing
//!  unknown ────────────▶ active ───────────────────────────────▶ previously active ─DM3─▶ cleared
//!                          └─────────────────DM11, acknowledged─────────────────────────▶ cleared
//! ```

use std::sync::Arc;

use super::payload::GroupPayload;
use crate::event::{Dtc, DtcAction, EventKind, EvictedState, FrameRange};
use crate::frame::Frame;
use crate::profile::{DeviceProfile, lamp_names};
use crate::session::bus::{Bus, DtcChange, Node};
use crate::session::context::MachineContext;
use crate::session::device::{on_trouble_code, reassess_set_points};
use crate::session::machine::{ProtocolMachine, TimedMachine};
use crate::session::timers::DeadlineSubject;
use crate::wire::NodeId;
use crate::wire::j1939::{Pgn, ReportedDtc, SpnConversion, TroubleCodeList as DtcList};

/// Period of DM1 in ms while a code is active, unless the profile gives another (J1939-73 §5.7.1.2).
const PERIOD: u32 = 1_000;

/// Periods without DM1 after which its codes are no longer reported.
const PERIODS: i64 = 3;

/// DM1 and DM2 of all addresses; the codes of each are in its node.
#[derive(Debug, Clone)]
pub(in crate::session) struct TroubleCodeMachine;

impl ProtocolMachine for TroubleCodeMachine {
    type Route<'a> = GroupPayload<'a>;
    type Product = ();

    /// Handles a DM1 or DM2 of any length.
    fn on_frame(&mut self, payload: GroupPayload<'_>, frame: &Frame, cx: &mut MachineContext<'_>) {
        let GroupPayload { id, data, frames } = payload;
        let list = match DtcList::read(data) {
            Ok(list) => list,
            Err(error) => {
                return cx.emit_malformed_j1939(id, error, "a list of faults has six bytes or more", frame);
            }
        };
        let node_id = NodeId::J1939(id.source);
        let now = cx.bus.clock.now();
        let is_active = id.pgn == Pgn::DM1;
        let Some(node) = cx.bus.nodes.node_mut(node_id) else { return };
        let codes = list.codes(conversion_method(node));
        let faults = &mut node.j1939_state().faults;
        let (changes, refused) = if is_active {
            faults.active_list(codes, list.lamps, frame.number, now)
        } else {
            faults.previous_list(codes, list.lamps, frame.number, now)
        };
        let should_report_overflow = faults.should_report_overflow(usize::from(!is_active), refused);
        for change in changes {
            emit_trouble_code(node_id, change, frames, frame, cx);
        }
        if should_report_overflow {
            let what =
                if is_active { EvictedState::ActiveTroubleCode } else { EvictedState::PreviousTroubleCode };
            cx.emit_can(frame, EventKind::Evicted { what, count: refused });
        }
        if is_active {
            schedule_dm1_deadline(node_id, cx);
        }
    }

    fn on_silence(&mut self, delay: i64, bus: &mut Bus) {
        for state in bus.nodes.all_mut().iter_mut().filter_map(|node| node.j1939.as_deref_mut()) {
            state.faults.postpone_dm1(delay);
        }
    }
}

impl TimedMachine for TroubleCodeMachine {
    /// Node with active codes.
    type Deadline = NodeId;

    fn on_deadline(&mut self, id: NodeId, now: i64, cx: &mut MachineContext<'_>) {
        let Some(node) = cx.bus.nodes.node_mut(id) else { return };
        let silence = code_timeout(&node.device);
        let faults = &mut node.j1939_state().faults;
        faults.is_queued = false;
        if faults.active.is_empty() {
            return;
        }
        let deadline = faults.last.saturating_add(silence);
        if deadline >= now {
            faults.is_queued = true;
            return cx.timers.add_deadline(deadline, DeadlineSubject::Dm1(id));
        }
        let (ended, number) = (std::mem::take(&mut faults.active), faults.last_frame);
        // The event has the time of the deadline, and the last DM1 as evidence.
        let frame = Frame { number, time: cx.bus.clock.stamp_of(deadline), ..Frame::EMPTY };
        for known in ended {
            let since = Some(deadline.saturating_sub(known.since));
            let change = DtcChange { known, action: DtcAction::NoLongerReported };
            let dtc = Dtc { since, by_silence: true, ..describe_trouble_code(&cx.bus, id, change) };
            emit_frames(id, EventKind::Dtc(Box::new(dtc)), FrameRange::one(number), &frame, cx);
        }
        reassess_set_points(id, &frame, cx);
    }
}

/// Emits a change of a trouble code and applies its effects.
fn emit_trouble_code(
    id: NodeId,
    change: DtcChange,
    frames: FrameRange,
    frame: &Frame,
    cx: &mut MachineContext<'_>,
) {
    let Some(node) = cx.bus.nodes.node_mut(id) else { return };
    let code = change.known.code;
    let has_ended = change.action == DtcAction::NoLongerReported;
    let may_be_hidden = has_ended && may_be_hidden(node, code);
    let evicted = has_ended && !may_be_hidden && node.j1939_state().faults.was_active(change.known);
    let kind = EventKind::Dtc(Box::new(Dtc { may_be_hidden, ..describe_trouble_code(&cx.bus, id, change) }));
    emit_frames(id, kind, frames, frame, cx);
    if evicted {
        cx.emit_can(frame, EventKind::Evicted { what: EvictedState::PreviousTroubleCode, count: 1 });
    }
    match change.action {
        DtcAction::Raised | DtcAction::Recurred => {
            on_trouble_code(id, (code.spn, code.fmi), frame, cx);
        }
        DtcAction::NoLongerReported | DtcAction::Cleared => reassess_set_points(id, frame, cx),
        DtcAction::PreviouslyActive => {}
    }
}

fn describe_trouble_code(bus: &Bus, id: NodeId, DtcChange { known, action }: DtcChange) -> Dtc {
    let is_new = matches!(action, DtcAction::Raised | DtcAction::PreviouslyActive);
    let since = bus.clock.now().saturating_sub(known.since);
    Dtc {
        spn: known.code.spn,
        fmi: known.code.fmi,
        count: known.code.count,
        action,
        source: id.number(),
        is_old_coding: known.code.is_assumed,
        lamps: lamp_names(known.lamps).collect(),
        first_frame: known.first_frame,
        last_frame: known.last_frame,
        since: (bus.clock.has_timestamps() && !is_new).then_some(since),
        may_be_hidden: false,
        by_silence: false,
    }
}

fn emit_frames(id: NodeId, kind: EventKind, frames: FrameRange, frame: &Frame, cx: &mut MachineContext<'_>) {
    let mut event = cx.event_of(frame, Some(id), kind);
    event.frames = frames;
    cx.send_event(&event);
}

/// Clears trouble codes after a positive acknowledgement of DM3 or DM11. A request to all is not acknowledged
/// (J1939-73 §5.7.3): its result is unknown.
pub(in crate::session) fn clear_trouble_codes(
    source: u8,
    pgn: Pgn,
    frame: &Frame,
    cx: &mut MachineContext<'_>,
) {
    let all = match pgn {
        Pgn::DM3 => false,
        Pgn::DM11 => true,
        _ => return,
    };
    let id = NodeId::J1939(source);
    let Some(state) = cx.bus.nodes.node_mut(id).and_then(|node| node.j1939.as_deref_mut()) else { return };
    for change in state.faults.clear_codes(all) {
        emit_trouble_code(id, change, FrameRange::one(frame.number), frame, cx);
    }
}

/// Sets the deadline for the next DM1 of a node with active codes.
pub(in crate::session) fn schedule_dm1_deadline(id: NodeId, cx: &mut MachineContext<'_>) {
    let (now, runs) = (cx.bus.clock.now(), cx.bus.clock.has_timestamps());
    let Some(node) = cx.bus.nodes.node_mut(id) else { return };
    let silence = code_timeout(&node.device);
    let Some(state) = node.j1939.as_deref_mut() else { return };
    let faults = &mut state.faults;
    if !runs || faults.is_queued || faults.active.is_empty() {
        return;
    }
    (faults.last, faults.is_queued) = (now, true);
    cx.timers.add_deadline(now.saturating_add(silence), DeadlineSubject::Dm1(id));
}

/// Cancels the DM1 deadline of a node that lost its address.
pub(in crate::session) fn cancel_dm1_deadline(id: NodeId, cx: &mut MachineContext<'_>) {
    let state = cx.bus.nodes.node_mut(id).and_then(|node| node.j1939.as_deref_mut());
    if state.is_some_and(|state| std::mem::take(&mut state.faults.is_queued)) {
        cx.timers.remove_subject(DeadlineSubject::Dm1(id));
    }
}

/// Conversion method of old SPNs, from the bus file, otherwise from the profile.
fn conversion_method(node: &Node) -> Option<SpnConversion> {
    let given = node.j1939.as_ref().and_then(|state| state.conversion);
    given.or_else(|| node.device.j1939.spn_conversion.map(|conversion| conversion.0))
}

/// Time in ns without DM1 after which its codes are no longer reported.
fn code_timeout(device: &Arc<DeviceProfile>) -> i64 {
    let period = match device.j1939.dm1_period {
        0 => PERIOD,
        period => period,
    };
    i64::from(period) * 1_000_000 * PERIODS
}

/// Whether a code missing in DM1 may still be active: the device lists only its code of highest priority,
/// and the listed one may have a higher priority.
fn may_be_hidden(node: &Node, left: ReportedDtc) -> bool {
    if !node.device.j1939.highest_only {
        return false;
    }
    let priority = |(spn, fmi)| node.device.trouble_code_entry(spn, fmi).and_then(|own| own.priority);
    let left = priority((left.spn, left.fmi));
    let mut shown = node.active_dtcs().map(priority);
    shown.any(|shown| left.zip(shown).is_none_or(|(left, shown)| shown <= left))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::event::Event;
    use crate::frame::{BusIndex, CanId, Timestamp};
    use crate::session::BusDecoder;
    use crate::session::limits::ACTIVE_ERROR_LIMIT;
    use crate::session::{ProtocolChoice, SessionOptions};
    use crate::wire::j1939::J1939Id;

    const DM1: u32 = 0x18FE_CA80;

    /// A J1939 bus before its first frame.
    fn bus() -> BusDecoder {
        let options = SessionOptions { protocol: ProtocolChoice::J1939, ..SessionOptions::default() };
        BusDecoder::new(BusIndex(0), "can0", Arc::new(options))
    }

    fn frame(id: u32, number: u64, data: &[u8]) -> Frame {
        let time = Some(Timestamp(i64::try_from(number).unwrap() * 1_000_000));
        Frame { number, time, ..Frame::data_frame(CanId::from_extended(id), data) }
    }

    /// A list with FMI 3 for these SPNs below 65536.
    fn list(spns: impl IntoIterator<Item = u16>) -> Vec<u8> {
        let codes = spns.into_iter().flat_map(|spn| {
            let [low, high] = spn.to_le_bytes();
            [low, high, 3, 1]
        });
        [0, 0xFF].into_iter().chain(codes).collect()
    }

    /// Events of a multi-packet payload: kind or action, with SPN or number of evicted codes.
    fn transfer_results(
        bus: &mut BusDecoder,
        id: u32,
        number: u64,
        payload: &[u8],
    ) -> Vec<(&'static str, u64)> {
        let mut all = Vec::new();
        let mut observer = |event: &Event, _: &Bus| {
            all.push(match &event.kind {
                EventKind::Dtc(dtc) => (dtc.action.name(), u64::from(dtc.spn)),
                EventKind::Evicted { what, count } => (what.name(), *count),
                kind => (kind.name(), 0),
            });
        };
        let frames = FrameRange { first: 1, last: number };
        let id = J1939Id::from_identifier(id).unwrap();
        bus.on_payload(GroupPayload { id, data: payload, frames }, &frame(DM1, number, &[]), &mut observer);
        all
    }

    #[test]
    fn a_code_named_twice_is_one() {
        let mut bus = bus();
        assert_eq!(transfer_results(&mut bus, DM1, 1, &list([7, 8, 7])), [("raised", 7), ("raised", 8)]);
        assert_eq!(transfer_results(&mut bus, DM1, 2, &list([8, 7])), []);
        assert_eq!(
            transfer_results(&mut bus, DM1, 3, &list([9, 8])),
            [("raised", 9), ("no-longer-reported", 7)]
        );
        let errors: Vec<_> = bus.bus().node(NodeId::J1939(0x80)).unwrap().error_texts().collect();
        assert_eq!(errors, ["SPN 8 FMI 3", "SPN 9 FMI 3"]);
    }

    #[test]
    fn codes_over_the_limit_are_reported_once() {
        let mut bus = bus();
        let limit = u64::try_from(ACTIVE_ERROR_LIMIT).unwrap();
        // 445 codes fill the longest message of J1939-21.
        let all = transfer_results(&mut bus, DM1, 1, &list(1..=445));
        assert_eq!(all.iter().filter(|(what, _)| *what == "raised").count(), ACTIVE_ERROR_LIMIT);
        assert_eq!(all.last(), Some(&("active trouble code", 445 - limit)));
        assert_eq!(transfer_results(&mut bus, DM1, 2, &list(1..=445)), []);
        assert_eq!(transfer_results(&mut bus, DM1, 3, &list(1..=64)), []);
        assert_eq!(transfer_results(&mut bus, DM1, 4, &list(1..=66)), [("active trouble code", 2)]);
        let all = transfer_results(&mut bus, 0x18FE_CB80, 5, &list(100..=200));
        assert_eq!(all.len(), ACTIVE_ERROR_LIMIT + 1);
        assert_eq!(all.last(), Some(&("previously active trouble code", 101 - limit)));
        assert_eq!(transfer_results(&mut bus, 0x18FE_CB80, 6, &list(100..=200)), []);
    }

    #[test]
    fn dm2_alone_tells_what_was_listed() {
        let mut bus = bus();
        transfer_results(&mut bus, DM1, 1, &list([7]));
        transfer_results(&mut bus, DM1, 2, &list([0]));
        // Codes that left DM1 are in DM2 and emitted once; a code missing in DM2 is emitted again later.
        assert_eq!(
            transfer_results(&mut bus, 0x18FE_CB80, 3, &list([7, 9])),
            [("previously-active", 7), ("previously-active", 9)]
        );
        assert_eq!(transfer_results(&mut bus, 0x18FE_CB80, 4, &list([9])), []);
        assert_eq!(transfer_results(&mut bus, 0x18FE_CB80, 5, &list([7, 9])), [("previously-active", 7)]);
    }

    #[test]
    fn a_silence_of_all_is_no_silence_of_dm1() {
        let mut bus = bus();
        let run = |bus: &mut BusDecoder, from: u64, to: u64, with_dm1: bool| {
            let mut ended = 0;
            let mut observer = |event: &Event, _: &Bus| {
                ended += u64::from(matches!(&event.kind, EventKind::Dtc(dtc) if dtc.by_silence));
            };
            // Messages of three other devices every 10 ms make the traffic periodic; DM1 is sent once.
            for number in (from..=to).step_by(10) {
                for id in [0x18FF_0081, 0x18FF_0082, 0x18FF_0083] {
                    bus.push(&frame(id, number, &[0]), &mut observer);
                }
            }
            if with_dm1 {
                bus.push(&frame(DM1, to, &list([7])), &mut observer);
            }
            ended
        };
        // DM1 at 1 s: deadline 4 s. All traffic stops from 3.7 s to 8.7 s, so the deadline moves to 9 s.
        assert_eq!(run(&mut bus, 10, 1_000, true), 0);
        assert_eq!(run(&mut bus, 1_010, 3_700, false), 0);
        assert_eq!(run(&mut bus, 8_700, 9_000, false), 0);
        assert_eq!(bus.bus().node(NodeId::J1939(0x80)).unwrap().active_dtcs().collect::<Vec<_>>(), [(7, 3)]);
        assert_eq!(run(&mut bus, 9_010, 9_010, false), 1);
        assert_eq!(bus.bus().node(NodeId::J1939(0x80)).unwrap().active_dtcs().count(), 0);
    }
}
