//! Which protocol the traffic of a bus is, by evidence.

mod canopen;
mod j1939;

pub(in crate::session) use canopen::{CanopenDetection, ProtocolStatus};
pub(in crate::session) use j1939::J1939Detection;
