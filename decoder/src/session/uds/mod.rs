//! ISO-TP and UDS: frames become messages, messages become requests with their responses.
//!
//! ```text
//! IsoTp::on_frame ─▶ wire::isotp ─▶ Reassembly, Transfer ─▶ isotp-transfer
//!                                        └─▶ Uds::on_frame ─▶ wire::uds ─▶ Exchanges ─▶ uds-exchange
//! ```
//!
//! A [`Link`](super::bus::Link) is one way between two ends. Frames, not the protocol of the bus, show that it is ISO-TP:
//! UDS is used next to CANopen and J1939.

mod exchange;
mod isotp;
mod reassembly;
mod requests;
#[cfg(test)]
mod tests;
mod transfer;

pub(in crate::session) use isotp::IsoTp;
pub(in crate::session) use requests::Uds;
