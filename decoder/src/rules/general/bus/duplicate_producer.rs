//! Two producers on one identifier.

use crate::event::{DecodedPdo, Event, EventKind, Kind};
use crate::finding::{FindingSubject, Severity};
use crate::profile::{PdoDirection, PdoName};
use crate::rules::general::facts::{cob_identifier, confirmed_number};
use crate::rules::rule::{declare_rule, define_tolerance};
use crate::rules::{BySlot, FrameNeed, PdoSlot, Rule, RuleContext, RulePolicy, TransferSubset};
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
        define_tolerance("periods", 20.0, "", "consecutive alternations before a finding"),
        define_tolerance("longest-ms", 200.0, "ms", "longest period checked; a slower alternation may be event-driven"),
    ],
}

struct DuplicateProducer {
    periods: u32,
    /// PDOs since the last verdict.
    judged: BySlot<u32>,
}

fn new(policy: &RulePolicy) -> DuplicateProducer {
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "saturates")]
    let periods = policy.tolerance_value(&DECLARATION, "periods") as u32;
    DuplicateProducer { periods: periods.max(1), judged: BySlot::default() }
}

/// Longest period, in ns, at which the contents of two producers alternate.
pub(in crate::rules) fn longest_period(policy: &RulePolicy) -> i64 {
    policy.tolerance_ns(&DECLARATION, "longest-ms")
}

impl DuplicateProducer {
    #[inline]
    fn on_pdo(&mut self, event: &Event, pdo: &DecodedPdo, slot: &PdoSlot, context: &mut RuleContext<'_>) {
        // Two contents are compared from the second PDO on.
        if slot.count < 2 {
            return;
        }
        let judged = self.judged.entry_of(slot);
        let Some(judged) = judged else { return };
        *judged += 1;
        if slot.alternations > 0 && slot.alternations.is_multiple_of(2 * self.periods) {
            *judged = 0;
            let intervals = [slot.interval(), slot.interval_before()].map(|interval| interval.unwrap_or(0));
            let [one, other] = intervals.map(|interval| interval / 100_000);
            let alarm = context.start_finding(event).with_subject(FindingSubject::Id(pdo.cob_id));
            alarm.report_finding(|| {
                let (name, count) = (pdo.name, 2 * self.periods);
                format!(
                    "{name} alternates between two contents at intervals of {}.{} ms and {}.{} ms in {count} frames \
                     (second producer?)",
                    one / 10, one % 10, other / 10, other % 10
                )
            });
        } else if *judged >= 4 * self.periods {
            *judged = 0;
            context.count_pass();
        }
    }

    /// Checks a COB-ID that was written or read.
    #[cold]
    fn on_cob_id(event: &Event, name: PdoName, cob_id: u64, context: &mut RuleContext<'_>) {
        let Some(id) = cob_identifier(cob_id) else { return };
        let other = context.bus.nodes().find_map(|node| {
            let other = node.id();
            (1..=4).find_map(|number| {
                let pdo = PdoName { direction: PdoDirection::Transmit, number };
                let cob_id = confirmed_number(node, pdo.communication_index(), 1)?;
                let is_same = cob_identifier(cob_id) == Some(id) && Some(other) != event.node;
                is_same.then_some((other, pdo))
            })
        });
        let Some((other, pdo)) = other else { return context.count_pass() };
        let alarm =
            context.start_finding(event).with_subject(FindingSubject::Id(id)).with_severity(Severity::Error);
        alarm.report_finding(|| {
            format!("{name} uses the identifier of {pdo} of {}", NodeId::sentence_label(other))
        });
    }
}

impl Rule for DuplicateProducer {
    fn frame_need(&self, _event: &Event, _context: &RuleContext<'_>) -> FrameNeed {
        FrameNeed { alternations: 2 * self.periods, ..FrameNeed::NOTHING }.with_count()
    }

    fn on_skipped(&mut self, slot: &PdoSlot, count: u32, context: &mut RuleContext<'_>) {
        let Some(judged) = self.judged.entry_of(slot) else { return };
        *judged = judged.saturating_add(count);
        while *judged >= 4 * self.periods {
            *judged -= 4 * self.periods;
            context.count_pass();
        }
    }

    #[inline]
    fn on_event(&mut self, event: &Event, context: &mut RuleContext<'_>) {
        match &event.kind {
            EventKind::Pdo(pdo) if !pdo.is_request => {
                if let Some(slot) = context.traffic.current_slot() {
                    self.on_pdo(event, pdo, slot, context);
                }
            }
            EventKind::SdoTransfer(transfer) => {
                let name = transfer.object.filter(|object| object.sub == 1);
                let name = name.and_then(|object| {
                    PdoName::of_parameter(object.index)
                        .filter(|name| name.communication_index() == object.index)
                });
                let is_sent = name.filter(|name| name.direction == PdoDirection::Transmit);
                if let (Some(name), Some(cob_id)) =
                    (is_sent, crate::rules::general::facts::transfer_number(transfer))
                {
                    Self::on_cob_id(event, name, cob_id, context);
                }
            }
            _ => {}
        }
    }
}
