//! J1939 and ISOBUS: the way of a 29-bit frame that nothing else owns.
//!
//! ```text
//! Frame ─▶ priority, group, source, destination ─▶ request, acknowledgement   told as they are
//!                                               ├▶ address claim              the table of addresses
//!                                               ├▶ TP.CM, TP.DT, ETP.…        transport: one event a transfer
//!                                               └▶ any other group            one prepared event an identifier
//!                                      DM1, DM2, commanded address            of any length: what they say
//! ```

mod cadence;
mod claims;
mod evidence;
mod messages;
mod payload;
mod requests;
mod transport;
mod trouble_codes;

pub(in crate::session) use claims::Claims;
pub(in crate::session) use evidence::{is_followed, mark_sender_alive};
pub(in crate::session) use messages::Messages;
pub(in crate::session) use payload::Payload;
pub(in crate::session) use requests::Requests;
pub(in crate::session) use transport::Transports;
pub(in crate::session) use trouble_codes::TroubleCodes;
