//! Reaction time of the controller: from a changed TPDO of a node to the next changed RPDO to it.

use super::DurationDistribution;
use crate::event::{DecodedPdo, Event, EventKind};
use crate::profile::{PdoDirection, PdoName};

/// Maximum number of pairs per node.
const MOST_PAIRS: usize = 64;

/// Maximum number of RPDOs per node: the bits of [`OpenChange::answered`].
const MOST_RPDOS: usize = 64;

/// Every RPDO has reacted: the next change is a new one.
const ALL: u64 = u64::MAX;

/// Reactions of the controller to one TPDO by one RPDO.
#[derive(Debug, Clone)]
pub struct ReactionTime {
    /// PDO of the node.
    pub tpdo: PdoName,
    /// PDO to the node.
    pub rpdo: PdoName,
    /// Times from TPDO to RPDO.
    pub times: DurationDistribution,
    /// Time and frame of the RPDO with the longest reaction.
    pub longest_at: (i64, u64),
}

/// Reaction times of one node by pair of PDOs.
#[derive(Debug, Clone, Default)]
pub struct ReactionTimes {
    pairs: Vec<ReactionTime>,
    /// RPDOs in order of appearance, at most [`MOST_RPDOS`].
    rpdos: Vec<PdoName>,
    open: Vec<OpenChange>,
}

/// Changed contents of a TPDO.
#[derive(Debug, Clone)]
struct OpenChange {
    tpdo: PdoName,
    /// Time of the change, in ns.
    began: i64,
    /// Bit n is set if RPDO n has reacted.
    answered: u64,
    /// Index + 1 in `pairs` by RPDO, 0 for none.
    pairs: [u8; MOST_RPDOS],
}

impl ReactionTimes {
    /// Pairs of PDOs, in order of appearance.
    pub fn pairs(&self) -> &[ReactionTime] {
        &self.pairs
    }

    /// Handles an event of the node.
    pub(crate) fn take_event(&mut self, event: &Event) {
        match &event.kind {
            EventKind::Pdo(pdo) => self.add_pdo(event, pdo),
            // A restart or a silence is not a reaction time.
            EventKind::BootUp { .. } | EventKind::NodeLost(_) => {
                self.open.iter_mut().for_each(|open| open.answered = ALL);
            }
            _ => {}
        }
    }

    /// Adds a PDO with changed contents.
    fn add_pdo(&mut self, event: &Event, pdo: &DecodedPdo) {
        let Some(time) = event.time.map(|time| time.0).filter(|_| !pdo.is_request && !event.routine) else {
            return;
        };
        self.change_pdo(pdo.name, time, event.frames.last);
    }

    /// Adds a PDO with changed contents at a time in ns.
    pub(crate) fn change_pdo(&mut self, name: PdoName, time: i64, frame: u64) {
        if name.direction == PdoDirection::Transmit {
            self.change_tpdo(name, time);
        } else {
            self.change_rpdo(name, time, frame);
        }
    }

    /// Adds a TPDO with changed contents at a time in ns.
    pub(crate) fn change_tpdo(&mut self, tpdo: PdoName, time: i64) {
        match self.number_of_change(tpdo) {
            Some(number) => self.changed_again(number, time),
            None if self.open.len() < MOST_PAIRS => {
                self.open.push(OpenChange { tpdo, began: time, answered: 0, pairs: [0; MOST_RPDOS] });
            }
            None => {}
        }
    }

    /// Number of a TPDO, assigned at its first change; it stays the same.
    #[inline]
    pub(crate) fn number_of_change(&self, tpdo: PdoName) -> Option<usize> {
        self.open.iter().position(|open| open.tpdo == tpdo)
    }

    /// Adds the TPDO with this number, with changed contents.
    #[inline]
    pub(crate) fn changed_again(&mut self, number: usize, time: i64) {
        // The controller still works on an earlier value, unless an RPDO reacted to it.
        if let Some(open) = self.open.get_mut(number).filter(|open| open.answered != 0) {
            (open.began, open.answered) = (time, 0);
        }
    }

    /// Adds an RPDO with changed contents at a time in ns.
    pub(crate) fn change_rpdo(&mut self, rpdo: PdoName, time: i64, frame: u64) {
        let Some(number) = self.rpdo_number(rpdo) else { return };
        let bit = 1_u64 << number;
        for open in self.open.iter_mut().filter(|open| open.answered & bit == 0) {
            open.answered |= bit;
            let known = open.pairs.get(number).and_then(|place| usize::from(*place).checked_sub(1));
            let place = known.or_else(|| add_pair(&mut self.pairs, open, (number, rpdo), (time, frame)));
            let Some(pair) = place.and_then(|place| self.pairs.get_mut(place)) else { continue };
            let reaction = time.saturating_sub(open.began);
            if reaction > pair.times.longest() {
                pair.longest_at = (time, frame);
            }
            pair.times.add_duration(reaction);
        }
    }

    /// Number of an RPDO, assigned at its first change.
    fn rpdo_number(&mut self, rpdo: PdoName) -> Option<usize> {
        let known = self.rpdos.iter().position(|known| *known == rpdo);
        known.or_else(|| {
            (self.rpdos.len() < MOST_RPDOS).then(|| {
                self.rpdos.push(rpdo);
                self.rpdos.len() - 1
            })
        })
    }
}

/// Adds the pair of a changed TPDO and an RPDO; `None` if there are too many pairs.
#[cold]
fn add_pair(
    pairs: &mut Vec<ReactionTime>,
    open: &mut OpenChange,
    (number, rpdo): (usize, PdoName),
    longest_at: (i64, u64),
) -> Option<usize> {
    let place = u8::try_from(pairs.len() + 1).ok().filter(|_| pairs.len() < MOST_PAIRS)?;
    pairs.push(ReactionTime { tpdo: open.tpdo, rpdo, times: DurationDistribution::default(), longest_at });
    *open.pairs.get_mut(number)? = place;
    Some(pairs.len() - 1)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::event::BootCause;
    use crate::frame::{CanId, Frame};

    const fn change_pdo(direction: PdoDirection, number: u16) -> PdoName {
        PdoName { direction, number }
    }

    #[test]
    fn a_reaction_is_measured_from_the_first_change_that_is_still_open() {
        let (tpdo, rpdo) = (change_pdo(PdoDirection::Transmit, 1), change_pdo(PdoDirection::Receive, 1));
        let mut reactions = ReactionTimes::default();
        // Set points before any actual value are not reactions.
        reactions.change_rpdo(rpdo, 5, 1);
        // Changed at 10 and 20, set point at 35: 25. Changed at 40, set point at 47: 7, and a second one at 60 is
        // not a reaction.
        reactions.change_tpdo(tpdo, 10);
        reactions.change_tpdo(tpdo, 20);
        reactions.change_rpdo(rpdo, 35, 2);
        reactions.change_tpdo(tpdo, 40);
        reactions.change_rpdo(rpdo, 47, 3);
        reactions.change_rpdo(rpdo, 60, 4);
        assert_eq!(reactions.pairs().len(), 1);
        let pair = reactions.pairs().first().unwrap();
        assert_eq!((pair.tpdo, pair.rpdo, pair.times.duration_count()), (tpdo, rpdo, 2));
        assert_eq!((pair.times.percentile(50), pair.times.longest()), (Some(7), 25));
        assert_eq!(pair.longest_at, (35, 2));
    }

    #[test]
    fn a_restart_is_not_a_reaction() {
        let (tpdo, rpdo) = (change_pdo(PdoDirection::Transmit, 1), change_pdo(PdoDirection::Receive, 1));
        let mut reactions = ReactionTimes::default();
        let boot_up = Event {
            kind: EventKind::BootUp { cause: BootCause::Commanded { frame: 1 }, lost: 0 },
            ..Event::undecoded(&Frame::data_frame(CanId::from_standard(0x701), &[0]))
        };
        // 10 to 13 is a reaction. Of 20, the node restarts before the set point; 40 to 45 is one again.
        for (changed, restarts, reacted) in [(10, false, 13), (20, true, 30), (40, false, 45)] {
            reactions.change_tpdo(tpdo, changed);
            if restarts {
                reactions.take_event(&boot_up);
            }
            reactions.change_rpdo(rpdo, reacted, 1);
        }
        let pair = reactions.pairs().first().unwrap();
        assert_eq!((reactions.pairs().len(), pair.times.duration_count(), pair.times.longest()), (1, 2, 5));
    }
}
