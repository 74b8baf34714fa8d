//! Devices of which only the standard is known.

use std::sync::{Arc, OnceLock};

use super::catalogue::Catalogue;
use super::device::Device;

/// A device of which nothing is known but that it is one: CiA 301.
pub fn plain_device() -> &'static Arc<Device> {
    static PLAIN: OnceLock<Arc<Device>> = OnceLock::new();
    PLAIN.get_or_init(|| {
        // A test parses every embedded file, so the empty device is never taken.
        Catalogue::default().device("cia301").unwrap_or_default()
    })
}

/// What ISO 11783 defines for all devices.
pub fn isobus() -> &'static Arc<Device> {
    static STANDARD: OnceLock<Arc<Device>> = OnceLock::new();
    STANDARD.get_or_init(|| Catalogue::default().device("iso11783").unwrap_or_default())
}
