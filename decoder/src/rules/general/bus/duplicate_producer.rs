//! Two producers on one identifier.

use crate::event::{Event, EventKind, Kind, Pdo};
use crate::finding::{About, Severity};
use crate::profile::{PdoDirection, PdoName};
use crate::rules::general::facts::{confirmed_number, identifier};
use crate::rules::rule::{declare_rule, tolerance};
use crate::rules::{BySlot, Context, Need, PdoSlot, Policy, Rule, TransferSubset};
use crate::wire::NodeId;

declare_rule! {
    /// # What it checks
    /// A PDO identifier has two producers: an error if two nodes are configured to send on it (18xx:01 valid
    /// in both). It is a warning if two intervals, together with two contents or data lengths, alternate for
    /// `periods` periods. Bursts of one producer are exempt, and so are two equal intervals, unless the
    /// identifier first had one constant content with the same period.
    ///
    /// # Why it matters
    /// Two nodes that send the same identifier at the same time destroy each other's frames until one goes
    /// bus-off. Before that, consumers alternate between the values of both producers.
    ///
    /// # Source
    /// CiA 301 §7.2.2.1 (one producer per PDO), ISO 11898-1 (identifiers are unique in arbitration)
    ///
    /// # What to look at first
    /// Compare the COB-IDs in 1800 and up of all nodes. Check for a duplicate node-ID and for identifiers
    /// used by a PLC.
    ///
    /// # Mutation
    /// insert a second series of a periodic PDO, half a period later, with other data
    "duplicate-producer", Warning, "two producers on one identifier",
    kinds: [Kind::Pdo, Kind::SdoTransfer],
    transfers: TransferSubset::Communication,
    needs: "steady PDO intervals, or 18xx:01 of two nodes",
    is_timing: true,
    word: "TWICE",
    tolerances: &[
        tolerance("periods", 20.0, "", "consecutive alternations before a finding"),
        tolerance("longest-ms", 200.0, "ms", "longest period checked; a slower alternation may be event-driven"),
    ],
}

struct DuplicateProducer {
    periods: u32,
    /// PDOs since the last verdict.
    judged: BySlot<u32>,
}

fn new(policy: &Policy) -> DuplicateProducer {
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "saturates")]
    let periods = policy.tolerance(&DECLARATION, "periods") as u32;
    DuplicateProducer { periods: periods.max(1), judged: BySlot::default() }
}

/// Longest period, in ns, at which the contents of two producers alternate.
pub(in crate::rules) fn longest_period(policy: &Policy) -> i64 {
    policy.nanoseconds(&DECLARATION, "longest-ms")
}

impl DuplicateProducer {
    #[inline]
    fn pdo(&mut self, event: &Event, pdo: &Pdo, slot: &PdoSlot, context: &mut Context<'_>) {
        // Two contents are compared from the second PDO on.
        if slot.count < 2 {
            return;
        }
        let judged = self.judged.of(slot);
        let Some(judged) = judged else { return };
        *judged += 1;
        if slot.alternations > 0 && slot.alternations.is_multiple_of(2 * self.periods) {
            *judged = 0;
            let intervals = [slot.interval(), slot.interval_before()].map(|interval| interval.unwrap_or(0));
            let [one, other] = intervals.map(|interval| interval / 100_000);
            let alarm = context.fail(event).about(About::Id(pdo.cob_id));
            alarm.report(|| {
                let (name, count) = (pdo.name, 2 * self.periods);
                format!(
                    "{name} alternates between two contents at intervals of {}.{} ms and {}.{} ms in {count} frames \
                     (second producer?)",
                    one / 10, one % 10, other / 10, other % 10
                )
            });
        } else if *judged >= 4 * self.periods {
            *judged = 0;
            context.pass();
        }
    }

    /// Checks a COB-ID that was written or read.
    #[cold]
    fn configured(event: &Event, name: PdoName, cob_id: u64, context: &mut Context<'_>) {
        let Some(id) = identifier(cob_id) else { return };
        let other = context.bus.nodes().find_map(|node| {
            let other = node.id();
            (1..=4).find_map(|number| {
                let pdo = PdoName { direction: PdoDirection::Transmit, number };
                let cob_id = confirmed_number(node, pdo.communication_index(), 1)?;
                let is_same = identifier(cob_id) == Some(id) && Some(other) != event.node;
                is_same.then_some((other, pdo))
            })
        });
        let Some((other, pdo)) = other else { return context.pass() };
        let alarm = context.fail(event).about(About::Id(id)).severity(Severity::Error);
        alarm.report(|| format!("{name} uses the identifier of {pdo} of {}", NodeId::words(other)));
    }
}

impl Rule for DuplicateProducer {
    fn need(&self, _event: &Event, _context: &Context<'_>) -> Need {
        Need { alternations: 2 * self.periods, ..Need::NOTHING }.counted()
    }

    fn skipped(&mut self, slot: &PdoSlot, count: u32, context: &mut Context<'_>) {
        let Some(judged) = self.judged.of(slot) else { return };
        *judged = judged.saturating_add(count);
        while *judged >= 4 * self.periods {
            *judged -= 4 * self.periods;
            context.pass();
        }
    }

    #[inline]
    fn event(&mut self, event: &Event, context: &mut Context<'_>) {
        match &event.kind {
            EventKind::Pdo(pdo) if !pdo.is_request => {
                if let Some(slot) = context.traffic.current() {
                    self.pdo(event, pdo, slot, context);
                }
            }
            EventKind::SdoTransfer(transfer) => {
                let name = transfer.object.filter(|object| object.sub == 1);
                let name = name.and_then(|object| {
                    PdoName::of_parameter(object.index)
                        .filter(|name| name.communication_index() == object.index)
                });
                let is_sent = name.filter(|name| name.direction == PdoDirection::Transmit);
                if let (Some(name), Some(cob_id)) = (is_sent, crate::rules::general::facts::number(transfer))
                {
                    Self::configured(event, name, cob_id, context);
                }
            }
            _ => {}
        }
    }
}
