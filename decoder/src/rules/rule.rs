//! What a rule is: [`Rule`], and how it is listed in the registry.

use super::context::Context;
use super::declaration::{Declaration, Tolerance};
use super::policy::Policy;
use crate::event::Event;
use crate::query::KindSet;

/// Judges the events of one bus.
pub trait Rule {
    /// Called before the first event.
    fn begin(&mut self, _context: &mut Context<'_>) {}

    /// An event of one of the kinds it declared.
    fn event(&mut self, event: &Event, context: &mut Context<'_>);

    /// Kinds of events it looks at now, where that changes.
    fn kinds(&self) -> Option<KindSet> {
        None
    }

    /// Whether it looks at PDOs now, of those it declared; requests it gets in any case. A rule that waits for something
    /// else first need not look at each of them. It is asked again behind every other event it gets.
    fn wants_pdos(&self) -> bool {
        true
    }

    /// A time it asked for has passed.
    fn wake(&mut self, _token: u64, _context: &mut Context<'_>) {}

    /// A second of the bus is over, as its frames' stamps say: [`Context::meter`] has what was in it.
    fn second(&mut self, _context: &mut Context<'_>) {}

    /// Nothing more comes.
    fn finish(&mut self, _context: &mut Context<'_>) {}
}

/// One line of [`REGISTRY`](super::REGISTRY).
pub struct Entry {
    /// What the rule says of itself.
    pub declaration: &'static Declaration,
    /// Makes one that has seen nothing.
    pub make: fn(&Policy) -> Box<dyn Rule>,
}

/// Declares a rule: its doc comment is its explanation.
macro_rules! declare_rule {
    ($(#[doc = $doc:literal])+ $name:literal, $severity:ident, $title:literal,
     kinds: [$($kind:literal),+ $(,)?] $(, $field:ident: $value:expr)* $(,)?) => {
        /// What the rule says of itself.
        const DECLARATION: $crate::rules::Declaration = $crate::rules::Declaration {
            name: $name,
            severity: $crate::finding::Severity::$severity,
            title: $title,
            explanation: concat!($($doc, "\n"),+),
            kinds: &[$($kind),+],
            $($field: $value,)*
            ..$crate::rules::Declaration::PLAIN
        };

        /// Its line of the registry.
        pub(in crate::rules::general) const ENTRY: $crate::rules::Entry =
            $crate::rules::Entry { declaration: &DECLARATION, make: |policy| Box::new(new(policy)) };
    };
}

pub(super) use declare_rule;

/// A tolerance: key, default, unit, what it limits.
pub(super) const fn tolerance(
    key: &'static str,
    default: f64,
    unit: &'static str,
    text: &'static str,
) -> Tolerance {
    Tolerance { key, default, unit, text }
}
