//! SAE J1939 and ISO 11783: what identifiers and payloads say by themselves.
//!
//! ```text
//! 29-bit identifier (J1939-21 §5.2)
//!  28..26    25   24   23..16  15..8   7..0
//!  priority  EDP  DP   PF      PS      source address
//!                      < 240   PS is the destination: PDU1, the PGN ends in 00
//!                      ≥ 240   PS belongs to the PGN: PDU2, to all
//! ```

mod diagnostics;
mod id;
mod message;
mod name;
mod transport;

pub use diagnostics::{Lamps, Lit, ReportedDtc, SpnConversion, TroubleCodes};
pub use id::{ALL, J1939Id, NO_ADDRESS, Pgn};
pub use message::{Acknowledgement, commanded_address, request};
pub use name::{Name, NameFields};
pub use transport::{ETP_SIZES, Management, PACKET_SIZE, TP_SIZES, management, packet, packets_of};
