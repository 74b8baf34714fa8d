//! The device file a device was made of.

use std::sync::Arc;

use crate::profile::device_file::DeviceFile;

/// The device file a device was made of, wholly or in part.
#[derive(Debug, Clone)]
pub struct Import {
    /// The file.
    pub file: Arc<DeviceFile>,
    /// Place of its objects among the dictionary's layers; the first if nothing else describes the device.
    pub(in crate::profile) layer: usize,
}
