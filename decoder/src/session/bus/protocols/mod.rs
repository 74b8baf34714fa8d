//! Protocols of a bus: evidence, nodes that the user named, and frames that are not decoded.

mod bus_protocols;
mod named;
mod omissions;

pub use bus_protocols::BusProtocols;
