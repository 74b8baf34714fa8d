//! Identity of a node: device and node-ID.

mod assign;
mod messages;
mod node_id;

pub(in crate::session) use assign::{assign_device, given_devices, identify_node};
pub(in crate::session) use messages::refresh_messages;
#[cfg(test)]
pub(in crate::session) use node_id::change_node_id;
pub(in crate::session) use node_id::{apply_node_id_change, join_by_serial};
