//! [`Rule`], and its entry in the registry.

use super::context::Context;
use super::context::pdo_slot::PdoSlot;
use super::context::traffic::Traffic;
use super::declaration::{Declaration, Tolerance};
use super::need::Need;
use super::policy::Policy;
use crate::event::{Event, KindSet};

/// Checks the events of one bus.
pub trait Rule: Send {
    /// Called before the first event.
    fn begin(&mut self, _context: &mut Context<'_>) {}

    /// Handles an event of a declared kind.
    fn event(&mut self, event: &Event, context: &mut Context<'_>);

    /// New set of event kinds, if it has changed.
    fn kinds(&self) -> Option<KindSet> {
        None
    }

    /// Whether the rule needs its declared PDOs now; PDO requests are always delivered. A rule that first
    /// waits for another event returns false to save time. The engine asks again after every other event of
    /// the rule.
    fn wants_pdos(&self) -> bool {
        true
    }

    /// What the rule needs of the next PDOs or messages with the identifier and the data length of `event`, which it
    /// received. The answer holds until [`Context::ask_again`], and until node or layout change. An answer that depends on
    /// [`PdoSlot::median`] or its period states this.
    fn need(&self, _event: &Event, _context: &Context<'_>) -> Need {
        Need::EACH
    }

    /// Takes the number of PDOs that followed the last event of an identifier, for [`Need::counted`]; `slot` contains
    /// them.
    fn skipped(&mut self, _slot: &PdoSlot, _count: u32, _context: &mut Context<'_>) {}

    /// Handles a requested wake-up, see `Context::wake_at`.
    fn wake(&mut self, _token: u64, _context: &mut Context<'_>) {}

    /// Time to which a wake-up at `now` can be postponed, if it would have no other effect; it then needs no event.
    fn postpone(&self, _token: u64, _now: i64, _traffic: &Traffic) -> Option<i64> {
        None
    }

    /// Called after each second of bus time (by timestamps); [`Context::meter`] contains its counts.
    fn second(&mut self, _context: &mut Context<'_>) {}

    /// Called at the end of the capture.
    fn finish(&mut self, _context: &mut Context<'_>) {}
}

/// One line of [`REGISTRY`](super::REGISTRY).
pub struct Entry {
    /// Name, severity and documentation of the rule.
    pub declaration: &'static Declaration,
    /// Creates the rule in its initial state.
    pub make: fn(&Policy) -> Box<dyn Rule>,
}

/// Declares a rule; its doc comment becomes its documentation.
macro_rules! declare_rule {
    ($(#[doc = $doc:literal])+ $name:literal, $severity:ident, $title:literal,
     kinds: [$($kind:expr),+ $(,)?] $(, $field:ident: $value:expr)* $(,)?) => {
        const DECLARATION: $crate::rules::Declaration = $crate::rules::Declaration {
            name: $name,
            severity: $crate::finding::Severity::$severity,
            title: $title,
            explanation: concat!($($doc, "\n"),+),
            kinds: $crate::event::KindSet::of(&[$($kind),+]),
            $($field: $value,)*
            ..$crate::rules::Declaration::PLAIN
        };

        pub(in crate::rules::general) const ENTRY: $crate::rules::Entry =
            $crate::rules::Entry { declaration: &DECLARATION, make: |policy| Box::new(new(policy)) };
    };
}

pub(super) use declare_rule;

/// Defines a tolerance: key, default, unit, meaning.
pub(super) const fn tolerance(
    key: &'static str,
    default: f64,
    unit: &'static str,
    text: &'static str,
) -> Tolerance {
    Tolerance { key, default, unit, text }
}
