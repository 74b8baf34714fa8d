//! What each fuzz target does with its bytes.
//!
//! A target is a function of bytes that panics when something is wrong: the code under test by itself, or
//! an assertion here about what it must hold to whatever the bytes are. The same functions replay kept
//! inputs as plain tests (`tests/decoder/fuzz_replay.rs` includes this folder).

#![allow(
    clippy::unwrap_used,
    clippy::panic,
    clippy::indexing_slicing,
    reason = "a broken promise panics here"
)]
#![allow(dead_code, reason = "fuzzer, seed writer and replay use a part each")]

pub mod adapter;
pub mod dbc;
pub mod device_file;
pub mod expectations;
pub mod filter;
pub mod observe;
pub mod pipeline;
pub mod profile;
pub mod reader;
pub mod session;
pub mod wire;

pub use adapter::{slcan, socketcand};
pub use dbc::dbc;
pub use device_file::device_file;
pub use expectations::expectations;
pub use filter::filter;
pub use pipeline::any;
pub use profile::profile;
pub use session::{devices, session};
pub use wire::{
    emcy, error_control, error_frame, isotp, j1939, lss, nmt, sdo, sync, time, trouble_codes, uds,
};

/// A target: its name and its function.
pub type Target = (&'static str, fn(&[u8]));

/// All targets but readers, which [`reader::holds_its_contract`] is for: by the names of their formats.
pub const TARGETS: &[Target] = &[
    ("slcan", slcan),
    ("socketcand", socketcand),
    ("any", any),
    ("nmt", nmt),
    ("error_control", error_control),
    ("trouble_codes", trouble_codes),
    ("sync", sync),
    ("time", time),
    ("emcy", emcy),
    ("sdo", sdo),
    ("lss", lss),
    ("isotp", isotp),
    ("uds", uds),
    ("j1939", j1939),
    ("error_frame", error_frame),
    ("session", session),
    ("devices", devices),
    ("device_file", device_file),
    ("dbc", dbc),
    ("profile", profile),
    ("expectations", expectations),
    ("filter", filter),
];
