//! Parameter groups of public standards, used where neither the user's databases nor a profile describe a message.
//!
//! The tables of `decoder/standards/` are text that is part of the program. The lines of a file are indexed at
//! the first question to it, and the fields of a group at its first message, so that nothing is read at start.
//!
//! ```text
//! decoder/standards/*.tsv ─table─▶ lines of a group ─definition─▶ variants ─placement, payload─▶ layout
//! ```
//!
//! Fields of NMEA 2000 have lengths that depend on the payload. A layout is therefore made for a payload, and
//! shared by all payloads with the same lengths.

mod definition;
mod evidence;
mod field;
mod group;
mod indicators;
mod kind;
mod layout;
mod name;
mod place;
mod placement;
mod source;
mod standard;
mod table;
#[cfg(test)]
mod tests;

pub(crate) use evidence::RvCEvidence;
pub(crate) use group::standard_group;
pub use name::{describe_name, function_name, manufacturer_name};
pub use source::{TableSource, table_sources};
pub(crate) use standard::{Standard, is_fast_group, standard_parameter};
pub use table::NamedParameter;
