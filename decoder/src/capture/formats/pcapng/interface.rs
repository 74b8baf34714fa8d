//! Interfaces of a section: link type, name and clock.
//!
//! ```text
//! interface description   0 link type (2)  2 reserved (2)  4 longest packet (4)  8 options
//! option                  0 code (2)  2 length (2)  4 value, padded to a multiple of four
//! ```

use crate::capture::byte_order::ByteOrder;
use crate::capture::link::{CaptureInterface, IdOrder, LinkType};
use crate::frame::{BusIndex, Timestamp};

const IF_NAME: u16 = 2;
const IF_TSRESOL: u16 = 9;
const IF_TSOFFSET: u16 = 14;

/// One interface of the current section.
#[derive(Debug, Clone)]
pub(super) struct PcapngInterface {
    pub(super) channel: CaptureInterface,
    pub(super) clock: InterfaceClock,
    /// Maximum packet size in bytes; 0 means no limit. Needed by simple packets.
    pub(super) longest: u32,
    /// Number of lost packets reported so far.
    pub(super) lost: u64,
}

impl PcapngInterface {
    /// Size of a description before its options, in bytes.
    pub(super) const SHORTEST: usize = 8;

    /// Parses the interface with this number in its section. A description that is too short still counts,
    /// because packets refer to interfaces by number; an invalid option ends only the options.
    pub(super) fn parse_interface(body: &[u8], order: ByteOrder, number: usize) -> Self {
        let link = LinkType::new(u32::from(order.u16(body, 0).unwrap_or(u16::MAX)));
        let longest = order.u32(body, 4).unwrap_or(0);
        let (mut name, mut resolution, mut offset) = (None, None, None);
        for (code, value) in BlockOptions::new(body.get(Self::SHORTEST..).unwrap_or_default(), order) {
            match code {
                IF_NAME => name = name.or(Some(value)),
                IF_TSRESOL => resolution = resolution.or(value.first().copied()),
                IF_TSOFFSET => offset = offset.or(order.u64(value, 0)),
                _ => {}
            }
        }
        // Some writers include a final zero in the name.
        let name = name.and_then(|name| name.split(|byte| *byte == 0).next()).filter(|name| !name.is_empty());
        let channel = CaptureInterface::new(link, order, name, number);
        let clock = InterfaceClock::new(resolution.unwrap_or(6), offset.unwrap_or(0).cast_signed());
        Self { channel, clock, longest, lost: 0 }
    }

    /// Data for the fast path; `None` if the fast path must not read the packets.
    #[inline]
    pub(super) fn fast_path(&self) -> Option<(BusIndex, IdOrder, InterfaceClock)> {
        self.channel.fast_path().map(|(bus, order)| (bus, order, self.clock))
    }
}

/// Iterator over the options of a block, up to the end mark, the end of the block or the first invalid
/// option.
pub(super) struct BlockOptions<'a> {
    rest: &'a [u8],
    order: ByteOrder,
}

impl<'a> BlockOptions<'a> {
    pub(super) fn new(rest: &'a [u8], order: ByteOrder) -> Self {
        Self { rest, order }
    }
}

impl<'a> Iterator for BlockOptions<'a> {
    type Item = (u16, &'a [u8]);

    fn next(&mut self) -> Option<Self::Item> {
        let code = self.order.u16(self.rest, 0).filter(|code| *code != 0)?;
        let length = usize::from(self.order.u16(self.rest, 2)?);
        let value = self.rest.get(4..)?.get(..length)?;
        self.rest = self.rest.get(4 + length.next_multiple_of(4)..).unwrap_or_default();
        Some((code, value))
    }
}

/// Clock of an interface.
#[derive(Debug, Clone, Copy)]
pub(super) struct InterfaceClock {
    resolution: TickResolution,
    /// Nanoseconds added to each time.
    offset: i64,
}

/// Duration of a tick.
#[derive(Debug, Clone, Copy)]
enum TickResolution {
    /// Nanoseconds per tick.
    Whole(u64),
    /// Ticks per nanosecond; `None` if out of range, which makes all times 0.
    Part(Option<u64>),
    /// A tick is 2^-n seconds.
    Halved(u32),
}

const POWER_OF_TWO: u8 = 0x80;

impl InterfaceClock {
    /// Creates a clock from the value of the resolution option and the offset in seconds.
    fn new(resolution: u8, offset: i64) -> Self {
        let exponent = u32::from(resolution & !POWER_OF_TWO);
        let resolution = if resolution & POWER_OF_TWO != 0 {
            TickResolution::Halved(exponent)
        } else if let Some(missing) = 9u32.checked_sub(exponent) {
            TickResolution::Whole(10u64.pow(missing))
        } else {
            TickResolution::Part(10u64.checked_pow(exponent - 9))
        };
        Self { resolution, offset: offset.saturating_mul(1_000_000_000) }
    }

    /// Time of a tick, rounded down and limited to the range of [`Timestamp`].
    #[inline]
    pub(super) fn tick_time(self, high: u32, low: u32) -> Timestamp {
        let ticks = u64::from(high) << 32 | u64::from(low);
        let nanoseconds = match self.resolution {
            TickResolution::Whole(worth) => {
                ticks.checked_mul(worth).and_then(|time| i64::try_from(time).ok())
            }
            TickResolution::Part(count) => {
                i64::try_from(count.and_then(|count| ticks.checked_div(count)).unwrap_or(0)).ok()
            }
            TickResolution::Halved(times) => {
                i64::try_from(u128::from(ticks).saturating_mul(1_000_000_000).checked_shr(times).unwrap_or(0))
                    .ok()
            }
        };
        Timestamp(nanoseconds.unwrap_or(i64::MAX).saturating_add(self.offset))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_resolution_gives_nanoseconds() {
        let time = |resolution: u8, ticks: u64| {
            InterfaceClock::new(resolution, 0).tick_time((ticks >> 32) as u32, (ticks & 0xFFFF_FFFF) as u32).0
        };
        assert_eq!(time(6, 1_700_000_000_123_456), 1_700_000_000_123_456_000);
        assert_eq!(time(9, 1_700_000_000_123_456_789), 1_700_000_000_123_456_789);
        assert_eq!(time(0, 5), 5_000_000_000);
        assert_eq!(time(3, 5), 5_000_000);
        assert_eq!(time(12, 5_999), 5, "picoseconds are cut");
        assert_eq!(time(127, u64::MAX), 0);
        assert_eq!(time(0x8A, 1_536), 1_500_000_000);
        assert_eq!(time(0xBF, 1 << 62), 500_000_000);
        assert_eq!(time(0xFF, u64::MAX), 0);
        assert_eq!(time(0x80, 7), 7_000_000_000);
    }

    #[test]
    fn times_out_of_range_end_at_its_ends() {
        assert_eq!(InterfaceClock::new(0, 0).tick_time(u32::MAX, u32::MAX).0, i64::MAX);
        assert_eq!(InterfaceClock::new(0x80, 0).tick_time(u32::MAX, u32::MAX).0, i64::MAX);
        assert_eq!(InterfaceClock::new(6, i64::MIN).tick_time(0, 0).0, i64::MIN);
        assert_eq!(InterfaceClock::new(6, -2).tick_time(0, 1_000_000).0, -1_000_000_000);
        assert_eq!(InterfaceClock::new(9, i64::MAX).tick_time(u32::MAX, 0).0, i64::MAX);
    }

    #[test]
    fn options_end_at_their_mark_and_at_the_first_that_does_not_fit() {
        let bytes = b"\x02\0\x03\0abc\0\x09\0\x01\0\x09\0\0\0\0\0\0\0\x02\0\x01\0x\0\0\0";
        let found: Vec<_> = BlockOptions::new(bytes, ByteOrder::Little).collect();
        assert_eq!(found, [(2, &b"abc"[..]), (9, &b"\x09"[..])]);
        assert_eq!(BlockOptions::new(b"\x02\0\xFF\xFFabc", ByteOrder::Little).count(), 0);
        assert_eq!(
            BlockOptions::new(b"\x02\0\x03\0abc", ByteOrder::Little).count(),
            1,
            "filling may be missing"
        );
    }
}
