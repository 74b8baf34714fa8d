//! What the rules together need of the next PDOs or messages of each identifier.

use crate::rules::context::pdo_slot::PdoSlot;
use crate::rules::context::traffic::PdoTraffic;
use crate::rules::need::FrameNeed;
use crate::session::MessagePreview;

/// Maximum number of rules in one of the lists of an identifier; with more, each event is needed.
const LISTED: usize = 6;

/// A few rules, by number or by place.
#[derive(Debug, Clone, Copy, Default)]
struct RuleList {
    rules: [u16; LISTED],
    count: u8,
}

impl RuleList {
    /// Adds a rule; whether there was room.
    fn add_rule(&mut self, rule: u16) -> bool {
        let Some(free) = self.rules.get_mut(usize::from(self.count)) else { return false };
        *free = rule;
        self.count += 1;
        true
    }

    #[inline]
    fn all_rules(&self) -> &[u16] {
        self.rules.get(..usize::from(self.count)).unwrap_or(&[])
    }
}

/// What all rules together need of one identifier.
#[derive(Debug, Clone, Copy)]
pub(super) struct NeedsOf {
    /// Number of the answers; older ones are not valid.
    answer: u32,
    /// Service and layout of the identifier, and data length in bytes, for which the answers hold.
    version: u32,
    length: usize,
    /// Index of the PDO statistics; `None` for a J1939 message.
    statistics: Option<u16>,
    /// All answers as one.
    need: FrameNeed,
    /// Numbers of the rules for which each frame is passed, and of those for which each frame with changed payload is.
    passed: RuleList,
    passed_if_changed: RuleList,
    /// Places of the rules that take the number of frames.
    counting: RuleList,
    /// Places of the rules that need each event; the other fields are about the other rules.
    each: RuleList,
    /// Bit n is set if the n-th of them receives only frames with changed payload.
    if_changed: u8,
    /// Frames since the last event.
    skipped: SkippedFrames,
}

/// Frames of an identifier without an event.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub(super) struct SkippedFrames {
    /// Number of all.
    pub(super) count: u32,
    /// Number of those with changed payload.
    pub(super) changed: u32,
}

impl NeedsOf {
    fn new(answer: u32, (version, length): (u32, usize), statistics: Option<u16>) -> Self {
        let (passed, passed_if_changed, counting, each) = Default::default();
        Self {
            answer,
            version,
            length,
            statistics,
            need: FrameNeed::NOTHING,
            passed,
            passed_if_changed,
            counting,
            each,
            if_changed: 0,
            skipped: SkippedFrames::default(),
        }
    }

    /// Adds the answer of a rule that receives all frames of the identifier.
    fn add_answer(&mut self, rule: &NeedAnswer) {
        let (all, need) = (&mut self.need, rule.need);
        // Messages have no intervals, and their events no short path of their own.
        if need.is_each() && self.statistics.is_some() && self.each.add_rule(rule.place) {
            all.follows_interval |= need.follows_interval;
            return;
        }
        all.bits |= need.bits;
        all.codes = all.codes.union_with(need.codes);
        all.shortest = all.shortest.max(need.shortest);
        all.longest = all.longest.min(need.longest);
        all.alternations = all.alternations.min(need.alternations);
        all.frames = all.frames.min(need.frames);
        all.follows_interval |= need.follows_interval;
        let is_listed = (!need.is_passed || self.passed.add_rule(rule.number))
            && (!need.is_passed_if_changed || self.passed_if_changed.add_rule(rule.number))
            && (!need.is_counted || self.counting.add_rule(rule.place));
        if !is_listed {
            *all = FrameNeed::EACH;
        }
    }

    /// Adds the answer of a rule that receives only frames with changed payload.
    fn add_if_changed(&mut self, rule: &NeedAnswer) {
        let need = rule.need;
        let place = self.each.count;
        if need.is_each() && self.statistics.is_some() && self.each.add_rule(rule.place) {
            self.if_changed |= 1 << place;
            self.need.follows_interval |= need.follows_interval;
            return;
        }
        let is_bounded = need.shortest > i64::MIN || need.longest < i64::MAX || need.is_counted;
        let is_listed = !need.is_passed || self.passed_if_changed.add_rule(rule.number);
        self.need.follows_interval |= need.follows_interval;
        self.need.bits |= if is_bounded || !is_listed { u64::MAX } else { need.bits };
    }

    /// Whether rules need the event of the next PDO after `interval` ns, whatever its contents are.
    #[inline]
    fn needs_pdo(&self, pdo: &PdoSlot, interval: i64) -> bool {
        interval < self.need.shortest
            || interval > self.need.longest
            || pdo.alternations.saturating_add(1) >= self.need.alternations
            || self.need.frames <= 1
    }

    /// Whether some rules need each event of a frame, with changed payload or not.
    #[inline]
    const fn has_few(&self, is_changed: bool) -> bool {
        let all = (1_u8 << self.each.count) - 1;
        self.each.count > 0 && (is_changed || all & !self.if_changed != 0)
    }

    /// Whether rules need the event of the next message.
    #[inline]
    fn needs_message(&self, preview: &MessagePreview) -> bool {
        self.need.is_each() || preview.change != 0 && self.need.codes.are_in(preview.payload)
    }

    /// Places of the rules that take the number of frames.
    pub(super) fn counting_rules(&self) -> &[u16] {
        self.counting.all_rules()
    }

    /// Index of the PDO statistics.
    pub(super) fn statistics_index(&self) -> Option<usize> {
        self.statistics.map(usize::from)
    }

    /// Numbers of the rules for which each frame without an event is a check without a defect.
    pub(super) fn passed_rules(&self) -> &[u16] {
        self.passed.all_rules()
    }

    /// The same, for frames with changed payload.
    pub(super) fn passed_if_changed(&self) -> &[u16] {
        self.passed_if_changed.all_rules()
    }

    /// Frames without an event since the last call.
    pub(super) fn take_skipped(&mut self) -> SkippedFrames {
        std::mem::take(&mut self.skipped)
    }
}

/// Rules that need the event of a frame.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum FrameRecipients {
    /// No rule.
    None,
    /// Only rules that need each event of the identifier; for the others, the frame is counted.
    Few,
    /// Perhaps all rules.
    All,
}

/// Rules that need each event of an identifier.
#[derive(Debug, Clone, Copy)]
pub(super) struct FewRecipients {
    rules: RuleList,
    if_changed: u8,
}

impl FewRecipients {
    /// Places of the rules that receive a frame with changed or unchanged payload.
    #[inline]
    pub(super) fn rule_places(&self, is_changed: bool) -> impl Iterator<Item = u16> {
        let is_meant = move |number: &usize| is_changed || self.if_changed >> *number & 1 == 0;
        self.rules
            .all_rules()
            .iter()
            .enumerate()
            .filter(move |(number, _)| is_meant(number))
            .map(|(_, place)| *place)
    }
}

/// Answer of a rule.
pub(super) struct NeedAnswer {
    pub(super) number: u16,
    pub(super) place: u16,
    pub(super) need: FrameNeed,
    /// The rule receives only frames with changed payload.
    pub(super) is_for_changes: bool,
}

/// Needs by index of the identifier on the bus.
#[derive(Debug)]
pub(super) struct NeedsTable {
    identifiers: Vec<NeedsOf>,
    /// Number of the valid answers.
    valid: u32,
}

impl NeedsTable {
    /// Before the first frame.
    pub(super) fn new() -> Self {
        Self { identifiers: Vec::new(), valid: 1 }
    }

    /// Whether rules need the event of a frame at the time `now` of the rules.
    #[inline]
    pub(super) fn has_need(&self, preview: &MessagePreview, now: i64, pdos: &[PdoSlot]) -> bool {
        let Some(known) = self.identifiers.get(preview.identifier) else { return true };
        let is_changed = preview.change != 0;
        if known.answer != self.valid || known.has_few(is_changed) || preview.change & known.need.bits != 0 {
            return true;
        }
        match known.statistics {
            Some(place) => {
                pdos.get(usize::from(place)).is_none_or(|pdo| known.needs_pdo(pdo, pdo.interval_at(now)))
            }
            None => known.needs_message(preview),
        }
    }

    /// Counts a frame at the time `now` of the rules, unless its event is for [`FrameRecipients::All`].
    #[inline]
    pub(super) fn skip_frame(
        &mut self,
        preview: &MessagePreview,
        now: i64,
        traffic: &mut PdoTraffic,
    ) -> FrameRecipients {
        let Some(known) = self.identifiers.get_mut(preview.identifier) else { return FrameRecipients::All };
        if known.answer != self.valid || preview.change & known.need.bits != 0 {
            return FrameRecipients::All;
        }
        match known.statistics {
            Some(place) => {
                let Some((pdo, context)) = traffic.slot_mut(usize::from(place)) else {
                    return FrameRecipients::All;
                };
                let interval = pdo.interval_at(now);
                if known.needs_pdo(pdo, interval) {
                    return FrameRecipients::All;
                }
                if pdo.skip_pdo(preview, (now, interval), context) && known.need.follows_interval {
                    known.answer = 0;
                }
            }
            None if known.needs_message(preview) => return FrameRecipients::All,
            None => {}
        }
        known.skipped.count = known.skipped.count.saturating_add(1);
        known.skipped.changed = known.skipped.changed.saturating_add(u32::from(preview.change != 0));
        known.need.frames = known.need.frames.saturating_sub(1);
        if known.has_few(preview.change != 0) { FrameRecipients::Few } else { FrameRecipients::None }
    }

    /// Rules that need each event of an identifier, and the index of its PDO statistics.
    #[inline]
    pub(super) fn few_recipients(&self, identifier: usize) -> Option<(FewRecipients, usize)> {
        let known = self.identifiers.get(identifier)?;
        Some((FewRecipients { rules: known.each, if_changed: known.if_changed }, known.statistics_index()?))
    }

    /// Counts a PDO with an event.
    #[inline]
    pub(super) fn count_event(&mut self, identifier: usize) {
        if let Some(known) = self.identifiers.get_mut(identifier) {
            known.need.frames = known.need.frames.saturating_sub(1);
        }
    }

    /// Whether the rules must be asked about an identifier.
    #[inline]
    pub(super) fn is_unknown(&self, identifier: usize, version: u32, length: usize) -> bool {
        let known = self.identifiers.get(identifier);
        known.is_none_or(|known| {
            known.answer != self.valid || known.version != version || known.length != length
        })
    }

    /// Drops the answers about one identifier.
    pub(super) fn forget_identifier(&mut self, identifier: usize) {
        if let Some(known) = self.identifiers.get_mut(identifier) {
            known.answer = 0;
        }
    }

    /// Drops all answers.
    pub(super) fn forget_all(&mut self) {
        self.valid = self.valid.wrapping_add(1).max(1);
    }

    /// Stores the answers of the rules about an identifier.
    pub(super) fn store_needs(
        &mut self,
        identifier: usize,
        (version, length): (u32, usize),
        statistics: Option<usize>,
        answers: impl Iterator<Item = NeedAnswer>,
    ) {
        let (number, is_known) = match statistics.map(u16::try_from) {
            Some(number) => (number.ok(), number.is_ok()),
            None => (None, true),
        };
        let mut known = NeedsOf::new(self.valid, (version, length), number);
        for answer in answers {
            if answer.is_for_changes { known.add_if_changed(&answer) } else { known.add_answer(&answer) }
        }
        // Intervals and the numbers of frames are known of PDOs only.
        let is_beyond_messages = statistics.is_none()
            && (known.need
                != FrameNeed { bits: known.need.bits, codes: known.need.codes, ..FrameNeed::NOTHING }
                || known.counting.count > 0);
        if !is_known || is_beyond_messages {
            known.need = FrameNeed::EACH;
        }
        if self.identifiers.len() <= identifier {
            let Some(count) = identifier.checked_add(1) else { return };
            self.identifiers.resize(count, NeedsOf::new(0, (0, 0), None));
        }
        if let Some(place) = self.identifiers.get_mut(identifier) {
            known.skipped = place.skipped;
            *place = known;
        }
    }

    /// Entry of an identifier with frames since its last event.
    #[inline]
    pub(super) fn counted_entry(&mut self, identifier: usize) -> Option<&mut NeedsOf> {
        self.identifiers.get_mut(identifier).filter(|known| known.skipped.count > 0)
    }

    /// Number of identifiers.
    pub(super) fn len(&self) -> usize {
        self.identifiers.len()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::frame::{CanId, Timestamp};

    fn table(answers: &[(FrameNeed, bool)]) -> NeedsTable {
        let mut table = NeedsTable::new();
        let answers = answers.iter().zip(0..).map(|((need, is_for_changes), place)| NeedAnswer {
            number: place + 10,
            place,
            need: *need,
            is_for_changes: *is_for_changes,
        });
        table.store_needs(2, (0, 8), Some(0), answers);
        table
    }

    const fn preview(change: u64) -> MessagePreview {
        MessagePreview { identifier: 2, frame: 9, time: Timestamp(0), now: 0, payload: change, change }
    }

    /// Whether an event is needed after `interval`, if the bits of `change` change.
    fn is_needed(table: &NeedsTable, interval: i64, change: u64) -> bool {
        table.has_need(&preview(change), interval, &[PdoSlot::new(0, CanId::from_standard(0x181))])
    }

    /// Whether a frame in which the bits of `change` change is skipped, 10 after the last one.
    fn skip(table: &mut NeedsTable, change: u64) -> bool {
        let mut traffic = PdoTraffic::new(0);
        traffic.add_entry(2, CanId::from_standard(0x181)).unwrap();
        let is_needed = table.has_need(&preview(change), 10, traffic.slots());
        let is_skipped = table.skip_frame(&preview(change), 10, &mut traffic) == FrameRecipients::None;
        assert_eq!(is_skipped, !is_needed);
        assert_eq!(traffic.slot_of(2).unwrap().count, u64::from(is_skipped));
        is_skipped
    }

    const fn within(shortest: i64, longest: i64) -> FrameNeed {
        FrameNeed { shortest, longest, ..FrameNeed::PASSED }
    }

    #[test]
    fn intervals_that_all_rules_permit() {
        let table = table(&[(within(5, 20), false), (FrameNeed::NOTHING, false), (within(8, 30), false)]);
        let needed = [7, 8, 20, 21].map(|interval| is_needed(&table, interval, 0));
        assert_eq!(needed, [true, false, false, true]);
    }

    #[test]
    fn one_rule_that_needs_each_decides() {
        let needs =
            table(&[(FrameNeed::PASSED, false), (FrameNeed::EACH, false), (FrameNeed::PASSED, false)]);
        assert!(is_needed(&needs, 10, 0) && !needs.is_unknown(2, 0, 8));
        let of_changes = table(&[(FrameNeed::PASSED, false), (FrameNeed::EACH, true)]);
        assert!(!is_needed(&of_changes, 10, 0) && is_needed(&of_changes, 10, 1));
    }

    #[test]
    fn events_for_few_are_counted_for_the_others() {
        let needs = [
            (FrameNeed::EACH, false),
            (FrameNeed::PASSED, false),
            (FrameNeed::EACH, true),
            (within(5, 20), false),
        ];
        let mut table = table(&needs);
        let mut traffic = PdoTraffic::new(0);
        traffic.add_entry(2, CanId::from_standard(0x181)).unwrap();
        let mut skip = |change, now| table.skip_frame(&preview(change), now, &mut traffic);
        // The last interval is too long for one of the others.
        let found = [(0, 10), (1, 20), (0, 41)].map(|(change, now)| skip(change, now));
        assert_eq!(found, [FrameRecipients::Few, FrameRecipients::Few, FrameRecipients::All]);
        let (few, _) = table.few_recipients(2).unwrap();
        let places = |is_changed| few.rule_places(is_changed).collect::<Vec<_>>();
        assert_eq!((places(false), places(true)), (vec![0], vec![0, 2]));
        let counted = table.counted_entry(2).unwrap();
        assert_eq!(counted.passed_rules(), &[11, 13][..]);
        assert_eq!(counted.take_skipped(), SkippedFrames { count: 2, changed: 1 });
        let of_changes = self::table(&[(FrameNeed::EACH, true)]);
        assert!(!is_needed(&of_changes, 10, 0) && is_needed(&of_changes, 10, 1));
    }

    #[test]
    fn bits_and_two_producers_in_turn() {
        let needs = table(&[(FrameNeed { bits: 6, ..FrameNeed::NOTHING }, false)]);
        assert_eq!([1, 2, 4, 8].map(|bits| is_needed(&needs, 10, bits)), [false, true, true, false]);
        assert!(is_needed(&table(&[(FrameNeed { alternations: 1, ..FrameNeed::NOTHING }, false)]), 10, 0));
        assert!(!is_needed(&table(&[(FrameNeed { alternations: 2, ..FrameNeed::NOTHING }, false)]), 10, 0));
    }

    #[test]
    fn the_third_pdo_is_needed() {
        let mut table = table(&[(FrameNeed { frames: 3, ..FrameNeed::NOTHING }, false)]);
        assert!(skip(&mut table, 0));
        assert!(!is_needed(&table, 10, 0));
        table.count_event(2);
        assert!(!skip(&mut table, 0));
    }

    #[test]
    fn frames_are_counted_until_the_next_event() {
        let needs =
            [(FrameNeed::PASSED, false), (FrameNeed::NOTHING.with_count(), false), (FrameNeed::PASSED, true)];
        let mut table = table(&needs);
        assert_eq!([0, 5].map(|change| skip(&mut table, change)), [true; 2]);
        let counted = table.counted_entry(2).unwrap();
        assert_eq!((counted.passed_rules(), counted.passed_if_changed()), (&[10][..], &[12][..]));
        assert_eq!(counted.counting_rules(), &[1][..]);
        assert_eq!(counted.take_skipped(), SkippedFrames { count: 2, changed: 1 });
        assert!(table.counted_entry(2).is_none());
    }

    #[test]
    fn answers_are_dropped() {
        let mut table = table(&[(FrameNeed::PASSED, false)]);
        assert!(table.is_unknown(2, 1, 8), "another layout");
        assert!(table.is_unknown(2, 0, 7), "another length");
        table.forget_identifier(2);
        assert!(table.is_unknown(2, 0, 8) && is_needed(&table, 10, 0));
        table.store_needs(2, (0, 8), Some(0), std::iter::empty());
        table.forget_all();
        assert!(table.is_unknown(2, 0, 8) && is_needed(&table, 10, 0));
    }

    #[test]
    fn an_answer_that_follows_the_interval_holds_until_the_next_median() {
        let skipped = |need: FrameNeed| {
            let mut table = table(&[(need, false)]);
            let mut traffic = PdoTraffic::new(0);
            traffic.add_entry(2, CanId::from_standard(0x181)).unwrap();
            (0..20)
                .filter(|number| {
                    table.skip_frame(&preview(0), number * 10, &mut traffic) == FrameRecipients::None
                })
                .count()
        };
        // The sixteenth PDO is the last one of fifteen intervals.
        assert_eq!(skipped(FrameNeed { follows_interval: true, ..FrameNeed::PASSED }), 16);
        assert_eq!(skipped(FrameNeed::PASSED), 20);
    }

    #[test]
    fn messages_have_no_intervals() {
        let needed = [
            FrameNeed::PASSED,
            within(5, 20),
            FrameNeed::NOTHING.with_count(),
            FrameNeed { bits: 4, ..FrameNeed::NOTHING },
        ]
        .map(|need| {
            let mut table = NeedsTable::new();
            let answer = NeedAnswer { number: 10, place: 0, need, is_for_changes: false };
            table.store_needs(2, (0, 8), None, std::iter::once(answer));
            is_needed(&table, 10, 0)
        });
        assert_eq!(needed, [false, true, true, false]);
    }

    #[test]
    fn more_rules_than_can_be_listed_need_each() {
        assert!(!is_needed(&table(&[(FrameNeed::PASSED, false); LISTED]), 10, 0));
        assert!(is_needed(&table(&[(FrameNeed::PASSED, false); LISTED + 1]), 10, 0));
        assert!(is_needed(&table(&[(FrameNeed::PASSED, true); LISTED + 1]), 10, 1));
    }
}
