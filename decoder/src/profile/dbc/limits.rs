//! Limits on what is read of a database.

/// Messages that are read of one file.
pub const MOST_MESSAGES: usize = 1 << 16;

/// Signals that are read of one message: each costs time whenever the message is shown.
pub const MOST_SIGNALS: usize = 4096;

/// Ranges of a multiplexor's values for one signal, after those that touch were joined.
pub const MOST_RANGES: usize = 256;

/// Longest payload in bytes: what a transport protocol of J1939 carries (SAE J1939-21 §5.10).
pub const LONGEST_MESSAGE: u16 = 1785;

/// Bytes of a string that goes over several lines.
pub(crate) const LONGEST_STRING: usize = 1 << 16;

/// Problems that are told apart; one more says how many others there are.
pub const MOST_PROBLEMS: usize = 100;
