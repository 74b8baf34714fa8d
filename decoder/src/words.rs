//! Helpers for texts.
//!
//! ```text
//! 1 frame   2 frames   0 frames   1 object
//! ```

use std::fmt::Display;

/// Statement on a capture whose dates are local times, without a stated time zone.
pub const UNKNOWN_ZONE: &str = "local time, zone unknown: times read as UTC; --time-zone ZONE states it";

/// Statement on a capture that contains messages without the frames that carried them.
pub const NO_FRAMES: &str = "no frames: messages of ISO-TP, their frames built again with the time of the message; transport not judged";

/// A count with its noun in singular or plural: `1 error`, `2 errors`.
pub fn count_noun<N: Copy + Display + PartialEq + From<u8>>(count: N, what: &str) -> String {
    let ending = if count == N::from(1) { "" } else { "s" };
    format!("{count} {what}{ending}")
}

/// A count with a comma after each group of three digits: `1,204`.
pub fn group_digits(count: u64) -> String {
    let digits = count.to_string();
    let mut text = String::new();
    for (place, digit) in digits.chars().enumerate() {
        if place > 0 && (digits.len() - place).is_multiple_of(3) {
            text.push(',');
        }
        text.push(digit);
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn one_thing_is_not_several() {
        assert_eq!([count_noun(0_u64, "frame"), count_noun(1_usize, "frame")], ["0 frames", "1 frame"]);
        assert_eq!(count_noun(2_u32, "byte"), "2 bytes");
        assert_eq!([group_digits(0), group_digits(800), group_digits(1_204_007)], ["0", "800", "1,204,007"]);
    }
}
