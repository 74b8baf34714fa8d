//! Frames without an event: what the rules need of the next ones, and what they count of those that were skipped.
//!
//! - A rule states in `Rule::frame_need`, once per identifier, what it needs of the next frames: payload bits, the shortest and the
//!   longest interval, the number of frames, contents in turn, error indicators of J1939, or each frame; and whether a frame
//!   without an event counts as passed. A rule calls `Context::ask_again` if its answer changes; a new layout and a silence of
//!   the bus ask again, too, and a new usual interval if the answer follows it.
//! - If only few rules need the event of a PDO, the frame is counted for all others in the same call, and its event reaches
//!   only these few (`RuleEngine::event_for_few`).
//! - Device rules read the last values of a PDO from its last payload (`rules/device/values.rs`) until a bit changes that a
//!   condition or a rule about changes uses.
//! - A frame after a deadline of a rule gets its event, unless the rule only sets the next deadline (`Rule::postponed_wake`). The
//!   engine keeps the time up to which no deadline, end of a second or held finding needs an event: a skipped frame is
//!   compared with this time only.
//!
//! A question per frame was preferred to bounds that the session keeps for its observers: these would have to be kept up to
//! date for every observer and checkpoint.

use std::cmp::Reverse;

use super::bus_judge::{BusJudge, CountedFrame, RuleInstance};
use super::needs::{FrameRecipients, NeedAnswer};
use super::{RuleEngine, STAMPS_JUDGED};
use crate::event::{Event, EventKind};
use crate::rules::ledger::FindingLedger;
use crate::session::{Bus, MessagePreview};

/// Frames after an event for few rules in which more of them are expected.
const LATELY: u64 = 4_096;

impl RuleEngine {
    /// Whether the rules need the event of a frame; see [`crate::session::Observer::needs_event`].
    #[inline]
    pub fn needs_event(&self, preview: &MessagePreview, bus: &Bus) -> bool {
        !self.held.is_empty()
            || !self.ledger.news.is_empty()
            || self.buses.get(usize::from(bus.index().0)).is_none_or(|judge| judge.needs_event(preview))
    }

    /// Counts a frame whose event the rules do not need; see [`crate::session::Observer::skip_event`]. If only few rules need its
    /// event, the frame is counted for all others, and the next event is for those few.
    #[inline]
    pub fn skip_event(&mut self, preview: &MessagePreview, bus: &Bus) -> bool {
        let index = usize::from(bus.index().0);
        let Some(judge) = self.buses.get_mut(index) else { return false };
        if preview.now <= judge.quiet_until {
            return judge.skip_event(preview);
        }
        self.is_quiet(index, preview)
            && self.buses.get_mut(index).is_some_and(|judge| judge.skip_event(preview))
    }

    /// Whether events were for few rules only lately; see [`crate::session::Observer::is_selective`].
    pub fn is_selective(&self, preview: &MessagePreview, bus: &Bus) -> bool {
        let judge = self.buses.get(usize::from(bus.index().0));
        let last = judge.and_then(|judge| judge.last_counted);
        last.is_some_and(|last| preview.frame.saturating_sub(last) < LATELY)
    }

    /// Runs the few rules that need an event, if its frame was counted for all others; `false` if it was not.
    #[inline]
    pub(super) fn event_for_few(&mut self, event: &Event, bus: &Bus) -> bool {
        let judge = self.buses.get_mut(usize::from(bus.index().0));
        let counted = judge.and_then(|judge| Some((judge.counted.take()?, judge)));
        let Some((counted, judge)) = counted.filter(|(counted, _)| counted.frame == event.frames.last) else {
            return false;
        };
        judge.event_for_few(counted.identifier, event, bus, &mut self.ledger)
    }

    /// Whether the rules of a bus need no event because of the time of a frame, and no finding waits to be emitted. If so,
    /// the time until which this holds is stored.
    #[cold]
    fn is_quiet(&mut self, index: usize, preview: &MessagePreview) -> bool {
        let Some(judge) = self.buses.get_mut(index) else { return false };
        if !self.held.is_empty() || !self.ledger.news.is_empty() {
            return false;
        }
        let has_resolution = self.quality.frames > STAMPS_JUDGED;
        if !has_resolution {
            judge.shared.granularity = self.quality.granularity().unwrap_or(0);
        }
        let is_quiet =
            judge.time_of(preview).is_some_and(|now| !judge.is_due(now) || judge.postpone_wakes(now));
        judge.quiet_until = if is_quiet && has_resolution { judge.next_wake() } else { i64::MIN };
        is_quiet
    }

    /// Evaluates the time of the next frame of each bus again, see [`Self::is_quiet`].
    pub(super) fn end_quiet(&mut self) {
        self.buses.iter_mut().for_each(|judge| judge.quiet_until = i64::MIN);
    }
}

impl BusJudge {
    /// Time of a frame without the silences of the bus, if no second ended before it. The deadlines of rules are in this
    /// time.
    #[inline]
    fn time_of(&self, preview: &MessagePreview) -> Option<i64> {
        preview.now.checked_sub(self.shared.silence).filter(|_| !self.shared.meter.is_over())
    }

    #[inline]
    fn is_due(&self, now: i64) -> bool {
        self.shared.wakes.peek().is_some_and(|Reverse((due, ..))| *due < now)
    }

    /// Time to which a wake-up can be postponed without any other effect.
    fn postponed_wake(&self, (due, place, token): (i64, u16, u64)) -> Option<i64> {
        let RuleInstance { rule, .. } = self.rules.get(usize::from(place))?;
        rule.postponed_wake(token, due.max(self.shared.now), &self.shared.traffic)
    }

    /// Whether a wake-up before `now` has an effect.
    #[cold]
    fn must_wake(&self, now: i64) -> bool {
        let due = self.shared.wakes.iter().filter(|Reverse((due, ..))| *due < now);
        due.map(|Reverse(wake)| *wake).any(|(mut due, place, token)| {
            while due < now {
                let Some(time) = self.postponed_wake((due, place, token)) else { return true };
                due = time;
            }
            false
        })
    }

    /// Postpones wake-ups before `now` that have no effect, until one has; whether none has.
    #[cold]
    fn postpone_wakes(&mut self, now: i64) -> bool {
        while let Some(Reverse(wake)) = self.shared.wakes.peek().copied().filter(|_| self.is_due(now)) {
            let Some(time) = self.postponed_wake(wake) else { return false };
            self.shared.wakes.pop();
            self.shared.wakes.push(Reverse((time, wake.1, wake.2)));
        }
        true
    }

    /// Whether the rules need the event of a frame.
    #[inline]
    fn needs_event(&self, preview: &MessagePreview) -> bool {
        let slots = self.shared.traffic.slots();
        let must_wake = |now| self.is_due(now) && self.must_wake(now);
        self.time_of(preview).is_none_or(|now| must_wake(now) || self.needs.has_need(preview, now, slots))
    }

    /// Monotonic time of the bus up to which no wake-up is due.
    fn next_wake(&self) -> i64 {
        let next = self.shared.wakes.peek();
        next.map_or(i64::MAX, |Reverse((due, ..))| due.saturating_add(self.shared.silence))
    }

    /// Counts a frame before the next wake-up; `false` if rules need its event.
    #[inline]
    fn skip_event(&mut self, preview: &MessagePreview) -> bool {
        let now = preview.now.saturating_sub(self.shared.silence);
        let recipients = self.needs.skip_frame(preview, now, &mut self.shared.traffic);
        if recipients == FrameRecipients::All {
            return false;
        }
        self.shared.now = self.shared.now.max(now);
        if recipients == FrameRecipients::Few {
            self.last_counted = Some(preview.frame);
            self.counted = Some(CountedFrame { frame: preview.frame, identifier: preview.identifier });
        }
        recipients == FrameRecipients::None
    }

    /// Runs the few rules that need each event of an identifier.
    fn event_for_few(
        &mut self,
        identifier: usize,
        event: &Event,
        bus: &Bus,
        ledger: &mut FindingLedger,
    ) -> bool {
        let Some((few, place)) = self.needs.few_recipients(identifier) else { return false };
        self.shared.traffic.select_current(place);
        let mut context = self.shared.rule_context(bus, ledger);
        for place in few.rule_places(!event.routine) {
            if let Some(RuleInstance { number, rule, .. }) = self.rules.get_mut(usize::from(place)) {
                (context.rule, context.place) = (*number, place);
                rule.on_event(event, &mut context);
            }
        }
        if std::mem::take(&mut self.shared.has_news) {
            self.needs.forget_identifier(identifier);
        }
        // A rule may have requested an earlier wake-up.
        self.quiet_until = self.quiet_until.min(self.next_wake());
        true
    }

    /// Passes the number of skipped frames of an identifier to the rules for which they count.
    #[cold]
    pub(super) fn pass_on_skipped(&mut self, identifier: usize, bus: &Bus, ledger: &mut FindingLedger) {
        let Some(known) = self.needs.counted_entry(identifier) else { return };
        let (skipped, known) = (known.take_skipped(), *known);
        for rule in known.passed_rules() {
            ledger.pass_many(*rule, skipped.count);
        }
        for rule in known.passed_if_changed() {
            ledger.pass_many(*rule, skipped.changed);
        }
        let mut context = self.shared.rule_context(bus, ledger);
        let slot = known.statistics_index().and_then(|place| context.traffic.slots().get(place));
        let Some(slot) = slot else { return };
        for place in known.counting_rules() {
            if let Some(RuleInstance { number, rule, .. }) = self.rules.get_mut(usize::from(*place)) {
                (context.rule, context.place) = (*number, *place);
                rule.on_skipped(slot, skipped.count, &mut context);
            }
        }
    }

    /// Passes on all skipped frames up to now.
    pub(super) fn pass_on_all_skipped(&mut self, bus: &Bus, ledger: &mut FindingLedger) {
        for identifier in 0..self.needs.len() {
            self.pass_on_skipped(identifier, bus, ledger);
        }
    }

    /// Asks the rules what they need of the frames that follow the PDO or message `event`.
    #[cold]
    pub(super) fn ask_for_needs(
        &mut self,
        identifier: usize,
        event: &Event,
        bus: &Bus,
        ledger: &mut FindingLedger,
    ) {
        if event.presumed {
            return;
        }
        let statistics = match &event.kind {
            EventKind::Pdo(_) => match self.shared.traffic.current_place() {
                Some(place) => Some(place),
                None => return,
            },
            _ => None,
        };
        let context = self.shared.rule_context(bus, ledger);
        let rules = &self.rules;
        let answers = self.interests.of_next(event).filter_map(|(place, is_for_changes)| {
            let RuleInstance { number, rule, .. } = rules.get(usize::from(place))?;
            Some(NeedAnswer {
                number: *number,
                place,
                need: rule.frame_need(event, &context),
                is_for_changes,
            })
        });
        let length = match &event.kind {
            EventKind::Pdo(pdo) => usize::from(pdo.length),
            EventKind::J1939Message(message) => message.payload().len(),
            _ => return,
        };
        self.needs.store_needs(
            identifier,
            (bus.identifiers().version_of(identifier), length),
            statistics,
            answers,
        );
    }
}
