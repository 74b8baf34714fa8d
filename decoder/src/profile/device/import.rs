//! Device file that a device originates from.

use std::sync::Arc;

use crate::profile::device_file::DeviceFile;

/// Device file that describes a device completely or in part.
#[derive(Debug, Clone)]
pub struct DescriptionImport {
    /// The parsed file.
    pub file: Arc<DeviceFile>,
    /// Index of its layer in the dictionary; 0 if only the file describes the device.
    pub(in crate::profile) layer: usize,
}
