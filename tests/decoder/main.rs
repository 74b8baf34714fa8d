//! Behaviour of the decoder on captures.

mod expected;
mod formats_text;
#[path = "../support/mod.rs"]
mod support;
