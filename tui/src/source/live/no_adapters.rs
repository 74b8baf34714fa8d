//! Replacement for the drivers of vendors in a build without them.

use anyhow::bail;

use super::{AdapterVendor, Source};

/// Always fails.
///
/// # Errors
/// Always.
pub fn open(_vendor: AdapterVendor, channel: &str, _bit_rate: u32) -> anyhow::Result<Box<dyn Source>> {
    bail!("{channel}: this build cannot open adapters with the driver of a vendor (feature adapters)")
}

/// Always empty.
pub fn all() -> Vec<String> {
    Vec::new()
}
