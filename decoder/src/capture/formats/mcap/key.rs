//! Keys of a channel's metadata, in files of this program.

/// Who wrote a file, in files of this program.
pub(super) const LIBRARY: &str = "cobscope";

/// Says that the channel is one of this program, and what for: [`FRAMES`] or [`NOTICES`].
pub(super) const COBSCOPE: &str = "cobscope";
#[cfg(feature = "mcap")]
pub(super) const FRAMES: &str = "frames";
pub(super) const NOTICES: &str = "notices";
/// Name of the bus.
pub(super) const BUS: &str = "bus";
/// `rx` or `tx`, if it is known.
pub(super) const DIRECTION: &str = "direction";
/// `1` where the bit rate was switched, where the sender was error passive.
pub(super) const SWITCHED: &str = "brs";
pub(super) const PASSIVE: &str = "esi";
/// `none` where frames have no time.
pub(super) const TIME: &str = "time";
