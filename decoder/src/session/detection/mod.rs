//! Detection of the protocol of a bus.

mod canopen;
mod j1939;
mod public_groups;
#[cfg(test)]
mod tests;

pub(in crate::session) use canopen::{CanopenDetection, ProtocolStatus};
pub(in crate::session) use j1939::J1939Detection;
