//! Changed field of a PDO.

use std::sync::Arc;

use crate::profile::{DeviceProfile, ObjectMeaning, SignalField};
use crate::wire::NodeId;
use crate::wire::canopen::ObjectAddress;

/// A changed field of a PDO with its previous and present value.
pub(super) struct FieldChange<'a> {
    pub(super) id: NodeId,
    pub(super) device: &'a DeviceProfile,
    pub(super) field: &'a SignalField,
    pub(super) object: ObjectAddress,
    pub(super) meaning: &'a Arc<ObjectMeaning>,
    pub(super) before: Option<u64>,
    pub(super) raw: u64,
}
