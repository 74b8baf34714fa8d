//! Gaps of the whole bus, and their presumed cause by the events after them.

use std::collections::BTreeMap;

use super::span::format_span;
use crate::event::{BootCause, DtcAction, Event, EventKind, FrameRange, MessageOutcome, SdoOutcome};
use crate::frame::BusIndex;
use crate::session::CLOCK_SET;
use crate::wire::NodeId;

/// Max number of gaps with a cause; further ones are only counted.
const LISTED: usize = 8;

/// Time in ns after a gap in which events are evidence for its cause.
const AFTER: i64 = 2_000_000_000;

/// Presumed cause of a gap, strongest evidence last.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
enum GapCause {
    Unknown,
    ClockStep,
    Missing,
    DeadBus,
}

/// Whether events of this kind begin a gap, or show its cause.
pub(crate) const fn is_evidence(kind: &EventKind) -> bool {
    matches!(
        kind,
        EventKind::BusSilent { .. }
            | EventKind::Sync { .. }
            | EventKind::GuardReply { .. }
            | EventKind::SdoTransfer(_)
            | EventKind::J1939Transfer(_)
            | EventKind::IsoTpTransfer(_)
            | EventKind::Dtc(_)
            | EventKind::BootUp { .. }
            | EventKind::Emcy(_)
            | EventKind::CanError(_)
            | EventKind::Link { .. }
            | EventKind::ClockStep { .. }
    )
}

/// A gap of the whole bus.
#[derive(Debug, Clone)]
struct CaptureGap {
    bus: BusIndex,
    frames: FrameRange,
    gap: i64,
    /// Timestamp in ns until which evidence is collected.
    until: i64,
    cause: GapCause,
    evidence: String,
    /// SYNC counter before the gap, until the first SYNC after it.
    counter: Option<u8>,
    /// Toggle bits before the gap, until the first guarding response of the node after it.
    toggles: BTreeMap<NodeId, bool>,
}

/// The gaps of a capture.
#[derive(Debug, Clone, Default)]
pub(super) struct CaptureGaps {
    listed: Vec<CaptureGap>,
    /// Last SYNC counter by bus.
    counters: Vec<Option<u8>>,
    /// Last toggle bit by bus and node.
    toggles: BTreeMap<(BusIndex, NodeId), bool>,
}

impl CaptureGaps {
    /// Takes an event that may be evidence.
    pub(super) fn take_event(&mut self, event: &Event) {
        let bus = usize::from(event.bus.0);
        if let EventKind::Sync { counter, .. } = &event.kind {
            if self.counters.len() <= bus {
                self.counters.resize(bus + 1, None);
            }
            if let Some(last) = self.counters.get_mut(bus) {
                *last = *counter;
            }
        }
        if let EventKind::BusSilent { gap } = event.kind {
            return self.begin_gap(event, gap);
        }
        if let EventKind::ClockStep { step } = event.kind {
            return self.step_back(event, step);
        }
        if let (EventKind::GuardReply { toggle, .. }, Some(node)) = (&event.kind, event.node) {
            self.toggles.insert((event.bus, node), *toggle);
        }
        let time = event.time.map_or(i64::MIN, |time| time.0);
        let Some(hole) = self.listed.last_mut().filter(|hole| hole.bus == event.bus && time <= hole.until)
        else {
            return;
        };
        if let Some((cause, evidence)) = hole.gap_evidence(event).filter(|(cause, _)| *cause > hole.cause) {
            (hole.cause, hole.evidence) = (cause, evidence);
        }
    }

    fn begin_gap(&mut self, event: &Event, gap: i64) {
        if self.listed.len() >= LISTED {
            return;
        }
        let of_bus = self.toggles.iter().filter(|((bus, _), _)| *bus == event.bus);
        let toggles = of_bus.map(|((_, node), toggle)| (*node, *toggle)).collect();
        let set = gap > CLOCK_SET;
        let (cause, evidence) =
            if set { (GapCause::ClockStep, "longer than a year") } else { (GapCause::Unknown, "") };
        self.listed.push(CaptureGap {
            bus: event.bus,
            frames: event.frames,
            gap,
            until: event.time.map_or(i64::MIN, |time| time.0.saturating_add(AFTER)),
            cause,
            evidence: evidence.to_owned(),
            counter: self.counters.get(usize::from(event.bus.0)).copied().flatten(),
            toggles,
        });
    }

    /// Takes a backward step: one of about the size of the last gap shows that the clock was wrong in between. Timestamps
    /// after it are not those in which evidence is collected.
    fn step_back(&mut self, event: &Event, step: i64) {
        let Some(hole) = self.listed.last_mut().filter(|hole| hole.bus == event.bus) else { return };
        // The capture itself states the size of a forward step.
        if step >= 0 {
            return;
        }
        if step.saturating_neg().saturating_mul(2) >= hole.gap {
            let evidence = format!(
                "timestamps jump back by {} {{{}}}",
                format_span(step.saturating_neg()),
                event.frames.last
            );
            (hole.cause, hole.evidence) = (GapCause::ClockStep, evidence);
        }
        if step <= -AFTER {
            hole.until = i64::MIN;
        }
    }

    /// One statement per gap.
    pub(super) fn gap_texts(&self) -> impl Iterator<Item = String> {
        self.listed.iter().map(CaptureGap::gap_text)
    }
}

impl CaptureGap {
    /// Cause that an event after the gap shows.
    fn gap_evidence(&mut self, event: &Event) -> Option<(GapCause, String)> {
        let at = event.frames.last;
        let node = event.node.map_or_else(String::new, |node| format!(" of node {node}"));
        match &event.kind {
            EventKind::CanError(error) if error.is_only_counters() => None,
            EventKind::CanError(_) => Some((GapCause::DeadBus, format!("error frame {{{at}}}"))),
            EventKind::Link { .. } => Some((GapCause::DeadBus, "change of the link".to_owned())),
            EventKind::BootUp { cause: BootCause::PresumedPowerOn { .. }, .. } => {
                Some((GapCause::DeadBus, format!("boot-up{node} {{{at}}}")))
            }
            EventKind::Emcy(emcy) if emcy.boot.is_some() => {
                Some((GapCause::DeadBus, format!("boot sign{node} {{{at}}}")))
            }
            // Communication, CAN passive, life guard or heartbeat: CiA 301 §7.2.7.1, table 26.
            EventKind::Emcy(emcy) if matches!(emcy.code, Some(0x8100 | 0x8102 | 0x8130)) => {
                let code = emcy.code.unwrap_or_default();
                Some((GapCause::DeadBus, format!("EMCY {code:04X}{node} {{{at}}}")))
            }
            // Abnormal update rate, received network data in error: SAE J1939-73, failure mode identifiers.
            EventKind::Dtc(dtc) if matches!(dtc.fmi, 9 | 19) && dtc.action == DtcAction::Raised => {
                Some((GapCause::DeadBus, format!("DTC {}/{}{node} {{{at}}}", dtc.spn, dtc.fmi)))
            }
            EventKind::Sync { counter: Some(counter), expected } => {
                self.sync_evidence(*counter, *expected, at)
            }
            EventKind::GuardReply { toggle, .. } => {
                let before = self.toggles.remove(&event.node?)?;
                let verb = if before == *toggle { "repeats" } else { "continues" };
                let cause = if before == *toggle { GapCause::Missing } else { GapCause::ClockStep };
                Some((cause, format!("guarding{node} {verb} the toggle bit {{{at}}}")))
            }
            _ if !(event.frames.first..event.frames.last).contains(&self.frames.first) => None,
            EventKind::SdoTransfer(transfer) => {
                let is_whole = transfer.missing_segments == 0 && transfer.unseen == 0;
                Some(transfer_evidence("SDO transfer", &node, is_whole, at))
            }
            EventKind::J1939Transfer(transfer) => {
                let is_whole = transfer.outcome == SdoOutcome::Complete;
                (is_whole || transfer.missing > 0)
                    .then(|| transfer_evidence("transport session", &node, is_whole, at))
            }
            EventKind::IsoTpTransfer(transfer) => match transfer.outcome {
                MessageOutcome::Complete => Some(transfer_evidence("ISO-TP message", &node, true, at)),
                MessageOutcome::Incomplete => Some(transfer_evidence("ISO-TP message", &node, false, at)),
                _ => None,
            },
            _ => None,
        }
    }

    /// Evidence of the first SYNC counter after the gap.
    fn sync_evidence(&mut self, counter: u8, expected: Option<u8>, at: u64) -> Option<(GapCause, String)> {
        let before = self.counter.take()?;
        Some(match expected {
            Some(expected) => {
                (GapCause::Missing, format!("SYNC counter {counter} instead of {expected} {{{at}}}"))
            }
            // A counter that restarts at 1 shows nothing: the overflow value may be unknown.
            None if counter == 1 => return None,
            None => {
                (GapCause::ClockStep, format!("SYNC counter continues from {before} to {counter} {{{at}}}"))
            }
        })
    }

    fn gap_text(&self) -> String {
        let (gap, frames) = (format_span(self.gap), self.frames);
        let between = format!("no frame for {gap} between {{{}}} and {{{}}}", frames.first, frames.last);
        let evidence = &self.evidence;
        match self.cause {
            GapCause::Unknown => format!(
                "{between}, cause unknown: no counter, error frame or restart after it; no time limit applies across it"
            ),
            GapCause::ClockStep => format!("{between}, presumably a step of the clock: {evidence}"),
            GapCause::Missing => format!("{between}, presumably frames missing in the capture: {evidence}"),
            GapCause::DeadBus => format!("{between}, presumably a dead bus or power off: {evidence}"),
        }
    }
}

/// Evidence of a transfer that started before the gap and ended after it.
fn transfer_evidence(what: &str, node: &str, is_whole: bool, at: u64) -> (GapCause, String) {
    if is_whole {
        (GapCause::ClockStep, format!("{what}{node} continues {{{at}}}"))
    } else {
        (GapCause::Missing, format!("{what}{node} has missing frames {{{at}}}"))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::event::EventProtocol;
    use crate::frame::Timestamp;

    fn take_event(seconds: i64, frames: (u64, u64), kind: EventKind) -> Event {
        Event {
            time: Some(Timestamp(seconds * 1_000_000_000)),
            bus: BusIndex(0),
            frames: FrameRange { first: frames.0, last: frames.1 },
            protocol: EventProtocol::Can,
            node: None,
            presumed: false,
            routine: false,
            kind,
        }
    }

    /// Node 2 alternates the toggle bit: a repeated one shows missing frames.
    #[test]
    fn toggle_bits_of_guarding_continue_or_repeat() {
        let reply = |toggle| EventKind::GuardReply { state: None, code: 5, toggle, toggle_error: false };
        for (toggle, expected) in [
            (true, "presumably a step of the clock: guarding of node 2 continues the toggle bit {8}"),
            (
                false,
                "presumably frames missing in the capture: guarding of node 2 repeats the toggle bit {8}",
            ),
        ] {
            let mut holes = CaptureGaps::default();
            let by_node = |mut event: Event| {
                event.node = Some(NodeId::Canopen(2));
                event
            };
            holes.take_event(&by_node(take_event(1, (7, 7), reply(false))));
            holes.take_event(&take_event(61, (7, 8), EventKind::BusSilent { gap: 60_000_000_000 }));
            holes.take_event(&by_node(take_event(61, (8, 8), reply(toggle))));
            let words: String = holes.gap_texts().collect();
            assert!(words.ends_with(expected), "{words}");
        }
    }

    fn after(kinds: &[EventKind]) -> String {
        let mut holes = CaptureGaps::default();
        holes.take_event(&take_event(1, (7, 7), EventKind::Sync { counter: Some(9), expected: None }));
        holes.take_event(&take_event(61, (7, 8), EventKind::BusSilent { gap: 60_000_000_000 }));
        for (kind, number) in kinds.iter().zip(8..) {
            holes.take_event(&take_event(61, (number, number), kind.clone()));
        }
        holes.gap_texts().collect()
    }

    #[test]
    fn the_events_after_a_gap_show_its_cause() {
        let continued = EventKind::Sync { counter: Some(10), expected: None };
        let missing = EventKind::Sync { counter: Some(4), expected: Some(10) };
        let restarted = EventKind::Sync { counter: Some(1), expected: None };
        let link = EventKind::BusSilent { gap: 3_000_000_000 };
        assert!(
            after(&[]).contains("no frame for 1 min between {7} and {8}, cause unknown"),
            "{}",
            after(&[])
        );
        assert!(
            after(std::slice::from_ref(&continued))
                .ends_with("a step of the clock: SYNC counter continues from 9 to 10 {8}")
        );
        assert!(
            after(std::slice::from_ref(&missing))
                .ends_with("in the capture: SYNC counter 4 instead of 10 {8}")
        );
        assert!(after(&[restarted]).contains("cause unknown"));
        // Only the first SYNC after the gap shows whether the counter continued.
        assert!(after(&[continued, missing]).contains("a step of the clock"));
        assert_eq!(after(&[link]).matches("no frame for").count(), 2);
        // One wrong timestamp is a step forward and a step back; a boot-up long after it shows nothing.
        let back = EventKind::ClockStep { step: -59_000_000_000 };
        let boot = EventKind::BootUp { cause: BootCause::PresumedPowerOn { sign: None }, lost: 0 };
        let jumped = after(&[back, boot.clone()]);
        assert!(jumped.ends_with("a step of the clock: timestamps jump back by 59 s {8}"), "{jumped}");
        let jitter = EventKind::ClockStep { step: -10_000_000 };
        let commanded = EventKind::BootUp { cause: BootCause::Commanded { frame: 3 }, lost: 0 };
        assert!(after(&[commanded]).contains("cause unknown"));
        assert!(after(&[jitter, boot]).contains("boot-up {9}"));
    }
}
