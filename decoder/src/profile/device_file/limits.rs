//! Limits for device files.

/// Max entries per file. Large real devices have about 1,200; `CompactSubObj=254` in every object would
/// define 16 million.
pub const MOST_ENTRIES: usize = 1 << 16;

/// Max length of a name or value, in bytes. CiA 306-1 limits a line to 255 characters.
pub(crate) const LONGEST_VALUE: usize = 1024;

/// Max problems listed; one more states the number of the others.
pub const MOST_PROBLEMS: usize = 1000;
