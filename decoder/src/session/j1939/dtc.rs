//! Trouble codes over time: what DM1 and DM2 list becomes raised, recurred, no longer reported, previously
//! active and cleared, once each.
//!
//! ```text
//!            DM1 has it          DM1 without it, or silence of DM1
//!  unknown ────────────▶ active ───────────────────────────────▶ previously active ─DM3─▶ cleared
//!                          └─────────────────DM11, acknowledged─────────────────────────▶ cleared
//! ```

use std::sync::Arc;

use crate::event::{Dtc, DtcAction, EventKind, FrameRange};
use crate::frame::Frame;
use crate::profile::{Device, lamp_names};
use crate::session::node::Node;
use crate::session::timers::Subject;
use crate::session::{ACTIVE_ERROR_LIMIT, Bus, Observer};
use crate::wire::NodeId;
use crate::wire::j1939::{J1939Id, Lamps, Pgn, ReportedDtc, SpnConversion, TroubleCodes};

/// Milliseconds between two DM1 while a code is active, where the manual says nothing (J1939-73 §5.7.1.2).
const PERIOD: u32 = 1_000;

/// Periods without DM1 behind which its codes are no longer reported.
const PERIODS: i64 = 3;

/// What is given up where a device has had too many codes.
const PREVIOUS: &str = "previously active trouble code";

/// A code and since when it is known.
#[derive(Debug, Clone, Copy)]
struct Known {
    code: ReportedDtc,
    lamps: Lamps,
    first_frame: u64,
    last_frame: u64,
    /// Monotonic time of the first frame.
    since: i64,
    /// The list that is just read has it.
    is_listed: bool,
}

impl Known {
    fn new(code: ReportedDtc, lamps: Lamps, frame: u64, now: i64) -> Self {
        Self { code, lamps, first_frame: frame, last_frame: frame, since: now, is_listed: true }
    }

    fn is(&self, code: ReportedDtc) -> bool {
        (self.code.spn, self.code.fmi) == (code.spn, code.fmi)
    }
}

/// What became of a code.
#[derive(Debug, Clone, Copy)]
struct Change {
    known: Known,
    action: DtcAction,
}

/// Trouble codes of a device.
#[derive(Debug, Clone, Default)]
pub(in crate::session) struct Faults {
    /// Codes of the last DM1, in the order in which they were raised.
    active: Vec<Known>,
    /// Codes that were active; listed where DM2 had them.
    previous: Vec<Known>,
    /// Monotonic time and frame of the last DM1.
    last: i64,
    last_frame: u64,
    /// The silence of DM1 is in the timer queue.
    is_queued: bool,
    /// That there are more codes than are kept was said: active ones, previously active ones.
    is_said: [bool; 2],
}

impl Faults {
    /// SPN and FMI of active codes.
    pub(in crate::session) fn active(&self) -> impl Iterator<Item = (u32, u8)> {
        self.active.iter().map(|known| (known.code.spn, known.code.fmi))
    }

    /// All traffic stopped for so long.
    pub(in crate::session) fn postpone(&mut self, delay: i64) {
        self.last = self.last.saturating_add(delay);
    }

    /// Takes a DM1: what changed, and how many codes found no room.
    fn active_list(
        &mut self,
        codes: impl Iterator<Item = ReportedDtc>,
        lamps: Lamps,
        frame: u64,
        now: i64,
    ) -> (Vec<Change>, u64) {
        (self.last, self.last_frame) = (now, frame);
        self.active.iter_mut().for_each(|known| known.is_listed = false);
        let (mut changes, mut refused) = (Vec::new(), 0);
        for code in codes {
            let is_full = self.active.len() >= ACTIVE_ERROR_LIMIT;
            match self.active.iter_mut().find(|known| known.is(code)) {
                // One message may name a code twice.
                Some(known) if known.is_listed => {}
                Some(known) => {
                    let rose = known.code.count.zip(code.count).is_some_and(|(before, now)| now > before);
                    (known.code, known.lamps) = (code, lamps);
                    (known.last_frame, known.is_listed) = (frame, true);
                    if rose {
                        changes.push(Change { known: *known, action: DtcAction::Recurred });
                    }
                }
                None if is_full => refused += 1,
                None => {
                    let known = Known::new(code, lamps, frame, now);
                    self.active.push(known);
                    self.previous.retain(|previous| !previous.is(code));
                    changes.push(Change { known, action: DtcAction::Raised });
                }
            }
        }
        let ended = self.active.iter().filter(|known| !known.is_listed);
        changes.extend(ended.map(|known| Change { known: *known, action: DtcAction::NoLongerReported }));
        self.active.retain(|known| known.is_listed);
        (changes, refused)
    }

    /// A code left DM1 for good; says whether there is no room for it, once.
    fn was_active(&mut self, known: Known) -> bool {
        if self.previous.iter().any(|previous| previous.is(known.code)) {
            return false;
        }
        if self.previous.len() >= ACTIVE_ERROR_LIMIT {
            return self.must_say(1, 1);
        }
        self.previous.push(Known { is_listed: false, ..known });
        false
    }

    /// Takes a DM2: what was not known from an earlier one, and how many codes found no room.
    fn previous_list(
        &mut self,
        codes: impl Iterator<Item = ReportedDtc>,
        lamps: Lamps,
        frame: u64,
        now: i64,
    ) -> (Vec<Change>, u64) {
        let mut before = std::mem::take(&mut self.previous);
        let (mut changes, mut refused) = (Vec::new(), 0);
        for code in codes {
            if self.previous.iter().any(|known| known.is(code)) {
                continue;
            }
            let place = before.iter().position(|known| known.is(code));
            let known = place.map(|place| before.swap_remove(place));
            if self.previous.len() >= ACTIVE_ERROR_LIMIT {
                refused += 1;
                continue;
            }
            let was_told = known.is_some_and(|known| known.is_listed);
            let known = known.unwrap_or_else(|| Known::new(code, lamps, frame, now));
            let known = Known { code, last_frame: frame, is_listed: true, ..known };
            self.previous.push(known);
            if !was_told {
                changes.push(Change { known, action: DtcAction::PreviouslyActive });
            }
        }
        (changes, refused)
    }

    /// The device cleared its previously active codes, or all.
    fn clear(&mut self, all: bool) -> Vec<Change> {
        let active = if all { std::mem::take(&mut self.active) } else { Vec::new() };
        let mut cleared = std::mem::take(&mut self.previous);
        cleared.retain(|known| !active.iter().any(|active| active.is(known.code)));
        let changes = active.into_iter().chain(cleared);
        changes.map(|known| Change { known, action: DtcAction::Cleared }).collect()
    }

    /// Whether that codes find no room is still to be said.
    fn must_say(&mut self, list: usize, refused: u64) -> bool {
        let Some(said) = self.is_said.get_mut(list) else { return false };
        !std::mem::replace(said, refused > 0) && refused > 0
    }

    /// Bytes held.
    pub(super) fn footprint(&self) -> usize {
        (self.active.capacity() + self.previous.capacity()) * size_of::<Known>()
    }
}

impl Bus {
    /// A DM1 or DM2 of any length.
    pub(super) fn on_trouble_codes(
        &mut self,
        id: J1939Id,
        payload: &[u8],
        frames: FrameRange,
        frame: &Frame,
        out: &mut dyn Observer,
    ) {
        let list = match TroubleCodes::read(payload) {
            Ok(list) => list,
            Err(error) => {
                return self.malformed_j1939(id, error, "a list of faults has six bytes or more", frame, out);
            }
        };
        let node_id = NodeId::J1939(id.source);
        let now = self.clock.now();
        let is_active = id.pgn == Pgn::DM1;
        let Some(node) = self.node_mut(node_id) else { return };
        let codes = list.codes(conversion(node));
        let faults = &mut node.j1939_state().faults;
        let (changes, refused) = if is_active {
            faults.active_list(codes, list.lamps, frame.number, now)
        } else {
            faults.previous_list(codes, list.lamps, frame.number, now)
        };
        let must_say = faults.must_say(usize::from(!is_active), refused);
        for change in changes {
            self.trouble_code(node_id, change, frames, frame, out);
        }
        if must_say {
            let what = if is_active { "active trouble code" } else { PREVIOUS };
            self.emit_can(frame, EventKind::Evicted { what, count: refused }, out);
        }
        if is_active {
            self.await_dm1(node_id);
        }
    }

    /// Tells a change and what it brings.
    fn trouble_code(
        &mut self,
        id: NodeId,
        change: Change,
        frames: FrameRange,
        frame: &Frame,
        out: &mut dyn Observer,
    ) {
        let Some(node) = self.node_mut(id) else { return };
        let code = change.known.code;
        let has_ended = change.action == DtcAction::NoLongerReported;
        let may_be_hidden = has_ended && may_be_hidden(node, code);
        let evicted = has_ended && !may_be_hidden && node.j1939_state().faults.was_active(change.known);
        let kind = EventKind::Dtc(Box::new(Dtc { may_be_hidden, ..self.dtc(id, change) }));
        self.emit_frames(id, kind, frames, frame, out);
        if evicted {
            self.emit_can(frame, EventKind::Evicted { what: PREVIOUS, count: 1 }, out);
        }
        match change.action {
            DtcAction::Raised | DtcAction::Recurred => {
                self.device_saw_dtc(id, (code.spn, code.fmi), frame, out);
            }
            DtcAction::NoLongerReported | DtcAction::Cleared => self.reassess(id, frame, out),
            DtcAction::PreviouslyActive => {}
        }
    }

    fn dtc(&self, id: NodeId, Change { known, action }: Change) -> Dtc {
        let is_new = matches!(action, DtcAction::Raised | DtcAction::PreviouslyActive);
        let since = self.clock.now().saturating_sub(known.since);
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
            since: (self.clock.runs() && !is_new).then_some(since),
            may_be_hidden: false,
            by_silence: false,
        }
    }

    fn emit_frames(
        &self,
        id: NodeId,
        kind: EventKind,
        frames: FrameRange,
        frame: &Frame,
        out: &mut dyn Observer,
    ) {
        let mut event = self.event_of(frame, Some(id), kind);
        event.frames = frames;
        out.event(&event, self);
    }

    /// A device did what it was asked for. Only its acknowledgement of DM3 or DM11 clears: a request to all
    /// is not answered (J1939-73 §5.7.3), and without an answer nothing is known.
    pub(super) fn trouble_codes_cleared(
        &mut self,
        source: u8,
        pgn: Pgn,
        frame: &Frame,
        out: &mut dyn Observer,
    ) {
        let all = match pgn {
            Pgn::DM3 => false,
            Pgn::DM11 => true,
            _ => return,
        };
        let id = NodeId::J1939(source);
        let Some(state) = self.node_mut(id).and_then(|node| node.j1939.as_deref_mut()) else { return };
        for change in state.faults.clear(all) {
            self.trouble_code(id, change, FrameRange::one(frame.number), frame, out);
        }
    }

    /// Waits for the next DM1 of a node with active codes.
    pub(super) fn await_dm1(&mut self, id: NodeId) {
        let (now, runs) = (self.clock.now(), self.clock.runs());
        let Some(node) = self.node_mut(id) else { return };
        let silence = silence(&node.device);
        let Some(state) = node.j1939.as_deref_mut() else { return };
        let faults = &mut state.faults;
        if !runs || faults.is_queued || faults.active.is_empty() {
            return;
        }
        (faults.last, faults.is_queued) = (now, true);
        self.timers.add(now.saturating_add(silence), Subject::Dm1(id));
    }

    /// A node is not there any more: its silence says nothing.
    pub(super) fn forget_dm1(&mut self, id: NodeId) {
        let state = self.node_mut(id).and_then(|node| node.j1939.as_deref_mut());
        if state.is_some_and(|state| std::mem::take(&mut state.faults.is_queued)) {
            self.timers.remove(Subject::Dm1(id));
        }
    }

    /// The entry of a node's DM1 in the queue came due.
    pub(in crate::session) fn dm1_deadline(&mut self, id: NodeId, now: i64, out: &mut dyn Observer) {
        let Some(node) = self.node_mut(id) else { return };
        let silence = silence(&node.device);
        let faults = &mut node.j1939_state().faults;
        faults.is_queued = false;
        if faults.active.is_empty() {
            return;
        }
        let deadline = faults.last.saturating_add(silence);
        if deadline >= now {
            faults.is_queued = true;
            return self.timers.add(deadline, Subject::Dm1(id));
        }
        let (ended, number) = (std::mem::take(&mut faults.active), faults.last_frame);
        // The deadline's own time, and the last DM1 as the evidence.
        let frame = Frame { number, time: self.clock.stamp_of(deadline), ..Frame::EMPTY };
        for known in ended {
            let since = Some(deadline.saturating_sub(known.since));
            let change = Change { known, action: DtcAction::NoLongerReported };
            let dtc = Dtc { since, by_silence: true, ..self.dtc(id, change) };
            self.emit_frames(id, EventKind::Dtc(Box::new(dtc)), FrameRange::one(number), &frame, out);
        }
        self.reassess(id, &frame, out);
    }
}

impl Node {
    /// SPN and FMI of trouble codes that its last DM1 has.
    pub fn active_dtcs(&self) -> impl Iterator<Item = (u32, u8)> {
        self.j1939.iter().flat_map(|state| state.faults.active())
    }
}

/// How a device codes old SPNs, by the bus file, else by its profile.
fn conversion(node: &Node) -> Option<SpnConversion> {
    let given = node.j1939.as_ref().and_then(|state| state.conversion);
    given.or_else(|| node.device.j1939.spn_conversion.map(|conversion| conversion.0))
}

/// Nanoseconds without DM1 behind which its codes are no longer reported.
fn silence(device: &Arc<Device>) -> i64 {
    let period = match device.j1939.dm1_period {
        0 => PERIOD,
        period => period,
    };
    i64::from(period) * 1_000_000 * PERIODS
}

/// Whether a code that left DM1 may still be there: the device shows only its most urgent one, and one is
/// shown that is not surely less urgent.
fn may_be_hidden(node: &Node, left: ReportedDtc) -> bool {
    if !node.device.j1939.highest_only {
        return false;
    }
    let priority = |(spn, fmi)| node.device.dtc(spn, fmi).and_then(|own| own.priority);
    let left = priority((left.spn, left.fmi));
    let mut shown = node.active_dtcs().map(priority);
    shown.any(|shown| left.zip(shown).is_none_or(|(left, shown)| shown <= left))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::event::Event;
    use crate::frame::{BusIndex, CanId, Timestamp};
    use crate::session::{ProtocolChoice, SessionOptions};

    const DM1: u32 = 0x18FE_CA80;

    /// A bus that is J1939, a millisecond before its first frame.
    fn bus() -> Bus {
        let options = SessionOptions { protocol: ProtocolChoice::J1939, ..SessionOptions::default() };
        Bus::new(BusIndex(0), "can0", Arc::new(options))
    }

    fn frame(id: u32, number: u64, data: &[u8]) -> Frame {
        let time = Some(Timestamp(i64::try_from(number).unwrap() * 1_000_000));
        Frame { number, time, ..Frame::data_frame(CanId::extended(id), data) }
    }

    /// A list with FMI 3 of these SPNs below 65536.
    fn list(spns: impl IntoIterator<Item = u16>) -> Vec<u8> {
        let codes = spns.into_iter().flat_map(|spn| {
            let [low, high] = spn.to_le_bytes();
            [low, high, 3, 1]
        });
        [0, 0xFF].into_iter().chain(codes).collect()
    }

    /// What a payload of many packets makes: kind, action of codes, number of the given up.
    fn told(bus: &mut Bus, id: u32, number: u64, payload: &[u8]) -> Vec<(&'static str, u64)> {
        let mut all = Vec::new();
        let mut observer = |event: &Event, _: &Bus| {
            all.push(match &event.kind {
                EventKind::Dtc(dtc) => (dtc.action.name(), u64::from(dtc.spn)),
                EventKind::Evicted { what, count } => (*what, *count),
                kind => (kind.name(), 0),
            });
        };
        let frames = FrameRange { first: 1, last: number };
        let id = J1939Id::of(id).unwrap();
        bus.on_j1939_payload(id, payload, frames, &frame(DM1, number, &[]), &mut observer);
        all
    }

    #[test]
    fn a_code_named_twice_is_one() {
        let mut bus = bus();
        assert_eq!(told(&mut bus, DM1, 1, &list([7, 8, 7])), [("raised", 7), ("raised", 8)]);
        assert_eq!(told(&mut bus, DM1, 2, &list([8, 7])), []);
        assert_eq!(told(&mut bus, DM1, 3, &list([9, 8])), [("raised", 9), ("no-longer-reported", 7)]);
        let errors: Vec<_> = bus.node(NodeId::J1939(0x80)).unwrap().errors().collect();
        assert_eq!(errors, ["SPN 8 FMI 3", "SPN 9 FMI 3"]);
    }

    #[test]
    fn more_codes_than_are_kept_are_said_once() {
        let mut bus = bus();
        let limit = u64::try_from(ACTIVE_ERROR_LIMIT).unwrap();
        // 445 codes fill the longest message of J1939-21.
        let all = told(&mut bus, DM1, 1, &list(1..=445));
        assert_eq!(all.iter().filter(|(what, _)| *what == "raised").count(), ACTIVE_ERROR_LIMIT);
        assert_eq!(all.last(), Some(&("active trouble code", 445 - limit)));
        assert_eq!(told(&mut bus, DM1, 2, &list(1..=445)), []);
        assert_eq!(told(&mut bus, DM1, 3, &list(1..=64)), []);
        assert_eq!(told(&mut bus, DM1, 4, &list(1..=66)), [("active trouble code", 2)]);
        let all = told(&mut bus, 0x18FE_CB80, 5, &list(100..=200));
        assert_eq!(all.len(), ACTIVE_ERROR_LIMIT + 1);
        assert_eq!(all.last(), Some(&(PREVIOUS, 101 - limit)));
        assert_eq!(told(&mut bus, 0x18FE_CB80, 6, &list(100..=200)), []);
    }

    #[test]
    fn dm2_alone_tells_what_was_listed() {
        let mut bus = bus();
        told(&mut bus, DM1, 1, &list([7]));
        told(&mut bus, DM1, 2, &list([0]));
        // What left DM1 is listed now, and told once; what is not listed any more comes anew.
        assert_eq!(
            told(&mut bus, 0x18FE_CB80, 3, &list([7, 9])),
            [("previously-active", 7), ("previously-active", 9)]
        );
        assert_eq!(told(&mut bus, 0x18FE_CB80, 4, &list([9])), []);
        assert_eq!(told(&mut bus, 0x18FE_CB80, 5, &list([7, 9])), [("previously-active", 7)]);
    }

    #[test]
    fn a_silence_of_all_is_no_silence_of_dm1() {
        let mut bus = bus();
        let run = |bus: &mut Bus, from: u64, to: u64, with_dm1: bool| {
            let mut ended = 0;
            let mut observer = |event: &Event, _: &Bus| {
                ended += u64::from(matches!(&event.kind, EventKind::Dtc(dtc) if dtc.by_silence));
            };
            // Every 10 ms another one's message, which makes a pattern, and the DM1 once.
            for number in (from..=to).step_by(10) {
                bus.push(&frame(0x18FF_0081, number, &[0]), &mut observer);
            }
            if with_dm1 {
                bus.push(&frame(DM1, to, &list([7])), &mut observer);
            }
            ended
        };
        // DM1 at 1 s: its time is over at 4 s. All stop from 3.7 s to 8.7 s, so it is over at 9 s.
        assert_eq!(run(&mut bus, 10, 1_000, true), 0);
        assert_eq!(run(&mut bus, 1_010, 3_700, false), 0);
        assert_eq!(run(&mut bus, 8_700, 9_000, false), 0);
        assert_eq!(bus.node(NodeId::J1939(0x80)).unwrap().active_dtcs().collect::<Vec<_>>(), [(7, 3)]);
        assert_eq!(run(&mut bus, 9_010, 9_010, false), 1);
        assert_eq!(bus.node(NodeId::J1939(0x80)).unwrap().active_dtcs().count(), 0);
    }
}
