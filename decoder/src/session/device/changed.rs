//! Changed field of a PDO.

use std::sync::Arc;

use crate::profile::{Device, Field, Meaning};
use crate::wire::NodeId;
use crate::wire::canopen::ObjectAddress;

/// A changed field of a PDO with its previous and present value.
pub(super) struct FieldChange<'a> {
    pub(super) id: NodeId,
    pub(super) device: &'a Device,
    pub(super) field: &'a Field,
    pub(super) object: ObjectAddress,
    pub(super) meaning: &'a Arc<Meaning>,
    pub(super) before: Option<u64>,
    pub(super) raw: u64,
}
