//! Two producers on one identifier.

use crate::event::{Event, EventKind, Pdo};
use crate::finding::{About, Severity};
use crate::profile::{PdoDirection, PdoName};
use crate::rules::context::traffic::PdoSlot;
use crate::rules::general::facts::{confirmed_number, identifier};
use crate::rules::rule::{declare_rule, tolerance};
use crate::rules::{Context, Policy, Repetitions, Rule};
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
    kinds: ["pdo", "sdo-transfer"],
    needs: "steady PDO intervals, or 18xx:01 of two nodes",
    is_timing: true,
    word: "TWICE",
    tolerances: &[
        tolerance("periods", 20.0, "", "consecutive alternations before a finding"),
        tolerance("longest-ms", 200.0, "ms", "longest period checked; a slower alternation may be event-driven"),
    ],
}

/// Latest PDOs on an identifier.
#[derive(Clone, Copy, Default)]
struct Turns {
    /// Content and length, latest first.
    contents: [(u64, u8); 2],
    /// Intervals, latest first.
    intervals: [i64; 2],
    /// Usual interval while the content was constant, before the second content.
    alone: Option<i64>,
    /// Consecutive PDOs that fit two producers.
    count: u32,
    judged: u32,
}

struct DuplicateProducer {
    periods: u32,
    longest: i64,
    turns: Vec<Turns>,
}

fn new(policy: &Policy) -> DuplicateProducer {
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "saturates")]
    let periods = policy.tolerance(&DECLARATION, "periods") as u32;
    let longest = policy.nanoseconds(&DECLARATION, "longest-ms");
    DuplicateProducer { periods: periods.max(1), longest, turns: Vec::new() }
}

impl Turns {
    /// Adds a PDO; returns whether it continues an alternation between two producers.
    #[inline]
    fn take(&mut self, content: (u64, u8), interval: i64, longest: i64, usual: Option<i64>) -> bool {
        let [last, before] = self.contents;
        let [interval_last, interval_before] = self.intervals;
        self.contents = [content, last];
        self.intervals = [interval, interval_last];
        if content == last {
            return false;
        }
        if content != before {
            self.alone = usual.filter(|_| last == before);
            return false;
        }
        let period = interval.saturating_add(interval_last);
        let shorter = interval.min(interval_last);
        let jitter = period.unsigned_abs() / 20;
        // One producer that alternates a single bit in a rounded period may reach 40 %; other contents do not depend on
        // the phase.
        let unequal = if (content.0 ^ last.0).count_ones() > 1 { period / 20 * 9 } else { period / 5 * 2 };
        // Two phases outside bursts, or a second producer in addition to a known one, at any phase; each with the same
        // interval as one period ago.
        period <= longest
            && interval.abs_diff(interval_before) < jitter
            && ((shorter >= period / 10 && shorter < unequal)
                || self.alone.is_some_and(|alone| alone.abs_diff(period) < jitter))
    }
}

impl DuplicateProducer {
    #[inline]
    fn pdo(&mut self, event: &Event, pdo: &Pdo, slot: &PdoSlot, context: &mut Context<'_>) {
        let Some(turns) = self.turns.get_mut(slot.place) else {
            return self.turns.resize(slot.place + 1, Turns::default());
        };
        let goes_on =
            turns.take((pdo.word(), pdo.length), slot.interval.unwrap_or(0), self.longest, slot.median);
        turns.count = if goes_on { turns.count + 1 } else { 0 };
        turns.judged += 1;
        if turns.judged == 1 {
            // The content of the first PDO of the identifier was not known.
            context.ask_again();
        }
        if turns.count >= 2 * self.periods {
            turns.count = 0;
            turns.judged = 0;
            let [one, other] = turns.intervals.map(|interval| interval / 100_000);
            let alarm = context.fail(event).about(About::Id(pdo.cob_id));
            alarm.report(|| {
                let (name, count) = (pdo.name, 2 * self.periods);
                format!(
                    "{name} alternates between two contents at intervals of {}.{} ms and {}.{} ms in {count} frames \
                     (second producer?)",
                    one / 10, one % 10, other / 10, other % 10
                )
            });
        } else if turns.judged >= 4 * self.periods {
            turns.judged = 0;
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
    fn repetitions(&self, event: &Event, context: &Context<'_>) -> Repetitions {
        let turns = context.traffic.current().and_then(|slot| self.turns.get(slot.place));
        match (&event.kind, turns) {
            (EventKind::Pdo(pdo), Some(turns)) if turns.contents[0] == (pdo.word(), pdo.length) => {
                Repetitions::Counted
            }
            _ => Repetitions::Needed,
        }
    }

    /// Equal contents end an alternation.
    fn repeated(&mut self, slot: &PdoSlot, count: u32, context: &mut Context<'_>) {
        let Some(turns) = self.turns.get_mut(slot.place) else { return };
        let [content, _] = turns.contents;
        turns.contents = [content; 2];
        let before = if count > 1 { slot.interval_before.unwrap_or(0) } else { turns.intervals[0] };
        turns.intervals = [slot.interval.unwrap_or(0), before];
        turns.count = 0;
        turns.judged = turns.judged.saturating_add(count);
        while turns.judged >= 4 * self.periods {
            turns.judged -= 4 * self.periods;
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
