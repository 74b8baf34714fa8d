//! The program on buses of a real kernel, in a guest of `tests/guest/run`, compared with candump.
//!
//! Tests named `qemu_…` need that guest's devices. Outside a guest all of them are skipped.
#![cfg(all(target_os = "linux", feature = "socketcan"))]
#![expect(
    clippy::unwrap_used,
    clippy::expect_used,
    clippy::panic,
    clippy::indexing_slicing,
    reason = "a test that cannot go on has failed"
)]

mod adapters;
mod ends;
mod filters;
mod frames;
mod gs_usb;
mod harness;
mod links;
mod losses;
mod pair;
mod server;
#[path = "../support/mod.rs"]
mod support;
mod triggers;
