//! Behaviour of nodes and identifiers that suggests what the user may state: profiles, UDS pairs, SDO channels.

mod bus_hints;
mod sdo_dialogues;
mod signs;
mod unnamed_uds;

pub use bus_hints::BusHints;
pub use sdo_dialogues::SdoPairHint;
pub(crate) use signs::ProfileSigns;
pub use unnamed_uds::UdsPairHint;
