//! Replacement for the drivers of vendors in a build without them.

use anyhow::bail;

use super::{AdapterSpec, LiveSource};

/// Always fails.
///
/// # Errors
/// Always.
pub fn open(spec: &AdapterSpec) -> anyhow::Result<Box<dyn LiveSource>> {
    bail!("{}:{}: this build cannot open adapters (feature adapters)", spec.prefix, spec.channel)
}

/// Always empty.
pub fn all() -> Vec<String> {
    Vec::new()
}
