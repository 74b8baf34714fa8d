//! Metadata keys of channels in files written by cobscope.

/// Library name in the header of files written by cobscope.
pub(super) const LIBRARY: &str = "cobscope";

/// Marks a channel of cobscope; the value is its content: [`FRAMES`] or [`NOTICES`].
pub(super) const COBSCOPE: &str = "cobscope";
#[cfg(feature = "mcap")]
pub(super) const FRAMES: &str = "frames";
pub(super) const NOTICES: &str = "notices";
/// Bus name.
pub(super) const BUS: &str = "bus";
/// `rx` or `tx`; absent if unknown.
pub(super) const DIRECTION: &str = "direction";
/// `1` if the bit rate was switched, or if the transmitter was error passive.
pub(super) const SWITCHED: &str = "brs";
pub(super) const PASSIVE: &str = "esi";
/// `none` if the frames have no time.
pub(super) const TIME: &str = "time";
