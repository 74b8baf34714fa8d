//! Behaviour of nodes and identifiers that suggests what the user may state: profiles, UDS pairs, SDO channels.

mod sdo_dialogues;
mod signs;
mod unnamed_uds;

pub(in crate::session) use sdo_dialogues::SdoDialogues;
pub use sdo_dialogues::SdoPairHint;
pub(crate) use signs::ProfileSigns;
pub use unnamed_uds::UdsPairHint;
pub(in crate::session) use unnamed_uds::UdsSuspects;
