//! PDOs that repeat the payload of the PDO before them: what the rules need of them, by identifier.

use crate::rules::context::traffic::PdoSlot;
use crate::rules::rule::Repetitions;

/// Maximum number of rules that count the PDOs of one identifier; with more, each event is needed.
const COUNTING: usize = 4;

/// What all rules together need of the repetitions of one identifier.
#[derive(Debug, Clone, Copy)]
pub(super) struct RepetitionsOf {
    /// Number of the answer; an older one is not valid.
    answer: u32,
    /// Index of the identifier's statistics.
    statistics: usize,
    /// Intervals in ns at which no rule needs the event; empty if a rule needs each one.
    shortest: i64,
    longest: i64,
    /// Rules that count each repetition as passed.
    passing: [u16; COUNTING],
    passing_count: u8,
    /// Rules, by place, that take the number of repetitions.
    counting: [u16; COUNTING],
    counting_count: u8,
    /// Repetitions since the last event.
    count: u32,
}

impl RepetitionsOf {
    /// Every event is needed.
    const EACH: Self = Self {
        answer: 0,
        statistics: 0,
        shortest: i64::MAX,
        longest: i64::MIN,
        passing: [0; COUNTING],
        passing_count: 0,
        counting: [0; COUNTING],
        counting_count: 0,
        count: 0,
    };

    /// Adds the answer of a rule with its number and its place.
    fn add(&mut self, (number, place): (u16, u16), repetitions: Repetitions) {
        let is_added = match repetitions {
            Repetitions::Ignored => true,
            Repetitions::Needed => false,
            Repetitions::Passed { shortest, longest } => {
                self.shortest = self.shortest.max(shortest);
                self.longest = self.longest.min(longest);
                push(&mut self.passing, &mut self.passing_count, number)
            }
            Repetitions::Counted => push(&mut self.counting, &mut self.counting_count, place),
        };
        if !is_added {
            (self.shortest, self.longest) = (i64::MAX, i64::MIN);
        }
    }

    /// Numbers of the rules that count each repetition as passed.
    #[inline]
    fn passing(&self) -> &[u16] {
        self.passing.get(..usize::from(self.passing_count)).unwrap_or(&[])
    }

    /// Places of the rules that take the number of repetitions.
    pub(super) fn counting(&self) -> &[u16] {
        self.counting.get(..usize::from(self.counting_count)).unwrap_or(&[])
    }

    /// Index of the identifier's statistics.
    pub(super) fn statistics(&self) -> usize {
        self.statistics
    }

    /// Repetitions since the last call.
    pub(super) fn take_count(&mut self) -> u32 {
        std::mem::take(&mut self.count)
    }
}

fn push(list: &mut [u16; COUNTING], count: &mut u8, item: u16) -> bool {
    let Some(free) = list.get_mut(usize::from(*count)) else { return false };
    *free = item;
    *count += 1;
    true
}

/// Answers of the rules by index of the identifier on the bus.
#[derive(Debug, Default)]
pub(super) struct RepetitionTable {
    answers: Vec<RepetitionsOf>,
    /// Number of the valid answers.
    valid: u32,
}

impl RepetitionTable {
    /// Before the first PDO.
    pub(super) fn new() -> Self {
        Self { answers: Vec::new(), valid: 1 }
    }

    /// Whether rules need the event of a repetition after `interval` ns, a time of the rules.
    #[inline]
    pub(super) fn needs(&self, identifier: usize, now: i64, pdos: &[PdoSlot]) -> bool {
        let Some(known) = self.answers.get(identifier).filter(|known| known.answer == self.valid) else {
            return true;
        };
        let Some(pdo) = pdos.get(known.statistics) else { return true };
        let interval = now.saturating_sub(pdo.last);
        interval < known.shortest || interval > known.longest
    }

    /// Counts a repetition; its statistics and the rules that count it as passed.
    #[inline]
    pub(super) fn skip(&mut self, identifier: usize) -> Option<(usize, &[u16])> {
        let known = self.answers.get_mut(identifier)?;
        known.count = known.count.saturating_add(1);
        Some((known.statistics, known.passing()))
    }

    /// Whether the rules must be asked about an identifier.
    #[inline]
    pub(super) fn is_unknown(&self, identifier: usize) -> bool {
        self.answers.get(identifier).is_none_or(|known| known.answer != self.valid)
    }

    /// Drops the answers about one identifier.
    pub(super) fn forget(&mut self, identifier: usize) {
        if let Some(known) = self.answers.get_mut(identifier) {
            known.answer = 0;
        }
    }

    /// Drops all answers.
    pub(super) fn forget_all(&mut self) {
        self.valid = self.valid.wrapping_add(1).max(1);
    }

    /// Stores the answers of the rules, each with its number and place, about an identifier.
    pub(super) fn store(
        &mut self,
        (identifier, statistics): (usize, usize),
        answers: impl Iterator<Item = ((u16, u16), Repetitions)>,
    ) {
        let open = RepetitionsOf { shortest: i64::MIN, longest: i64::MAX, ..RepetitionsOf::EACH };
        let mut known = RepetitionsOf { answer: self.valid, statistics, ..open };
        for (rule, repetitions) in answers {
            known.add(rule, repetitions);
            if known.shortest > known.longest {
                break;
            }
        }
        if self.answers.len() <= identifier {
            self.answers.resize(identifier + 1, RepetitionsOf::EACH);
        }
        if let Some(place) = self.answers.get_mut(identifier) {
            known.count = place.count;
            *place = known;
        }
    }

    /// Answer about an identifier with repetitions since its last event.
    #[inline]
    pub(super) fn counted(&mut self, identifier: usize) -> Option<&mut RepetitionsOf> {
        self.answers.get_mut(identifier).filter(|known| known.count > 0)
    }

    /// Number of identifiers.
    pub(super) fn len(&self) -> usize {
        self.answers.len()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::frame::CanId;

    fn table(answers: &[Repetitions]) -> RepetitionTable {
        let mut table = RepetitionTable::new();
        let numbered = (10..).zip(0..).zip(answers.iter().copied());
        table.store((2, 0), numbered);
        table
    }

    fn pdos() -> Vec<PdoSlot> {
        let mut pdo = PdoSlot::new(0, CanId::standard(0x181));
        pdo.take(1_000, 1, (0, 0), false);
        vec![pdo]
    }

    #[test]
    fn intervals_that_all_rules_permit() {
        let passed = |shortest, longest| Repetitions::Passed { shortest, longest };
        let table = table(&[passed(5, 20), Repetitions::Ignored, passed(8, 30), Repetitions::Counted]);
        let needed = [7, 8, 20, 21].map(|interval| table.needs(2, 1_000 + interval, &pdos()));
        assert_eq!(needed, [true, false, false, true]);
        assert!(table.needs(1, 1_010, &pdos()), "not asked yet");
    }

    #[test]
    fn one_rule_that_needs_each_decides() {
        let table = table(&[Repetitions::PASSED, Repetitions::Needed, Repetitions::PASSED]);
        assert!(table.needs(2, 1_010, &pdos()) && !table.is_unknown(2));
    }

    #[test]
    fn repetitions_are_counted_until_the_next_event() {
        let mut table = table(&[Repetitions::PASSED, Repetitions::Counted]);
        assert_eq!(table.skip(2), Some((0, &[10][..])));
        assert_eq!(table.skip(2), Some((0, &[10][..])));
        let counted = table.counted(2).unwrap();
        assert_eq!((counted.take_count(), counted.counting()), (2, &[1][..]));
        assert!(table.counted(2).is_none());
        table.forget(2);
        assert!(table.is_unknown(2) && table.needs(2, 1_010, &pdos()));
    }

    #[test]
    fn more_rules_than_can_be_counted_need_each() {
        assert!(!table(&[Repetitions::PASSED; COUNTING]).needs(2, 1_010, &pdos()));
        assert!(table(&[Repetitions::PASSED; COUNTING + 1]).needs(2, 1_010, &pdos()));
    }
}
