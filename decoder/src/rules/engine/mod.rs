//! Runs the rules over the events of a capture.

mod bus_judge;
mod interests;
pub(super) mod names;
mod needs;
pub(super) mod setup;
mod short_path;

use std::sync::Arc;

use self::bus_judge::BusJudge;
use self::setup::RuleSetup;
use super::ledger::causes::cause_table;
use super::ledger::{FindingLedger, GroupChange, LedgerNews, add_conclusions, lower_power_cycles};
use crate::event::{Event, EventKind, EventProtocol, Kind, KindSet};
use crate::finding::CaptureFindings;
use crate::frame::{Frame, FrameFlags};
use crate::session::{Bus, Buses, Observer};
use crate::statistics::{CaptureQuality, is_evidence};
use crate::suggestion::{Suggestion, firm_suggestions};

/// Number of frames after which the timestamp resolution is final.
const STAMPS_JUDGED: u64 = 1_000;

/// Event kinds that limit the significance of verdicts.
const LIMITING: KindSet = KindSet::of(&[
    Kind::Unreadable,
    Kind::LostFrames,
    Kind::ClockStep,
    Kind::BusSilent,
    Kind::Link,
    Kind::SdoTransfer,
]);

/// Event kinds with facts that may explain findings.
const FACTS: KindSet = KindSet::of(&[
    Kind::NmtCommand,
    Kind::NmtState,
    Kind::SdoTransfer,
    Kind::CanError,
    Kind::BootUp,
    Kind::Emcy,
    Kind::AddressClaim,
    Kind::J1939Request,
]);

/// Runs the rules over one capture. Each bus has its own instances of the rules.
pub struct RuleEngine {
    setup: Arc<RuleSetup>,
    ledger: FindingLedger,
    buses: Vec<BusJudge>,
    quality: CaptureQuality,
    /// Findings about times, held back until the timestamps are known to be real.
    held: Vec<LedgerNews>,
    /// Event kinds that may explain findings or limit verdicts.
    explaining: KindSet,
}

impl RuleEngine {
    /// Creates an engine in its initial state.
    pub fn new(setup: Arc<RuleSetup>) -> Self {
        Self {
            ledger: FindingLedger::new(&setup.policy),
            setup,
            buses: Vec::new(),
            quality: CaptureQuality::default(),
            held: Vec::new(),
            explaining: cause_table().explaining_names().or(FACTS).or(LIMITING),
        }
    }

    /// Processes a frame before its events; its timestamp shows how reliable times are.
    #[inline]
    pub fn on_frame(&mut self, frame: &Frame) {
        self.quality.count_frame(frame);
        if let Some(judge) = self.buses.get_mut(usize::from(frame.bus.0)) {
            judge.shared.meter.measure_frame(frame);
            if judge.shared.meter.is_over() {
                judge.quiet_until = i64::MIN;
            }
        }
    }

    /// Processes the next frames before the events of the first one: the first frame as [`Self::on_frame`], or as many as only
    /// add to counts. Returns their number, 0 only without any frame.
    pub fn on_frames(&mut self, frames: &[Frame]) -> usize {
        let Some(first) = frames.first() else { return 0 };
        let judge = self.buses.get_mut(usize::from(first.bus.0));
        let Some((judge, latest)) = judge.zip(self.quality.latest_final()) else {
            self.on_frame(first);
            return 1;
        };
        let meter = &mut judge.shared.meter;
        let mut latest = latest;
        let is_counted = |frame: &&Frame| {
            let time =
                frame.time.map(|time| time.0).filter(|time| *time >= latest && meter.is_in_second(*time));
            latest = time.unwrap_or(latest);
            time.is_some() && frame.bus == first.bus && !frame.flags.contains(FrameFlags::ERROR)
        };
        match frames.iter().take_while(is_counted).count() {
            0 => {
                self.on_frame(first);
                1
            }
            count => {
                let counted = frames.get(..count).unwrap_or(frames);
                meter.count_frames(counted);
                self.quality.count_frames(counted);
                count
            }
        }
    }

    /// Runs the rules on an event. Findings that open or close are emitted to `out` as events.
    #[inline]
    pub fn on_event(&mut self, event: &Event, bus: &Bus, out: &mut dyn Observer) {
        if matches!(event.kind, EventKind::Pdo(_)) && self.event_for_few(event, bus) {
            return self.emit_if_any(bus, out);
        }
        let index = usize::from(bus.index().0);
        while self.buses.len() <= index {
            self.buses.push(BusJudge::new(bus, &self.setup, &mut self.ledger));
        }
        if let EventKind::TestCase(_) = &event.kind {
            // Checks before the marker belong to the case before.
            for judge in &mut self.buses {
                judge.pass_on_all_skipped(bus, &mut self.ledger);
            }
            self.end_quiet();
        }
        if let Some(judge) = self.buses.get_mut(index) {
            if self.quality.frames <= STAMPS_JUDGED {
                judge.shared.granularity = self.quality.granularity().unwrap_or(0);
            }
            judge.on_event(event, bus, &mut self.ledger);
            let explains = self.explaining.contains(&event.kind);
            if explains {
                self.ledger.note_event(event.kind.kind(), bus.index(), judge.shared.now);
                self.ledger.observe_event(event, bus, judge.shared.now);
            }
            if explains || is_evidence(&event.kind) {
                self.quality.count_event(event);
            }
        }
        // After the rules: findings at the end marker still belong to the case.
        if let EventKind::TestCase(marker) = &event.kind {
            self.ledger.on_marker(*marker, event.frames.last);
        }
        self.emit_if_any(bus, out);
    }

    #[inline]
    fn emit_if_any(&mut self, bus: &Bus, out: &mut dyn Observer) {
        if !self.ledger.news.is_empty() || !self.held.is_empty() {
            self.emit_news(bus, self.quality.has_varied(), out);
            self.end_quiet();
        }
    }

    /// Advances the time of a quiet live bus. Only the next frame shows whether the whole bus was silent,
    /// which suspends deadlines. Deadlines are therefore not checked while a silence is possible.
    pub fn advance_time(&mut self, bus: &Bus, out: &mut dyn Observer) {
        if let Some(judge) = self.buses.get_mut(usize::from(bus.index().0))
            && bus.silence_limit().is_none()
        {
            judge.pass_time(bus.now(), bus, &mut self.ledger);
        }
        self.emit_news(bus, true, out);
        self.end_quiet();
    }

    /// Ends the capture: closes open findings and returns all results.
    pub fn finish_capture(mut self, buses: Buses<'_>, out: &mut dyn Observer) -> CaptureFindings {
        for (judge, bus) in self.buses.iter_mut().zip(buses) {
            judge.pass_on_all_skipped(bus, &mut self.ledger);
            judge.call_all(bus, &mut self.ledger, |rule, context| rule.on_end(context));
            self.ledger.close_all(bus);
        }
        for (rule, bus) in self.setup.expectations_elsewhere(buses) {
            if self.ledger.rules.get(usize::from(rule)).is_some_and(|info| info.is_on) {
                self.ledger.note_unexercised(rule, format!("no bus '{bus}' in the capture"));
            }
        }
        let is_timed = self.quality.is_timed();
        let mut notes = self.quality.limit_texts();
        if is_timed {
            notes.extend(self.ledger.lower_explained(buses));
            for bus in buses {
                lower_power_cycles(&mut self.ledger, bus);
                add_conclusions(&mut self.ledger, bus);
            }
        }
        for bus in buses {
            self.emit_news(bus, is_timed, out);
        }
        notes.extend(buses.iter().flat_map(|bus| profile_notes(bus, buses.len() == 1)));
        let error_frames = self.quality.error_frames;
        CaptureFindings { error_frames, ..self.ledger.into_findings(is_timed, notes) }
    }

    /// Results up to now, with open findings as at an end of the capture. Conditions that rules judge only at the
    /// end are not among them. Costs a copy of all groups.
    pub fn so_far(&mut self, buses: Buses<'_>) -> CaptureFindings {
        for (judge, bus) in self.buses.iter_mut().zip(buses) {
            judge.pass_on_all_skipped(bus, &mut self.ledger);
        }
        self.end_quiet();
        let mut ledger = self.ledger.clone();
        for bus in buses {
            ledger.close_all(bus);
        }
        if self.quality.is_timed() {
            ledger.lower_explained(buses);
        }
        let error_frames = self.quality.error_frames;
        CaptureFindings { error_frames, ..ledger.into_findings(self.quality.is_timed(), Vec::new()) }
    }

    /// Emits new findings; those about times are held back until times are known to be real.
    #[cold]
    fn emit_news(&mut self, bus: &Bus, is_timed: bool, out: &mut dyn Observer) {
        let mut news = std::mem::take(&mut self.held);
        news.append(&mut self.ledger.news);
        for one in news {
            let Some((group, stated)) = self.ledger.finding_news(one) else { continue };
            let rule = self.ledger.rules.get(usize::from(group.key.rule));
            let waits =
                rule.is_some_and(|rule| rule.is_timing) && !is_timed && !self.ledger.is_by_order(&one);
            if waits || group.key.bus != bus.index() {
                self.held.push(one);
                continue;
            }
            let is_repeated = stated.count > 1;
            let kind = match one.what {
                GroupChange::Opened => EventKind::FindingOpened(Box::new(stated)),
                GroupChange::Closed | GroupChange::Ended => EventKind::FindingClosed(Box::new(stated)),
            };
            let event = Event {
                time: one.at.time,
                bus: group.key.bus,
                frames: one.at.frames,
                protocol: EventProtocol::Can,
                node: group.key.node,
                presumed: false,
                routine: matches!(kind, EventKind::FindingClosed(_)) && !is_repeated,
                kind,
            };
            out.on_event(&event, bus);
        }
    }
}

/// Statements on nodes whose profile is only suggested by their behaviour.
fn profile_notes(bus: &Bus, is_only: bool) -> Vec<String> {
    let found = firm_suggestions(bus);
    let note = |one: &Suggestion| {
        format!("{}; without its profile the rules of its manual are not exercised", one.text(bus, is_only))
    };
    found.iter().map(note).collect()
}
