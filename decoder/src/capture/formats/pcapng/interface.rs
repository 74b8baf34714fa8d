//! Interfaces of a section: link type, name and clock.
//!
//! ```text
//! interface description   0 link type (2)  2 reserved (2)  4 longest packet (4)  8 options
//! option                  0 code (2)  2 length (2)  4 value, filled up to a multiple of four
//! ```

use crate::capture::byte_order::ByteOrder;
use crate::capture::link::{Channel, IdOrder, Link};
use crate::frame::{BusIndex, Timestamp};

const IF_NAME: u16 = 2;
const IF_TSRESOL: u16 = 9;
const IF_TSOFFSET: u16 = 14;

/// One interface of the present section.
#[derive(Debug, Clone)]
pub(super) struct Interface {
    pub(super) channel: Channel,
    pub(super) clock: Clock,
    /// Longest packet; 0 for no limit. Simple packets need it.
    pub(super) longest: u32,
    /// Packets it lost, as far as that was said.
    pub(super) lost: u64,
}

impl Interface {
    /// Bytes of a description before its options.
    pub(super) const SHORTEST: usize = 8;

    /// The interface with this number in its section. A description that is too short still counts as
    /// one, because packets say numbers; a broken option ends the options only.
    pub(super) fn read(body: &[u8], order: ByteOrder, number: usize) -> Self {
        let link = Link::new(u32::from(order.u16(body, 0).unwrap_or(u16::MAX)));
        let longest = order.u32(body, 4).unwrap_or(0);
        let (mut name, mut resolution, mut offset) = (None, None, None);
        for (code, value) in Options::new(body.get(Self::SHORTEST..).unwrap_or_default(), order) {
            match code {
                IF_NAME => name = name.or(Some(value)),
                IF_TSRESOL => resolution = resolution.or(value.first().copied()),
                IF_TSOFFSET => offset = offset.or(order.u64(value, 0)),
                _ => {}
            }
        }
        // Some writers count a closing zero into the name.
        let name = name.and_then(|name| name.split(|byte| *byte == 0).next()).filter(|name| !name.is_empty());
        let channel = Channel::new(link, order, name, number);
        let clock = Clock::new(resolution.unwrap_or(6), offset.unwrap_or(0).cast_signed());
        Self { channel, clock, longest, lost: 0 }
    }

    /// What the common path needs, if it may read the packets.
    #[inline]
    pub(super) fn usual(&self) -> Option<(BusIndex, IdOrder, Clock)> {
        self.channel.usual().map(|(bus, order)| (bus, order, self.clock))
    }
}

/// Options of a block, up to the end mark, the end of the block or the first that does not fit.
pub(super) struct Options<'a> {
    rest: &'a [u8],
    order: ByteOrder,
}

impl<'a> Options<'a> {
    pub(super) fn new(rest: &'a [u8], order: ByteOrder) -> Self {
        Self { rest, order }
    }
}

impl<'a> Iterator for Options<'a> {
    type Item = (u16, &'a [u8]);

    fn next(&mut self) -> Option<Self::Item> {
        let code = self.order.u16(self.rest, 0).filter(|code| *code != 0)?;
        let length = usize::from(self.order.u16(self.rest, 2)?);
        let value = self.rest.get(4..)?.get(..length)?;
        self.rest = self.rest.get(4 + length.next_multiple_of(4)..).unwrap_or_default();
        Some((code, value))
    }
}

/// How an interface counts time.
#[derive(Debug, Clone, Copy)]
pub(super) struct Clock {
    resolution: Resolution,
    /// Added to every time.
    offset: i64,
}

/// What one tick is worth.
#[derive(Debug, Clone, Copy)]
enum Resolution {
    /// So many nanoseconds.
    Whole(u64),
    /// So many of them make a nanosecond; more than fit count as never.
    Part(Option<u64>),
    /// A second is so often halved.
    Halved(u32),
}

const POWER_OF_TWO: u8 = 0x80;

impl Clock {
    /// From the option's value and the offset in seconds.
    fn new(resolution: u8, offset: i64) -> Self {
        let exponent = u32::from(resolution & !POWER_OF_TWO);
        let resolution = if resolution & POWER_OF_TWO != 0 {
            Resolution::Halved(exponent)
        } else if let Some(missing) = 9u32.checked_sub(exponent) {
            Resolution::Whole(10u64.pow(missing))
        } else {
            Resolution::Part(10u64.checked_pow(exponent - 9))
        };
        Self { resolution, offset: offset.saturating_mul(1_000_000_000) }
    }

    /// The time of a tick, rounded down; beyond the range of [`Timestamp`] its end.
    #[inline]
    pub(super) fn time(self, high: u32, low: u32) -> Timestamp {
        let ticks = u64::from(high) << 32 | u64::from(low);
        let nanoseconds = match self.resolution {
            Resolution::Whole(worth) => ticks.checked_mul(worth).and_then(|time| i64::try_from(time).ok()),
            Resolution::Part(count) => {
                i64::try_from(count.and_then(|count| ticks.checked_div(count)).unwrap_or(0)).ok()
            }
            Resolution::Halved(times) => {
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
            Clock::new(resolution, 0).time((ticks >> 32) as u32, (ticks & 0xFFFF_FFFF) as u32).0
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
        assert_eq!(Clock::new(0, 0).time(u32::MAX, u32::MAX).0, i64::MAX);
        assert_eq!(Clock::new(0x80, 0).time(u32::MAX, u32::MAX).0, i64::MAX);
        assert_eq!(Clock::new(6, i64::MIN).time(0, 0).0, i64::MIN);
        assert_eq!(Clock::new(6, -2).time(0, 1_000_000).0, -1_000_000_000);
        assert_eq!(Clock::new(9, i64::MAX).time(u32::MAX, 0).0, i64::MAX);
    }

    #[test]
    fn options_end_at_their_mark_and_at_the_first_that_does_not_fit() {
        let bytes = b"\x02\0\x03\0abc\0\x09\0\x01\0\x09\0\0\0\0\0\0\0\x02\0\x01\0x\0\0\0";
        let found: Vec<_> = Options::new(bytes, ByteOrder::Little).collect();
        assert_eq!(found, [(2, &b"abc"[..]), (9, &b"\x09"[..])]);
        assert_eq!(Options::new(b"\x02\0\xFF\xFFabc", ByteOrder::Little).count(), 0);
        assert_eq!(Options::new(b"\x02\0\x03\0abc", ByteOrder::Little).count(), 1, "filling may be missing");
    }
}
