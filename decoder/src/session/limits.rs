//! Limits of what is remembered about a bus. State over a limit is evicted, with an `evicted` event.

/// Data kept of one transfer, in bytes.
pub const TRANSFER_DATA_LIMIT: usize = 64 * 1024;
/// Data kept of all open transfers of a bus in bytes: of SDO, ISO-TP and UDS requests that wait together, and as
/// much again of J1939.
pub const OPEN_DATA_LIMIT: usize = 4 * 1024 * 1024;
/// SDO channels of a bus, so also open transfers.
pub const CHANNEL_LIMIT: usize = 256;
/// ISO-TP messages of a bus that are on their way; also open J1939 transfers.
pub const TRANSPORT_LIMIT: usize = 256;
/// UDS requests of a bus that wait for an answer.
pub const EXCHANGE_LIMIT: usize = 256;
/// Active errors of a node; also active, and previously active, trouble codes of a J1939 device.
pub const ACTIVE_ERROR_LIMIT: usize = 64;
/// J1939 devices of a bus without an address that are remembered.
pub const ADDRESSLESS_LIMIT: usize = 64;
/// J1939 devices of a bus that were commanded to an address they did not claim yet.
pub(crate) const COMMANDED_LIMIT: usize = 64;
/// 29-bit identifiers of a bus that are kept apart.
pub const EXTENDED_ID_LIMIT: usize = 4096;
/// Objects of a node in the store.
pub const OBJECT_LIMIT: usize = 4096;
/// Bytes of all values of a node in the store: 127 nodes stay within 8 MiB.
pub(crate) const OBJECT_BYTES_LIMIT: usize = 64 * 1024;
/// Contradictions to its device file that are told of a node.
pub(crate) const CONFLICT_LIMIT: usize = 256;
/// Bytes of one object's value in the store.
pub(crate) const OBJECT_VALUE_LIMIT: usize = 1024;
