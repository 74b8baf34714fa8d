//! [`Rule`], and its entry in the registry.

use super::context::RuleContext;
use super::context::pdo_slot::PdoSlot;
use super::context::traffic::PdoTraffic;
use super::declaration::{Declaration, Tolerance};
use super::need::FrameNeed;
use super::policy::RulePolicy;
use crate::event::{Event, KindSet};

/// Checks the events of one bus.
pub trait Rule: Send {
    /// Called before the first event.
    fn begin_bus(&mut self, _context: &mut RuleContext<'_>) {}

    /// Handles an event of a declared kind.
    fn on_event(&mut self, event: &Event, context: &mut RuleContext<'_>);

    /// New set of event kinds, if it has changed.
    fn changed_kinds(&self) -> Option<KindSet> {
        None
    }

    /// Whether the rule needs its declared PDOs now; PDO requests are always delivered. A rule that first
    /// waits for another event returns false to save time. The engine asks again after every other event of
    /// the rule.
    fn wants_pdos(&self) -> bool {
        true
    }

    /// What the rule needs of the next PDOs or messages with the identifier and the data length of `event`, which it
    /// received. The answer holds until [`RuleContext::ask_again`], and until node or layout change. An answer that depends on
    /// [`PdoSlot::median`] or its period states this.
    fn frame_need(&self, _event: &Event, _context: &RuleContext<'_>) -> FrameNeed {
        FrameNeed::EACH
    }

    /// Takes the number of PDOs that followed the last event of an identifier, for [`FrameNeed::with_count`]; `slot` contains
    /// them.
    fn on_skipped(&mut self, _slot: &PdoSlot, _count: u32, _context: &mut RuleContext<'_>) {}

    /// Handles a requested wake-up, see `RuleContext::wake_at`.
    fn on_wake(&mut self, _token: u64, _context: &mut RuleContext<'_>) {}

    /// Time to which a wake-up at `now` can be postponed, if it would have no other effect; it then needs no event.
    fn postponed_wake(&self, _token: u64, _now: i64, _traffic: &PdoTraffic) -> Option<i64> {
        None
    }

    /// Called after each second of bus time (by timestamps); [`RuleContext::meter`] contains its counts.
    fn on_second(&mut self, _context: &mut RuleContext<'_>) {}

    /// Called at the end of the capture.
    fn on_end(&mut self, _context: &mut RuleContext<'_>) {}
}

/// One line of [`REGISTRY`](super::REGISTRY).
pub struct RegistryEntry {
    /// Name, severity and documentation of the rule.
    pub declaration: &'static Declaration,
    /// Creates the rule in its initial state.
    pub make: fn(&RulePolicy) -> Box<dyn Rule>,
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

        pub(in crate::rules::general) const ENTRY: $crate::rules::RegistryEntry =
            $crate::rules::RegistryEntry { declaration: &DECLARATION, make: |policy| Box::new(new(policy)) };
    };
}

pub(super) use declare_rule;

/// Defines a tolerance: key, default, unit, meaning.
pub(super) const fn define_tolerance(
    key: &'static str,
    default: f64,
    unit: &'static str,
    text: &'static str,
) -> Tolerance {
    Tolerance { key, default, unit, text }
}
