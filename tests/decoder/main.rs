//! Behaviour of the decoder on captures.

mod expected;
