//! Limits on what is read of a device file.

/// Entries that are read of one file. The largest of real devices has some 1,200; `CompactSubObj=254`
/// under every index would ask for 16 million.
pub const MOST_ENTRIES: usize = 1 << 16;

/// Bytes of one name or value. CiA 306-1 ends a line at 255 characters.
pub(crate) const LONGEST_VALUE: usize = 1024;

/// Problems that are told apart; one more line says how many others there are.
pub const MOST_PROBLEMS: usize = 1000;
