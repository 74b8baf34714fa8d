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
mod policy;
mod rule;

pub use context::meter::{Meter, Second};
pub(crate) use context::nodes::{NodeMap, NodeSet};
pub(crate) use context::traffic::BySlot;
pub use context::traffic::{PdoSlot, Traffic};
pub use context::{Alarm, Context};
pub use declaration::{Declaration, HEADINGS, Tolerance, manual, section, sections};
pub use engine::names::check_names;
pub use engine::setup::Setup;
pub use engine::{Engine, Judge};
pub use expectation::Expectation;
pub use general::REGISTRY;
pub use general::declarations;
pub use policy::Policy;
pub use rule::{Entry, Rule};
