//! Service of an identifier.

use super::link::UdsLink;
use crate::profile::PdoName;
use crate::wire::NodeId;
use crate::wire::canopen::sdo::SdoSide;
use crate::wire::j1939::J1939Id;

/// Service of two frames per message, as named in the connection set.
pub(in crate::session) const SRDO: &str = "srdo";

/// Service of an identifier, with its node.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(in crate::session) enum IdentifierService {
    /// No known service.
    Unclassified,
    /// Reserved identifier with a name; not decoded.
    Named(&'static str),
    Nmt,
    Sync,
    Time,
    /// EMCY of a node.
    Emcy(NodeId),
    /// PDO of a node.
    Pdo(PdoName, NodeId),
    /// Request or response of an SDO channel.
    Sdo(SdoSide, u16),
    /// NMT error control of a node: heartbeat, boot-up and guarding.
    ErrorControl(NodeId),
    /// LSS; `true` for messages of the master.
    Lss(bool),
    /// Markers of the CiA conformance test tool.
    TestMarker,
    /// A J1939 message.
    J1939(J1939Id),
    /// ISO-TP frame of a link.
    IsoTp(UdsLink),
}

impl IdentifierService {
    /// Whether frames of the identifier become plain frames.
    pub(in crate::session) const fn is_undecoded(self) -> bool {
        matches!(self, Self::Unclassified | Self::Named(_))
    }

    /// Whether messages of the service can be periodic, so that their intervals are kept.
    #[inline]
    pub(in crate::session) const fn is_periodic(self) -> bool {
        matches!(self, Self::Sync | Self::ErrorControl(_) | Self::Pdo(..) | Self::J1939(_))
    }

    /// Whether remote frames go to the service's machine. Only PDOs and error control are requested by remote
    /// frames (CiA 301 §7.2.2, §7.2.8.3.2.1). Frames of unknown services are emitted undecoded.
    pub(in crate::session) const fn has_remote_frames(self) -> bool {
        matches!(
            self,
            Self::Pdo(..) | Self::ErrorControl(_) | Self::J1939(_) | Self::Unclassified | Self::Named(_)
        )
    }
}
