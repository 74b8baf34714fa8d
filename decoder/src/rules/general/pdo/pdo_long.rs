//! PDOs longer than their mapping.

use crate::event::{Event, EventKind, Kind};
use crate::finding::About;
use crate::rules::general::facts::mapped_bytes;
use crate::rules::rule::declare_rule;
use crate::rules::{Context, Need, PdoSubset, Policy, Rule};
use crate::words::plural;

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

fn new(_policy: &Policy) -> PdoLong {
    PdoLong
}

impl Rule for PdoLong {
    fn need(&self, event: &Event, _context: &Context<'_>) -> Need {
        let EventKind::Pdo(pdo) = &event.kind else { return Need::EACH };
        match mapped_bytes(pdo) {
            None => Need::NOTHING,
            Some(mapped) if u16::from(pdo.length) <= mapped => Need::PASSED,
            Some(_) => Need::EACH,
        }
    }

    #[inline]
    fn event(&mut self, event: &Event, context: &mut Context<'_>) {
        let EventKind::Pdo(pdo) = &event.kind else { return };
        let Some(mapped) = mapped_bytes(pdo) else { return };
        if u16::from(pdo.length) <= mapped {
            return context.pass();
        }
        let (name, length) = (pdo.name, pdo.length);
        let alarm = context.fail(event).about(About::Id(pdo.cob_id));
        alarm.report(|| {
            format!("{name} with {} > {} (mapping)", plural(length, "byte"), plural(mapped, "byte"))
        });
    }
}
