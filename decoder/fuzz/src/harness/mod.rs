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

/// All targets.
pub const TARGETS: &[Target] = &[
    ("candump", candump),
    ("trc", trc),
    ("asc", asc),
    ("busmaster", busmaster),
    ("crtd", crtd),
    ("carbus", carbus),
    ("microchip", microchip),
    ("canking", canking),
    ("roadster", roadster),
    ("csv", csv),
    ("pcap", pcap),
    ("pcapng", pcapng),
    ("blf", blf),
    ("mdf4", mdf4),
    ("mcap", mcap),
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

/// The candump reader.
pub fn candump(data: &[u8]) {
    reader::holds_its_contract("candump", data);
}

/// The reader of PEAK traces.
pub fn trc(data: &[u8]) {
    reader::holds_its_contract("trc", data);
}

/// The ASC reader.
pub fn asc(data: &[u8]) {
    reader::holds_its_contract("asc", data);
}

/// The reader of BUSMASTER's captures.
pub fn busmaster(data: &[u8]) {
    reader::holds_its_contract("busmaster", data);
}

/// The reader of CRTD.
pub fn crtd(data: &[u8]) {
    reader::holds_its_contract("crtd", data);
}

/// The reader of CARBUS Analyzer traces.
pub fn carbus(data: &[u8]) {
    reader::holds_its_contract("carbus", data);
}

/// The reader of Microchip's CAN BUS Analyzer.
pub fn microchip(data: &[u8]) {
    reader::holds_its_contract("microchip", data);
}

/// The reader of CanKing's text.
pub fn canking(data: &[u8]) {
    reader::holds_its_contract("canking", data);
}

/// The reader of the first OVMS text.
pub fn roadster(data: &[u8]) {
    reader::holds_its_contract("roadster", data);
}

/// The reader of CSV.
pub fn csv(data: &[u8]) {
    reader::holds_its_contract("csv", data);
}

/// The pcap reader.
pub fn pcap(data: &[u8]) {
    reader::holds_its_contract("pcap", data);
}

/// The pcapng reader.
pub fn pcapng(data: &[u8]) {
    reader::holds_its_contract("pcapng", data);
}

/// The BLF reader.
pub fn blf(data: &[u8]) {
    reader::holds_its_contract("blf", data);
}

/// The MCAP reader.
pub fn mcap(data: &[u8]) {
    reader::holds_its_contract("mcap", data);
}

/// The MDF4 reader.
pub fn mdf4(data: &[u8]) {
    reader::holds_its_contract("mdf4", data);
}
