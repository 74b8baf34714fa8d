//! Object values of a node, and identifiers in COB-ID objects.

mod cob_id;
mod store;

pub(in crate::session) use cob_id::{INVALID, cob_identifier, nonzero_identifier, predefined_identifier};
pub use store::{ObjectStore, OriginKind, PendingValue, StoredObject, StoredOrigin};
