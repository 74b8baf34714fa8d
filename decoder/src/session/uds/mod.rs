//! ISO-TP and UDS: combines frames to messages, and messages to requests with their responses.
//!
//! ```text
//! IsoTp::on_frame ─▶ wire::isotp ─▶ Reassembly, Transfer ─▶ isotp-transfer
//!                                        └─▶ Uds::on_frame ─▶ wire::uds ─▶ Exchanges ─▶ uds-exchange
//! ```
//!
//! A [`Link`](super::bus::Link) is one direction between two addresses. ISO-TP is detected by frames, not by
//! the protocol of the bus, because UDS is used together with CANopen and J1939.

mod exchange;
mod isotp;
mod obd;
mod pairs;
mod reassembly;
mod requests;
#[cfg(test)]
mod tests;
mod transfer;

pub(in crate::session) use isotp::IsoTpMachine;
pub(in crate::session) use obd::ObdPairs;
pub(in crate::session) use pairs::{PairDecision, PairSearch, has_known_end};
pub(in crate::session) use requests::UdsMachine;
