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

pub use crate::finding::documentation::section_text;
pub use context::meter::{BusSecond, FrameMeter};
pub use context::pdo_slot::PdoSlot;
pub(crate) use context::traffic::BySlot;
pub use context::traffic::PdoTraffic;
pub use context::{FindingAlarm, RuleContext};
pub use declaration::{
    Declaration, HEADINGS, PdoSubset, Tolerance, TransferSubset, all_sections, format_manual,
};
pub use engine::RuleEngine;
pub use engine::names::check_names;
pub use engine::setup::RuleSetup;
pub use expectation::CompiledExpectation;
pub use general::REGISTRY;
pub use general::all_declarations;
pub use need::FrameNeed;
pub use policy::RulePolicy;
pub use rule::{RegistryEntry, Rule};
pub use selection::RuleSelection;
