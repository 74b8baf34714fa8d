//! PDOs shorter than their mapping.

use crate::event::{Event, EventKind, Kind};
use crate::finding::FindingSubject;
use crate::profile::PdoDirection;
use crate::rules::general::facts::mapped_bytes;
use crate::rules::rule::declare_rule;
use crate::rules::{FrameNeed, PdoSubset, Rule, RuleContext, RulePolicy};
use crate::words::count_noun;

declare_rule! {
    /// # What it checks
    /// A PDO has fewer bytes than its mapping, which was seen, given, or is fixed by the device manual.
    ///
    /// # Why it matters
    /// A consumer discards the PDO (EMCY 8210), or uses values that were never sent.
    ///
    /// # Source
    /// CiA 301 §7.2.2.3 and table 26 (8210: PDO not processed due to length error)
    ///
    /// # What to look at first
    /// Compare the PDO mapping of producer and consumer. Check whether another node sends on this identifier.
    ///
    /// # Mutation
    /// cut the last byte of a PDO
    "pdo-short", Error, "PDO shorter than its mapping",
    kinds: [Kind::Pdo],
    pdos: PdoSubset::Mapped,
    needs: "a PDO with a known mapping",
    cases: &["5.4"],
    word: "PDO",
}

struct PdoShort;

fn new(_policy: &RulePolicy) -> PdoShort {
    PdoShort
}

impl Rule for PdoShort {
    fn frame_need(&self, event: &Event, _context: &RuleContext<'_>) -> FrameNeed {
        let EventKind::Pdo(pdo) = &event.kind else { return FrameNeed::EACH };
        match mapped_bytes(pdo) {
            None => FrameNeed::NOTHING,
            Some(mapped) if u16::from(pdo.length) >= mapped => FrameNeed::PASSED,
            Some(_) => FrameNeed::EACH,
        }
    }

    #[inline]
    fn on_event(&mut self, event: &Event, context: &mut RuleContext<'_>) {
        let EventKind::Pdo(pdo) = &event.kind else { return };
        let Some(mapped) = mapped_bytes(pdo) else { return };
        if u16::from(pdo.length) >= mapped {
            return context.count_pass();
        }
        // A test tool sends short RPDOs on purpose.
        if context.is_tested && pdo.name.direction == PdoDirection::Receive {
            return;
        }
        let (name, length) = (pdo.name, pdo.length);
        let alarm = context
            .start_finding(event)
            .with_subject(FindingSubject::Id(pdo.cob_id))
            .with_measure(f64::from(mapped));
        alarm.report_finding(|| {
            format!("{name} with {} < {} (mapping)", count_noun(length, "byte"), count_noun(mapped, "byte"))
        });
    }
}
