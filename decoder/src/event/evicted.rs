//! State that is limited in size.

use strum::IntoStaticStr;

/// State of which the oldest part was evicted at its limit.
#[derive(Debug, Clone, Copy, PartialEq, Eq, IntoStaticStr)]
#[strum(serialize_all = "kebab-case")]
#[non_exhaustive]
pub enum EvictedState {
    /// Values in the object stores.
    Object,
    /// Contradictions about objects.
    Conflict,
    /// Active errors of a node.
    #[strum(serialize = "active error")]
    ActiveError,
    /// Trouble codes in DM1.
    #[strum(serialize = "active trouble code")]
    ActiveTroubleCode,
    /// Trouble codes in DM2.
    #[strum(serialize = "previously active trouble code")]
    PreviousTroubleCode,
    /// Identifiers of 29 bits.
    #[strum(serialize = "29-bit identifier")]
    ExtendedIdentifier,
    /// Identifiers whose meaning was learnt from objects.
    #[strum(serialize = "learnt identifier")]
    LearntIdentifier,
    /// SDO channels other than the default ones.
    #[strum(serialize = "SDO channel")]
    SdoChannel,
    /// Data of SDO transfers that are not complete.
    #[strum(serialize = "data of open SDO transfers")]
    SdoData,
    /// J1939 transfers that are not complete.
    #[strum(serialize = "J1939 transfer")]
    J1939Transfer,
    /// Their data.
    #[strum(serialize = "data of open J1939 transfers")]
    J1939Data,
    /// Fast-packet messages that are not complete.
    #[strum(serialize = "fast packet")]
    FastPacket,
    /// J1939 devices that lost their address.
    #[strum(serialize = "device without address")]
    DeviceWithoutAddress,
    /// Commanded addresses that no device claimed.
    #[strum(serialize = "commanded address")]
    CommandedAddress,
    /// ISO-TP messages that are not complete.
    #[strum(serialize = "open ISO-TP message")]
    IsoTpMessage,
    /// Their data.
    #[strum(serialize = "data of open ISO-TP messages")]
    IsoTpData,
    /// UDS requests without a response.
    #[strum(serialize = "waiting UDS request")]
    UdsRequest,
}

impl EvictedState {
    /// The name used in all output.
    pub fn name(self) -> &'static str {
        self.into()
    }
}
