//! Accepted abort codes per situation, from `abort_codes.toml`.

use std::sync::OnceLock;

use serde::Deserialize;

/// Kind of request that a server must refuse, by its identifier in `abort_codes.toml`.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub(in crate::rules::general) enum SituationId {
    /// Write to a read-only or constant object.
    ReadOnlyWritten,
    /// Read of a write-only object.
    WriteOnlyRead,
    /// Access to an object that does not exist.
    NoObject,
    /// Access to a sub-index that does not exist.
    NoSubIndex,
    /// More bytes written than the object has.
    TooLong,
    /// Fewer bytes written than the object has.
    TooShort,
    /// Value above the upper limit written.
    TooHigh,
    /// Value below the lower limit written.
    TooLow,
    /// Request with an unknown command specifier.
    UnknownCommand,
    /// Segment with the toggle bit of the previous segment.
    WrongToggle,
    /// Block transfer requested from a server without block transfer.
    NoBlockTransfer,
    /// Block size outside 1 to 127.
    BlockSize,
    /// Sequence number acknowledged that was not sent.
    BlockSequence,
    /// CRC at the end of a block transfer does not match.
    BlockCrc,
    /// No response from the other side, as required of a stopped node.
    NoAnswer,
    /// Mapping entry written while sub-index 0 is not 0.
    MappingEnabled,
    /// Mapping of a valid PDO written (COB-ID bit 31 = 0).
    MappingOfValidPdo,
    /// More objects or bytes mapped than the PDO can contain.
    MappingTooLarge,
    /// Object mapped that does not exist, is not mappable or has the other direction.
    NotMappable,
    /// PDO parameter not supported, or locked while the PDO is valid.
    PdoParameter,
    /// Restricted CAN-ID written to a COB-ID object.
    RestrictedCanId,
    /// Entry of the error history read while it is empty.
    EmptyHistory,
    /// Value other than 0 written to the number of errors in the history.
    HistoryCount,
    /// Save or restore without its signature.
    WrongSignature,
    /// Reserved SYNC counter overflow value, 1 or 241 to 255, written.
    CounterOverflowValue,
    /// SYNC counter overflow value written while the period is not 0.
    CounterOverflowLocked,
    /// One node entered twice in the heartbeat consumer list.
    SameProducerTwice,
}

/// Kind of request that a server must refuse.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct RefusedRequest {
    /// Identifier.
    pub(super) id: SituationId,
    /// Description of the request.
    pub(super) text: String,
    /// Abort codes that are a correct response.
    pub(super) accepted: Vec<u32>,
    /// Cases of the conformance test with this situation.
    pub(super) ctt: Vec<String>,
    /// Source of the list of codes.
    #[expect(dead_code, reason = "for the reader of the table")]
    class: String,
    #[expect(dead_code, reason = "for the reader of the table")]
    origin: String,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct AbortCodesFile {
    situation: Vec<RefusedRequest>,
}

/// Looks up a situation by its identifier.
pub(super) fn find_situation(id: SituationId) -> Option<&'static RefusedRequest> {
    static TABLE: OnceLock<Vec<RefusedRequest>> = OnceLock::new();
    let table = TABLE.get_or_init(|| {
        let file: Result<AbortCodesFile, _> = toml::from_str(include_str!("abort_codes.toml"));
        file.map(|file| file.situation).unwrap_or_default()
    });
    table.iter().find(|situation| situation.id == id)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_table_is_read() {
        let situation = find_situation(SituationId::ReadOnlyWritten).unwrap();
        assert!(situation.accepted.contains(&0x0601_0002) && situation.ctt.contains(&"2.3".to_owned()));
        assert!(find_situation(SituationId::SameProducerTwice).is_some());
    }
}
