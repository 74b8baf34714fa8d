//! What a node is, and what follows from it.

mod assign;
mod behaviour;
mod restart;
mod values;

pub(super) use restart::Restart;
