//! Rules: what is wrong, judged from events.
//!
//! ```text
//! Event ─Engine::event─▶ rules of its kind ─Context::fail─▶ Ledger: groups, causes ─▶ news (events), Findings
//! ```
//!
//! A rule is one file of a family of `general/` and one line of [`REGISTRY`]: its doc comment is its documentation, its
//! fixture `fixtures/rules/<name>.log` its proof. It sees the events of one bus, asks to be woken at deadlines,
//! and keeps what it must remember; a rule never parses bytes.

pub mod conformance;
mod context;
mod declaration;
mod device;
mod engine;
mod expectation;
mod general;
mod ledger;

pub use context::meter::{Meter, Second};
pub use context::nodes::{NodeMap, NodeSet};
pub use context::traffic::{BySlot, PdoSlot, Traffic};
pub use context::{Alarm, Context};
pub use declaration::{Declaration, HEADINGS, Tolerance, manual, section, sections};
pub use engine::names::check_names;
pub use engine::setup::Setup;
pub use engine::{Engine, Judge};
pub use expectation::Expectation;
pub use general::REGISTRY;

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

/// One line of [`REGISTRY`].
pub struct Entry {
    /// What the rule says of itself.
    pub declaration: &'static Declaration,
    /// Makes one that has seen nothing.
    pub make: fn(&Setup) -> Box<dyn Rule>,
}

/// What all general rules say of themselves, in the order they are asked.
pub fn declarations() -> impl Iterator<Item = &'static Declaration> {
    REGISTRY.iter().map(|entry| entry.declaration)
}
