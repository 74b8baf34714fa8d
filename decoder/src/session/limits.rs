//! Limits of the state per bus. State over a limit is evicted, with an `evicted` event.

/// Data stored per transfer, in bytes.
pub const TRANSFER_DATA_LIMIT: usize = 64 * 1024;
/// Data stored for all open transfers of a bus, in bytes: one limit for SDO, ISO-TP and waiting UDS requests
/// together, and the same limit for J1939.
pub const OPEN_DATA_LIMIT: usize = 4 * 1024 * 1024;
/// SDO channels per bus, and therefore also open SDO transfers.
pub const CHANNEL_LIMIT: usize = 256;
/// Incomplete ISO-TP messages per bus; also open J1939 transfers per bus.
pub const TRANSPORT_LIMIT: usize = 256;
/// UDS requests per bus that wait for a response.
pub const EXCHANGE_LIMIT: usize = 256;
/// Active errors per node; also active, and previously active, trouble codes per J1939 device.
pub const ACTIVE_ERROR_LIMIT: usize = 64;
/// J1939 devices without an address per bus.
pub const ADDRESSLESS_LIMIT: usize = 64;
/// J1939 devices per bus with a commanded address that they have not yet claimed.
pub(crate) const COMMANDED_LIMIT: usize = 64;
/// 29-bit identifiers per bus that have their own state.
pub const EXTENDED_ID_LIMIT: usize = 4096;
/// Objects per node in the store.
pub const OBJECT_LIMIT: usize = 4096;
/// Bytes of all values per node in the store: 127 nodes stay within 8 MiB.
pub(crate) const OBJECT_BYTES_LIMIT: usize = 64 * 1024;
/// Contradictions to the device file reported per node.
pub(crate) const CONFLICT_LIMIT: usize = 256;
/// Bytes per object value in the store.
pub(crate) const OBJECT_VALUE_LIMIT: usize = 1024;

/// Gap in ns that no recorder has: its clock was set.
pub(crate) const CLOCK_SET: i64 = 365 * 86_400_000_000_000;
