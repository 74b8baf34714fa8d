//! CAN interfaces where there are none: another system than Linux, or a build without them.

use anyhow::bail;

use super::spec::InterfaceSpec;
use super::{BusStatus, Source};

/// Always an error, which says what can be done instead.
///
/// # Errors
/// Always.
pub fn open(specs: &[InterfaceSpec]) -> anyhow::Result<Box<dyn Source>> {
    let name = specs.first().map_or("", |spec| &spec.name);
    bail!(
        "{name}: this build cannot open CAN interfaces (SocketCAN is Linux's, feature socketcan). Serial adapters are \
         slcan:DEVICE@BITRATE; a bus of another machine: ssh MACHINE candump -L any | cobscope live -"
    )
}

/// There are none.
pub fn all() -> Vec<BusStatus> {
    Vec::new()
}

/// Nothing can be done about it here.
pub fn how_to_bring_up(name: &str, _bit_rate: Option<u32>) -> String {
    format!("{name} is down")
}
