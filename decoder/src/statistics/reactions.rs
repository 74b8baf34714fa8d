//! Reaction time of the controller: from a changed TPDO of a node to the next changed RPDO to it.

use super::Distribution;
use crate::event::{Event, EventKind, Pdo};
use crate::profile::{PdoDirection, PdoName};

/// Maximum number of pairs per node.
const MOST_PAIRS: usize = 64;

/// Reactions of the controller to one TPDO by one RPDO.
#[derive(Debug, Clone)]
pub struct ReactionTime {
    /// PDO of the node.
    pub tpdo: PdoName,
    /// PDO to the node.
    pub rpdo: PdoName,
    /// Times from TPDO to RPDO.
    pub times: Distribution,
    /// Time and frame of the RPDO with the longest reaction.
    pub longest_at: (i64, u64),
}

/// Reaction times of one node by pair of PDOs.
#[derive(Debug, Clone, Default)]
pub struct Reactions {
    pairs: Vec<ReactionTime>,
    /// Changed TPDOs without a reaction by each RPDO: TPDO, time, RPDOs that reacted already.
    open: Vec<(PdoName, i64, Vec<PdoName>)>,
}

impl Reactions {
    /// Pairs of PDOs, in order of appearance.
    pub fn pairs(&self) -> &[ReactionTime] {
        &self.pairs
    }

    /// Handles an event of the node.
    pub(crate) fn event(&mut self, event: &Event) {
        match &event.kind {
            EventKind::Pdo(pdo) => self.add(event, pdo),
            // A restart or a silence is not a reaction time.
            EventKind::BootUp { .. } | EventKind::NodeLost(_) => self.open.clear(),
            _ => {}
        }
    }

    /// Adds a PDO with changed contents.
    fn add(&mut self, event: &Event, pdo: &Pdo) {
        let Some(time) = event.time.map(|time| time.0).filter(|_| !pdo.is_request && !event.routine) else {
            return;
        };
        if pdo.name.direction == PdoDirection::Transmit {
            self.changed(pdo.name, time);
        } else {
            self.reacted(pdo.name, time, event.frames.last);
        }
    }

    fn changed(&mut self, tpdo: PdoName, time: i64) {
        let fits = self.open.len() < MOST_PAIRS;
        match self.open.iter_mut().find(|(name, ..)| *name == tpdo) {
            // The controller still works on an earlier value, unless every known RPDO reacted to it.
            Some((_, began, answered)) if !answered.is_empty() => {
                *began = time;
                answered.clear();
            }
            None if fits => self.open.push((tpdo, time, Vec::new())),
            Some(_) | None => {}
        }
    }

    fn reacted(&mut self, rpdo: PdoName, time: i64, frame: u64) {
        for (tpdo, began, answered) in &mut self.open {
            if answered.contains(&rpdo) || answered.len() >= MOST_PAIRS {
                continue;
            }
            answered.push(rpdo);
            let place = self.pairs.iter().position(|pair| (pair.tpdo, pair.rpdo) == (*tpdo, rpdo));
            if place.is_none() && self.pairs.len() >= MOST_PAIRS {
                continue;
            }
            let place = place.unwrap_or_else(|| {
                let times = Distribution::default();
                self.pairs.push(ReactionTime { tpdo: *tpdo, rpdo, times, longest_at: (time, frame) });
                self.pairs.len() - 1
            });
            let Some(pair) = self.pairs.get_mut(place) else { continue };
            let reaction = time.saturating_sub(*began);
            if reaction > pair.times.longest() {
                pair.longest_at = (time, frame);
            }
            pair.times.add(reaction);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const fn pdo(direction: PdoDirection, number: u16) -> PdoName {
        PdoName { direction, number }
    }

    #[test]
    fn a_reaction_is_measured_from_the_first_change_that_is_still_open() {
        let (tpdo, rpdo) = (pdo(PdoDirection::Transmit, 1), pdo(PdoDirection::Receive, 1));
        let mut reactions = Reactions::default();
        // Set points before any actual value are not reactions.
        reactions.reacted(rpdo, 5, 1);
        // Changed at 10 and 20, set point at 35: 25. Changed at 40, set point at 47: 7, and a second one at 60 is
        // not a reaction.
        reactions.changed(tpdo, 10);
        reactions.changed(tpdo, 20);
        reactions.reacted(rpdo, 35, 2);
        reactions.changed(tpdo, 40);
        reactions.reacted(rpdo, 47, 3);
        reactions.reacted(rpdo, 60, 4);
        assert_eq!(reactions.pairs().len(), 1);
        let pair = reactions.pairs().first().unwrap();
        assert_eq!((pair.tpdo, pair.rpdo, pair.times.count()), (tpdo, rpdo, 2));
        assert_eq!((pair.times.percentile(50), pair.times.longest()), (Some(7), 25));
        assert_eq!(pair.longest_at, (35, 2));
    }
}
