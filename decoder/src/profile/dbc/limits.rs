//! Limits for database files.

/// Max messages per file.
pub const MOST_MESSAGES: usize = 1 << 16;

/// Max signals per message: each one takes time whenever the message is shown.
pub const MOST_SIGNALS: usize = 4096;

/// Max multiplexor ranges per signal, after adjacent ranges are joined.
pub const MOST_RANGES: usize = 256;

/// Max payload in bytes: limit of the J1939 transport protocol (SAE J1939-21 §5.10).
pub const LONGEST_MESSAGE: u16 = 1785;

/// Max length of a string over several lines, in bytes.
pub(crate) const LONGEST_STRING: usize = 1 << 16;

/// Max problems listed; one more states the number of the others.
pub const MOST_PROBLEMS: usize = 100;
