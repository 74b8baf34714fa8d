//! The gap that all periodic producers of a bus share.

use std::collections::BTreeMap;

use super::service::IdentifierService;
use crate::profile::PdoDirection;
use crate::session::bus::time::IdentifierIntervals;

/// Producers that must miss a message at the same time: with fewer, a hole cannot be distinguished from a lost node.
const PRODUCERS: usize = 3;

/// Sender of a message, as far as it is periodic by its nature.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
enum PeriodicProducer {
    Master,
    Node(u8),
    Address(u8),
}

fn periodic_producer(service: IdentifierService) -> Option<PeriodicProducer> {
    match service {
        IdentifierService::Pdo(name, node) if name.direction == PdoDirection::Transmit => {
            Some(PeriodicProducer::Node(node.number()))
        }
        IdentifierService::ErrorControl(node) => Some(PeriodicProducer::Node(node.number())),
        IdentifierService::Pdo(..) | IdentifierService::Sync => Some(PeriodicProducer::Master),
        IdentifierService::J1939(id) => Some(PeriodicProducer::Address(id.source)),
        _ => None,
    }
}

/// Time after which a bus without frames since `received` is silent as a whole: so many producers that were active then have
/// missed all their messages. `None` if there are too few.
pub(in crate::session) fn shared_gap<'a>(
    pulses: impl Iterator<Item = (IdentifierService, &'a IdentifierIntervals)>,
    received: i64,
) -> Option<i64> {
    let mut missing: BTreeMap<PeriodicProducer, i64> = BTreeMap::new();
    for (service, pulse) in pulses {
        let Some((producer, due)) = periodic_producer(service).zip(pulse.due_time()) else { continue };
        if due >= received {
            let latest = missing.entry(producer).or_insert(due);
            *latest = due.max(*latest);
        }
    }
    let mut dues: Vec<i64> = missing.into_values().collect();
    dues.sort_unstable();
    dues.get(PRODUCERS - 1).copied()
}

#[cfg(test)]
mod tests {
    use super::*;

    const MS: i64 = 1_000_000;

    fn every(milliseconds: i64, last: i64) -> IdentifierIntervals {
        let mut pulse = IdentifierIntervals::NEW;
        for back in (0..6).rev() {
            pulse.note_frame((last - back * milliseconds) * MS, 0);
        }
        pulse
    }

    fn of(
        pulses: &[(IdentifierService, IdentifierIntervals)],
    ) -> impl Iterator<Item = (IdentifierService, &IdentifierIntervals)> {
        pulses.iter().map(|(service, pulse)| (*service, pulse))
    }

    fn heartbeat(node: u8) -> IdentifierService {
        IdentifierService::ErrorControl(node.into())
    }

    #[test]
    fn three_producers_that_miss_their_messages_share_a_gap() {
        let pulses = [
            (heartbeat(1), every(100, 990)),
            (heartbeat(2), every(50, 1_000)),
            (IdentifierService::Sync, every(20, 995)),
        ];
        // 990 + 120, 1000 + 60 and 995 + 24: the last of the three is node 1.
        assert_eq!(shared_gap(of(&pulses), 1_000 * MS), Some(1_110 * MS));
        assert_eq!(shared_gap(of(&pulses).take(2), 1_000 * MS), None);
    }

    /// A node whose PDOs stop while its heartbeat is not due yet has missed nothing that shows its absence.
    #[test]
    fn all_messages_of_a_producer_count() {
        let both = |node: u8| [(heartbeat(node), every(1_000, 700)), (heartbeat(node), every(10, 1_000))];
        let pulses = [both(1), both(2), both(3)].concat();
        assert_eq!(shared_gap(of(&pulses), 1_000 * MS), Some(1_900 * MS));
    }

    #[test]
    fn producers_that_were_silent_before_do_not_count() {
        let pulses = [
            (heartbeat(1), every(100, 500)),
            (heartbeat(2), every(50, 1_000)),
            (IdentifierService::Sync, every(20, 995)),
        ];
        assert_eq!(shared_gap(of(&pulses), 1_000 * MS), None);
    }
}
