//! Events of the life cycle of a node: states, boot-up, silence, errors.

use strum::IntoStaticStr;

use crate::frame::CanId;
use crate::profile::device::MonitoringMethod;
use crate::wire::canopen::NmtState;
use crate::wire::canopen::emcy::EmcyByteOrder;

/// Evidence for the NMT state of a node.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum StateCause {
    /// An NMT command, which a node never acknowledges.
    Command,
    /// A boot-up message.
    BootUp,
    /// A heartbeat.
    Heartbeat,
    /// A guarding response.
    GuardReply,
    /// A PDO of the node, which only an operational node sends.
    Pdo,
    /// An EMCY reports that life guarding or the heartbeat consumer expired.
    LifeGuard,
    /// Another EMCY, according to the profile of the device.
    Emcy,
    /// Stated in the bus file, as the state before the first frame.
    BusFile {
        /// The node had reported it by heartbeat or guarding.
        is_reported: bool,
    },
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
            Self::BusFile { .. } => "bus-file",
        }
    }
}

/// Certainty of a state; NMT commands are never acknowledged (CiA 301).
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum StateCertainty {
    /// Follows from a command only.
    Presumed,
    /// Reported or shown by the node itself.
    Confirmed,
}

/// A change of the NMT state.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[non_exhaustive]
pub struct StateChange {
    /// Previous state, if known.
    pub from: Option<NmtState>,
    /// New state.
    pub to: NmtState,
    /// Evidence for the new state.
    pub cause: StateCause,
    /// Frame of the command or message that caused it.
    pub cause_frame: u64,
    /// Time since the command that this confirms, in ns.
    pub after: Option<i64>,
    /// Certainty of the new state.
    pub certainty: StateCertainty,
}

/// Reason for a boot-up.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum BootCause {
    /// An NMT reset since the last frame of the node.
    Commanded {
        /// Frame of the command.
        frame: u64,
    },
    /// No reset was commanded: power cycle or self-reset.
    PresumedPowerOn {
        /// Evidence for a power cycle rather than a self-reset.
        sign: Option<PowerSign>,
    },
}

/// Indirect evidence for a power cycle of the machine, which a capture never shows directly.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[non_exhaustive]
pub enum PowerSign {
    /// Another node booted just before without a command.
    OtherNodesToo,
    /// The bus was silent until just before.
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

    /// Text for people.
    pub const fn words(self) -> &'static str {
        match self {
            Self::OtherNodesToo => "other nodes booted too",
            Self::BusWasSilent => "the bus was silent before",
        }
    }
}

/// Silence of a node.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[non_exhaustive]
pub struct NodeSilence {
    /// Last frame received from the node.
    pub last_frame: u64,
    /// Last state of the node.
    pub last_state: Option<NmtState>,
    /// Last error code other than 0.
    pub last_emcy: Option<u16>,
    /// Time without a frame in ns; without the expected message if `others_continue`.
    pub gap: i64,
    /// Message that was expected.
    pub monitored_by: MonitoringMethod,
    /// Only the expected message is missing: other messages of the node continue.
    pub others_continue: bool,
    /// Frame of the boot-up since which the heartbeat is missing; `None` if there was one after it.
    pub boot_frame: Option<u64>,
}

impl NodeSilence {
    /// Which messages of the node continue, as text.
    pub(crate) const fn others_text(&self) -> &'static str {
        match (self.monitored_by, self.boot_frame) {
            (MonitoringMethod::Heartbeat, None) => "PDOs continue",
            _ => "other messages continue",
        }
    }
}

/// Effect of an EMCY on the set of active errors.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[non_exhaustive]
pub enum EmcyAction {
    /// An error occurred, or occurred again.
    Raised,
    /// Code 0 while the error register is not 0.
    Cleared,
    /// Code 0 while the error register is 0.
    AllCleared,
    /// No data: booted without errors (CiA 301 version 3).
    Ready,
    /// Code 0 in one of the first messages after the boot-up.
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

/// Source of the byte order of EMCY codes.
#[derive(Debug, Clone, Copy, PartialEq, Eq, IntoStaticStr)]
#[strum(serialize_all = "kebab-case")]
pub enum ByteOrderSource {
    /// CiA 301.
    Standard,
    /// Profile of the device.
    Profile,
    /// Object read or written on the bus.
    Wire,
    /// The first code that the profile contains in one byte order only.
    Learnt,
    /// Object read or written before a restart that may have changed it.
    Presumed,
}

impl ByteOrderSource {
    /// The name used in all output.
    pub fn name(self) -> &'static str {
        self.into()
    }
}

/// Source of a new node-ID.
#[derive(Debug, Clone, Copy, PartialEq, Eq, IntoStaticStr)]
#[strum(serialize_all = "kebab-case")]
pub enum NodeIdSource {
    /// LSS of CiA 305.
    Lss,
    /// A UDS service.
    Uds,
    /// A write to an object of the device.
    Object,
    /// Serial number of a node that was silent since.
    #[strum(serialize = "serial number")]
    SerialNumber,
}

impl NodeIdSource {
    /// The name used in all output.
    pub fn name(self) -> &'static str {
        self.into()
    }

    /// Service that set the node-ID, for people; `None` if no service is known.
    pub const fn service(self) -> Option<&'static str> {
        match self {
            Self::Lss => Some("LSS"),
            Self::Uds => Some("UDS"),
            Self::Object => Some("SDO"),
            Self::SerialNumber => None,
        }
    }
}

/// An emergency message.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[non_exhaustive]
pub struct Emergency {
    /// COB-ID of the message.
    pub cob_id: CanId,
    /// Error code in the active byte order; None for [`EmcyAction::Ready`].
    pub code: Option<u16>,
    /// Error register, object 0x1001.
    pub register: Option<u8>,
    /// Manufacturer-specific bytes.
    pub vendor: [u8; 5],
    /// Number of manufacturer-specific bytes sent.
    pub vendor_length: u8,
    /// Effect on the set of active errors.
    pub action: EmcyAction,
    /// Number of active errors after the message.
    pub active: u16,
    /// Active byte order.
    pub byte_order: EmcyByteOrder,
    /// Source of the byte order.
    pub byte_order_by: ByteOrderSource,
    /// Code in the other byte order, if only that one is a code of the device.
    pub alternative: Option<u16>,
    /// Boot reason, if the device sends this message in place of a boot-up message.
    pub boot: Option<BootCause>,
}
