//! Replacement for CAN interfaces on systems other than Linux and in builds without them.

use anyhow::bail;

use super::spec::InterfaceSpec;
use super::{BusStatus, LiveSource};

/// Always fails, with a message about the alternatives.
///
/// # Errors
/// Always.
pub fn open(specs: &[InterfaceSpec]) -> anyhow::Result<Box<dyn LiveSource>> {
    let name = specs.first().map_or("", |spec| &spec.name);
    bail!(
        "{name}: this build cannot open CAN interfaces (needs Linux and feature socketcan). Adapters: pcan:USB1@500k, \
         kvaser:0@500k, slcan:PORT@500k; a bus of another machine: ssh MACHINE candump -L any | cobscope live -"
    )
}

/// Always empty.
pub fn all() -> Vec<BusStatus> {
    Vec::new()
}

/// State of the interface without a remedy.
pub fn how_to_bring_up(name: &str, _bit_rate: Option<u32>) -> String {
    format!("{name} is down")
}
