//! J1939 and ISOBUS: path of a 29-bit frame that belongs to no other protocol.
//!
//! ```text
//! Frame ─▶ priority, group, source, destination ─▶ request, acknowledgement   one event each
//!                                               ├▶ address claim              table of addresses
//!                                               ├▶ TP.CM, TP.DT, ETP.…        one event per transfer
//!                                               ├▶ group of NMEA 2000         one event per fast packet
//!                                               └▶ any other group            one event per identifier
//!                                      DM1, DM2, commanded address            payload of any length
//! ```

mod cadence;
mod claims;
mod evidence;
mod fast_packets;
mod messages;
mod payload;
mod requests;
mod transport;
mod trouble_codes;

pub(in crate::session) use claims::ClaimMachine;
pub(in crate::session) use evidence::{is_followed, mark_sender_alive};
pub(in crate::session) use fast_packets::FastPackets;
pub(in crate::session) use messages::MessageMachine;
pub(in crate::session) use payload::GroupPayload;
pub(in crate::session) use requests::RequestMachine;
pub(in crate::session) use transport::TransportMachine;
pub(in crate::session) use trouble_codes::TroubleCodeMachine;
