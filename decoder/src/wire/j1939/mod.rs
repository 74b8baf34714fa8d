//! SAE J1939 and ISO 11783: identifiers and payloads, without any state.
//!
//! ```text
//! 29-bit identifier (J1939-21 §5.2)
//!  28..26    25   24   23..16  15..8   7..0
//!  priority  EDP  DP   PF      PS      source address
//!                      < 240   PS is the destination: PDU1, the PGN ends in 00
//!                      ≥ 240   PS belongs to the PGN: PDU2, to all
//! ```

mod diagnostics;
mod fast_packet;
mod id;
mod message;
mod name;
mod transport;

pub use diagnostics::{FlashRate, LampStates, ReportedDtc, SpnConversion, TroubleCodeList};
pub(crate) use fast_packet::{FastFrame, fast_frame, fast_frames_of};
pub(crate) use id::NO_ADDRESS;
pub use id::{ALL, J1939Id, Pgn};
pub use message::{Acknowledgement, commanded_address, parse_request};
pub use name::{J1939Name, NameFields};
pub use transport::{ConnectionManagement, parse_management, parse_packet};
pub(crate) use transport::{ETP_SIZES, PACKET_SIZE, TP_SIZES, packets_of};
