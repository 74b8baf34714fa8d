//! Rules: detection of defects in the event stream.
//!
//! ```text
//! Event ─Engine::event─▶ rules of its kind ─Context::fail─▶ Ledger: groups, causes ─▶ news (events), Findings
//! ```
//!
//! A rule is one file in a family folder of `general/` and one line of [`REGISTRY`]. Its doc comment is its
//! documentation, and its fixture `fixtures/rules/<name>.log` is its test. It receives the events of one bus,
//! requests wake-ups for deadlines and holds its own state. A rule never parses bytes.

pub mod conformance;
mod context;
mod declaration;
mod device;
mod engine;
mod expectation;
mod general;
mod ledger;
mod need;
mod policy;
mod rule;
mod selection;

pub use context::meter::{Meter, Second};
pub use context::pdo_slot::PdoSlot;
pub(crate) use context::traffic::BySlot;
pub use context::traffic::Traffic;
pub use context::{Alarm, Context};
pub use declaration::{
    Declaration, HEADINGS, PdoSubset, Tolerance, TransferSubset, manual, section, sections,
};
pub use engine::Engine;
pub use engine::names::check_names;
pub use engine::setup::Setup;
pub use expectation::Expectation;
pub use general::REGISTRY;
pub use general::declarations;
pub use need::Need;
pub use policy::Policy;
pub use rule::{Entry, Rule};
pub use selection::RuleSelection;
