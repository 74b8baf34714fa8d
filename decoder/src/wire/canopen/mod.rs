//! Messages of CiA 301 and CiA 305, one file per service.

mod address;
pub mod emcy;
pub mod error_control;
pub mod lss;
pub mod nmt;
pub mod sdo;
pub mod sync;
pub mod test_marker;
pub mod time;

use std::fmt;

pub use address::NotAnAddress;

/// NMT state of a node (CiA 301 §7.3.2).
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum NmtState {
    /// Between a reset and the boot-up message; state 0 in the frame.
    Initialising,
    /// State 4.
    Stopped,
    /// State 5.
    Operational,
    /// State 127.
    PreOperational,
}

impl NmtState {
    /// State for the low seven bits of a heartbeat or guarding response; `None` if undefined.
    pub const fn from_code(code: u8) -> Option<Self> {
        match code {
            0 => Some(Self::Initialising),
            4 => Some(Self::Stopped),
            5 => Some(Self::Operational),
            127 => Some(Self::PreOperational),
            _ => None,
        }
    }

    /// Name used in all output.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Initialising => "initialising",
            Self::Stopped => "stopped",
            Self::Operational => "operational",
            Self::PreOperational => "pre-operational",
        }
    }
}

impl fmt::Display for NmtState {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}

/// Address of an object dictionary entry.
#[derive(Debug, Default, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct ObjectAddress {
    /// Index, 0..=0xFFFF.
    pub index: u16,
    /// Sub-index.
    pub sub: u8,
}

impl ObjectAddress {
    /// Creates an address from index and sub-index.
    pub const fn new(index: u16, sub: u8) -> Self {
        Self { index, sub }
    }
}

/// Writes `1018:01`, the form in all text output.
impl fmt::Display for ObjectAddress {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{:04X}:{:02X}", self.index, self.sub)
    }
}
