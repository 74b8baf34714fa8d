//! Layers of [`MalformedPayload`] messages that others distinguish.

use super::MalformedPayload;

impl MalformedPayload {
    /// Whether the message is one of SDO.
    pub(crate) fn is_of_sdo(&self) -> bool {
        self.layer == "sdo"
    }

    /// Whether the message manages a connection of the J1939 transport protocol.
    pub(crate) fn is_of_connection_management(&self) -> bool {
        matches!(self.layer, "tp.cm" | "etp.cm")
    }
}
