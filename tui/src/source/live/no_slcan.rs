//! Replacement for serial adapters in a build without them.

use anyhow::bail;

use super::LiveSource;

/// Always fails.
///
/// # Errors
/// Always.
pub fn open(device: &str, _bit_rate: Option<u32>) -> anyhow::Result<Box<dyn LiveSource>> {
    bail!("{device}: this build cannot open serial adapters (feature serial)")
}
