//! Facts about nodes that no single event contains.

mod role;

pub(crate) use role::is_controller;
