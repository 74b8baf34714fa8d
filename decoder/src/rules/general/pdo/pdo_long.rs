//! PDOs longer than their mapping.

use crate::event::{Event, EventKind, Kind};
use crate::finding::FindingSubject;
use crate::rules::general::facts::mapped_bytes;
use crate::rules::rule::declare_rule;
use crate::rules::{FrameNeed, PdoSubset, Rule, RuleContext, RulePolicy};
use crate::words::count_noun;

declare_rule! {
    /// # What it checks
    /// A PDO has more bytes than its mapping, which was seen, given, or is fixed by the device manual.
    ///
    /// # Why it matters
    /// A consumer ignores the additional bytes or reports 8220. The additional bytes only load the bus.
    ///
    /// # Source
    /// CiA 301 §7.2.2.3 and table 26 (8220: PDO length exceeded)
    ///
    /// # What to look at first
    /// Compare the PDO mapping of producer and consumer.
    ///
    /// # Mutation
    /// add a byte to a PDO
    "pdo-long", Note, "PDO longer than its mapping",
    kinds: [Kind::Pdo],
    pdos: PdoSubset::Mapped,
    needs: "a PDO with a known mapping",
    word: "PDO",
}

struct PdoLong;

fn new(_policy: &RulePolicy) -> PdoLong {
    PdoLong
}

impl Rule for PdoLong {
    fn frame_need(&self, event: &Event, _context: &RuleContext<'_>) -> FrameNeed {
        let EventKind::Pdo(pdo) = &event.kind else { return FrameNeed::EACH };
        match mapped_bytes(pdo) {
            None => FrameNeed::NOTHING,
            Some(mapped) if u16::from(pdo.length) <= mapped => FrameNeed::PASSED,
            Some(_) => FrameNeed::EACH,
        }
    }

    #[inline]
    fn on_event(&mut self, event: &Event, context: &mut RuleContext<'_>) {
        let EventKind::Pdo(pdo) = &event.kind else { return };
        let Some(mapped) = mapped_bytes(pdo) else { return };
        if u16::from(pdo.length) <= mapped {
            return context.count_pass();
        }
        let (name, length) = (pdo.name, pdo.length);
        let alarm = context.start_finding(event).with_subject(FindingSubject::Id(pdo.cob_id));
        alarm.report_finding(|| {
            format!("{name} with {} > {} (mapping)", count_noun(length, "byte"), count_noun(mapped, "byte"))
        });
    }
}
