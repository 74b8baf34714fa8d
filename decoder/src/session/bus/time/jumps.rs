//! Bytes of a payload that jump to one value for a single frame, as a sensor with a loose contact does.

/// Upper bits of each byte: a change of them is a jump, a change below them is noise.
pub(super) const JUMPING: u64 = 0xE0E0_E0E0_E0E0_E0E0;

/// Jumps after which a byte is noise, if most of them do not return.
const NOISE: u16 = 48;

/// Jumps of a value that show it.
const SHOWN: u32 = 4;

/// Frames before the first jump.
const CLEAN: u32 = 30;

/// Small changes of the byte that is part of a slow value.
const STEPS: u16 = 3;

/// Bytes of a payload.
const BYTES: usize = 8;

/// Jumps of each byte.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct ByteJumps {
    /// Upper bits of bytes that change all the time.
    noisy: u64,
    bytes: [JumpingByte; BYTES],
}

/// Jumps of one byte.
#[derive(Debug, Clone, Copy, Default)]
struct JumpingByte {
    jumps: u16,
    /// Jumps to `target` that lasted a single frame.
    returns: u16,
    /// Changes below a jump, while other bytes jump: the byte is part of a slow value.
    steps: u16,
    /// Value of the first such jump.
    target: u8,
    /// Value before the last jump, and the number of its frame.
    before: u8,
    /// Lower bits of the number of frames at the last jump.
    count: u32,
    /// First return: monotonic time in ns, and frame.
    first: (i64, u64),
    /// Number of frames before it.
    clean: u32,
}

/// A value that jumps.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct ValueJumps {
    /// Index of the byte that shows it, from 0.
    pub(crate) byte: usize,
    /// Number of single frames with the value `target` in this byte.
    pub(crate) count: u16,
    pub(crate) target: u8,
    /// The first one: monotonic time in ns, and frame.
    pub(crate) first: (i64, u64),
}

impl ByteJumps {
    /// Bits of a change that jump.
    #[inline]
    pub(super) fn jumping_bits(&self, change: u64) -> u64 {
        change & JUMPING & !self.noisy
    }

    /// Registers a payload with jumping bytes; `count` is the number of frames before it.
    #[cold]
    pub(super) fn note_jump(&mut self, (payload, change): (u64, u64), count: u32, at: (i64, u64)) {
        let jumping = self.jumping_bits(change);
        let (now, last) = (payload.to_le_bytes(), (payload ^ change).to_le_bytes());
        let mut noisy = self.noisy.to_le_bytes();
        let bits = jumping.to_le_bytes();
        let places = self.bytes.iter_mut().zip(noisy.iter_mut()).zip(bits).zip(now.into_iter().zip(last));
        for (((byte, noisy), bits), (now, last)) in places {
            if bits == 0 {
                byte.steps = byte.steps.saturating_add(u16::from(now != last));
                continue;
            }
            let is_back =
                byte.jumps > 0 && count == byte.count.wrapping_add(1) && now.abs_diff(byte.before) <= 2;
            if is_back && (byte.returns == 0 || byte.target == last) {
                if byte.returns == 0 {
                    (byte.target, byte.first, byte.clean) = (last, at, count);
                }
                byte.returns = byte.returns.saturating_add(1);
            }
            byte.jumps = byte.jumps.saturating_add(1);
            (byte.before, byte.count) = (last, count);
            if byte.jumps >= NOISE && byte.returns.saturating_mul(3) < byte.jumps {
                *noisy = bits | 0xE0;
            }
        }
        self.noisy = u64::from_le_bytes(noisy);
    }

    /// A value of which a byte jumps: the byte next to it changes all the time, and nearly all jumps return.
    pub(crate) fn value(&self, changes: u32, frames: u32) -> Option<ValueJumps> {
        let noisy = self.noisy.to_le_bytes();
        let is_noisy =
            |place: Option<usize>| place.and_then(|place| noisy.get(place)).is_some_and(|bits| *bits != 0);
        let all = self.bytes.iter().enumerate();
        let found = all.filter(|(place, byte)| {
            let has_value = is_noisy(place.checked_sub(1)) || is_noisy(place.checked_add(1));
            let (jumps, returns) = (u32::from(byte.jumps), u32::from(byte.returns));
            // Without a time before it, jumps may be what the message always contains.
            let begins = byte.clean >= CLEAN && byte.clean >= frames / 8;
            has_value
                && begins
                && byte.steps >= STEPS
                && returns >= SHOWN
                && jumps <= returns * 2 + returns / 2 + 2
                && jumps * 2 <= changes
        });
        let best = found.max_by_key(|(_, byte)| byte.returns);
        best.map(|(place, byte)| ValueJumps {
            byte: place,
            count: byte.returns,
            target: byte.target,
            first: byte.first,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Jumps of a payload with a slow value in bytes 0 and 1, little-endian, in which `spike` decides on the frames that jump.
    fn jumps_of(frames: u32, spike: impl Fn(u32) -> bool) -> Option<ValueJumps> {
        let (mut jumps, mut last) = (ByteJumps::default(), 0x3000_u64);
        for count in 1..frames {
            let slow = 0x3000 + u64::from(count * 37 % 0x400);
            let now = if spike(count) { 0x9C40 } else { slow };
            let change = now ^ last;
            if jumps.jumping_bits(change) != 0 {
                jumps.note_jump((now, change), count, (i64::from(count), u64::from(count)));
            }
            last = now;
        }
        jumps.value(frames, frames)
    }

    #[test]
    fn single_frames_with_one_value_are_jumps() {
        let found = jumps_of(600, |count| count > 300 && count % 50 == 0).unwrap();
        assert_eq!((found.byte, found.count, found.target, found.first.1), (1, 5, 0x9C, 351));
    }

    #[test]
    fn noise_steps_and_multiplexed_values_are_none() {
        assert_eq!(jumps_of(600, |_| false), None);
        assert_eq!(jumps_of(600, |count| count > 300), None, "a step");
        assert_eq!(jumps_of(600, |count| count % 2 == 0), None, "two contents in turn");
        assert_eq!(jumps_of(600, |count| count == 400 || count == 500), None, "twice only");
        assert_eq!(jumps_of(600, |count| count % 100 < 3), None, "longer than a frame");
    }
}
