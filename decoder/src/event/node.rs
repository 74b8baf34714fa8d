//! Events of a node's life: states, boot-up, silence, errors.

use crate::frame::CanId;
use crate::wire::canopen::NmtState;
use crate::wire::canopen::emcy::ByteOrder;

/// Why a node's state is what it is.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum StateCause {
    /// An NMT command, unconfirmed as all of them are.
    Command,
    /// A boot-up message.
    BootUp,
    /// A heartbeat.
    Heartbeat,
    /// A guarding reply.
    GuardReply,
    /// A PDO the node sent: only operational nodes do.
    Pdo,
    /// Life guarding or heartbeat consumer fired, as an EMCY tells.
    LifeGuard,
    /// Another EMCY, by the device's manual.
    Emcy,
}

impl StateCause {
    /// The name used in all output.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Command => "nmt-command",
            Self::BootUp => "boot-up",
            Self::Heartbeat => "heartbeat",
            Self::GuardReply => "guard-reply",
            Self::Pdo => "pdo",
            Self::LifeGuard => "life-guard",
            Self::Emcy => "emcy",
        }
    }
}

/// How sure a state is (CiA 301 NMT commands are never acknowledged).
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Certainty {
    /// Follows from a command.
    Presumed,
    /// The node said or showed it.
    Confirmed,
}

/// A change of NMT state.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[non_exhaustive]
pub struct StateChange {
    /// State before, if known.
    pub from: Option<NmtState>,
    /// State now.
    pub to: NmtState,
    /// What tells it.
    pub cause: StateCause,
    /// Frame of the command or message that caused it.
    pub cause_frame: u64,
    /// Nanoseconds since the command that this confirms.
    pub after: Option<i64>,
    /// How sure it is.
    pub certainty: Certainty,
}

/// Why a node started.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum BootCause {
    /// An NMT reset since its last frame.
    Commanded {
        /// Frame of the command.
        frame: u64,
    },
    /// No reset was commanded: power-on or a restart of its own.
    PresumedPowerOn {
        /// What makes a power-on likelier than a restart of this node alone.
        sign: Option<PowerSign>,
    },
}

/// What speaks for a power-on of the machine. A trace never shows one.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[non_exhaustive]
pub enum PowerSign {
    /// Another node booted uncommanded just before.
    OtherNodesToo,
    /// The bus had been silent until just before.
    BusWasSilent,
}

impl PowerSign {
    /// The name used in all output.
    pub const fn name(self) -> &'static str {
        match self {
            Self::OtherNodesToo => "other-nodes-too",
            Self::BusWasSilent => "bus-was-silent",
        }
    }

    /// The same for people.
    pub const fn words(self) -> &'static str {
        match self {
            Self::OtherNodesToo => "other nodes booted too",
            Self::BusWasSilent => "the bus was silent before",
        }
    }
}

/// A node's silence.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[non_exhaustive]
pub struct Silence {
    /// Last frame heard from it.
    pub last_frame: u64,
    /// Its state then.
    pub last_state: Option<NmtState>,
    /// Its last error code other than 0.
    pub last_emcy: Option<u16>,
    /// Nanoseconds without a sign.
    pub gap: i64,
    /// What was expected.
    pub monitored_by: &'static str,
}

/// What an EMCY does to the set of active errors.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[non_exhaustive]
pub enum EmcyAction {
    /// An error appeared, or appeared again.
    Raised,
    /// Code 0 with errors left in the register.
    Cleared,
    /// Code 0 with an empty register.
    AllCleared,
    /// No data: started without error (CiA 301 version 3).
    Ready,
    /// Code 0 as one of the first messages after boot-up.
    NoErrorAtBoot,
}

impl EmcyAction {
    /// The name used in all output.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Raised => "raised",
            Self::Cleared => "cleared",
            Self::AllCleared => "all-cleared",
            Self::Ready => "ready",
            Self::NoErrorAtBoot => "no-error-at-boot",
        }
    }
}

/// An emergency message.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[non_exhaustive]
pub struct Emergency {
    /// Its identifier.
    pub cob_id: CanId,
    /// Code in the byte order in force; `None` for "ready".
    pub code: Option<u16>,
    /// Error register, object 0x1001.
    pub register: Option<u8>,
    /// Manufacturer-specific bytes.
    pub vendor: [u8; 5],
    /// How many of them were sent.
    pub vendor_length: u8,
    /// What it does.
    pub action: EmcyAction,
    /// Active errors after it.
    pub active: u16,
    /// Byte order used.
    pub byte_order: ByteOrder,
    /// What tells the byte order: `standard`, `profile`, `wire`, `learnt`, `presumed`.
    pub byte_order_by: &'static str,
    /// The code the other byte order would give, where only that is a code of the device.
    pub alternative: Option<u16>,
    /// Of a device without boot-up message: this message shows its start, and why it started.
    pub boot: Option<BootCause>,
}
