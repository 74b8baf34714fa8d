//! Devices known only by their standard.

use std::sync::{Arc, OnceLock};

use super::catalogue::Catalogue;
use super::device::DeviceProfile;

/// Generic CANopen device, with the objects of CiA 301.
pub fn plain_device() -> &'static Arc<DeviceProfile> {
    static PLAIN: OnceLock<Arc<DeviceProfile>> = OnceLock::new();
    PLAIN.get_or_init(|| {
        // The fallback is unreachable: a test parses every embedded file.
        Catalogue::default().device("cia301").unwrap_or_default()
    })
}

/// Definitions of ISO 11783 for all devices.
pub fn isobus() -> &'static Arc<DeviceProfile> {
    static STANDARD: OnceLock<Arc<DeviceProfile>> = OnceLock::new();
    STANDARD.get_or_init(|| Catalogue::default().device("iso11783").unwrap_or_default())
}
