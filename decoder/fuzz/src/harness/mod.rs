//! Fuzz targets.
//!
//! A target is a function of bytes that panics on an error: in the code under test, or in an assertion here
//! about a property that must hold for all inputs. The same functions replay stored inputs as ordinary tests
//! (`tests/decoder/fuzz_replay.rs` includes this folder).

#![allow(clippy::unwrap_used, clippy::panic, clippy::indexing_slicing, reason = "a failed check panics here")]
#![allow(dead_code, reason = "fuzzer, seed writer and replay each use a part")]

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

/// Name and function of a target.
pub type Target = (&'static str, fn(&[u8]));

/// All targets except capture readers, which use [`reader::holds_its_contract`] with the names of their
/// formats.
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
