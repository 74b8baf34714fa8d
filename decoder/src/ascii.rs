//! Appends numbers and data as ASCII, without the formatting machinery of the standard library.
//!
//! Eight digits are computed at a time in one register, appended together, and then truncated to the required
//! length. Appending a fixed number of bytes is a single store; a length known only at run time needs a call.

use bytemuck::must_cast;
use wide::{u8x16, u16x8};

/// The byte, repeated in a register of eight.
const fn repeat_byte(byte: u8) -> u64 {
    u64::from_le_bytes([byte; 8])
}

/// The values of the eight decimal digits of a number below 100,000,000; first digit in the lowest byte.
#[inline]
const fn decimal_digits(value: u64) -> u64 {
    let halves = (value / 10_000) | ((value % 10_000) << 32);
    // Division by multiplication, exact for values below 10,000 and below 100.
    let hundreds = (halves * 5_243) >> 19 & 0x0000_007F_0000_007F;
    let pairs = hundreds | (halves - hundreds * 100) << 16;
    let tens = (pairs * 103) >> 10 & 0x000F_000F_000F_000F;
    tens | (pairs - tens * 10) << 8
}

/// Appends the first `kept` of `bytes`.
#[inline]
pub(crate) fn push_part<const N: usize>(out: &mut Vec<u8>, bytes: [u8; N], kept: usize) {
    let end = out.len() + kept;
    out.extend_from_slice(&bytes);
    out.truncate(end);
}

/// Limit of numbers whose digits fit one register; larger numbers need several registers.
const PART: u64 = 100_000_000;

/// Appends a number in decimal.
#[inline]
pub(crate) fn push_decimal(out: &mut Vec<u8>, value: u64) {
    if value < 10 {
        out.push(b'0' | value.to_le_bytes()[0]);
    } else if value < PART {
        push_short(out, value);
    } else {
        push_long(out, value);
    }
}

/// Appends a number, padded with spaces to `width`, which is at most 32.
#[inline]
pub(crate) fn push_padded(out: &mut Vec<u8>, value: u64, width: usize) {
    if value >= PART {
        push_blanks(out, width, value.ilog10() as usize + 1);
        return push_long(out, value);
    }
    let digits = decimal_digits(value);
    let leading = (digits.trailing_zeros() / 8).min(7);
    let kept = u64::MAX << (leading * 8);
    let text = (digits | repeat_byte(b'0')) & kept | repeat_byte(b' ') & !kept;
    if width > 8 {
        push_blanks(out, width, 8);
    }
    let length = width.clamp(8 - leading as usize, 8);
    push_part(out, (text >> ((8 - length) * 8)).to_le_bytes(), length);
}

/// The digits of a number below 100,000,000, first digit in the lowest byte, and their count; `None` for larger
/// numbers.
#[inline]
pub(crate) fn short_digits(value: u64) -> Option<(u64, usize)> {
    (value < PART).then(|| {
        let (text, length) = format_short(value);
        (u64::from_le_bytes(text), length)
    })
}

/// Appends a number between two texts.
#[inline]
pub(crate) fn push_enclosed(out: &mut Vec<u8>, before: [u8; 2], value: u64, after: [u8; 2]) {
    if value < PART {
        let (text, length) = format_short(value);
        let (text, after) = (u128::from(u64::from_le_bytes(text)), u128::from(u16::from_le_bytes(after)));
        let text = u128::from(u16::from_le_bytes(before)) | (text | after << (length * 8)) << 16;
        push_part(out, text.to_le_bytes(), length + 4);
    } else {
        out.extend_from_slice(&before);
        push_long(out, value);
        out.extend_from_slice(&after);
    }
}

/// Appends a number below [`PART`].
#[inline]
fn push_short(out: &mut Vec<u8>, value: u64) {
    let (text, length) = format_short(value);
    push_part(out, text, length);
}

/// Digits of a number below [`PART`], and their count.
#[inline]
fn format_short(value: u64) -> ([u8; 8], usize) {
    let digits = decimal_digits(value);
    let leading = (digits.trailing_zeros() / 8).min(7);
    (((digits | repeat_byte(b'0')) >> (leading * 8)).to_le_bytes(), 8 - leading as usize)
}

fn push_long(out: &mut Vec<u8>, value: u64) {
    let (high, low) = (value / PART, value % PART);
    if high < PART {
        push_short(out, high);
    } else {
        push_short(out, high / PART);
        push_digits(out, high % PART, 8);
    }
    push_digits(out, low, 8);
}

/// The digits of any number, and the offset of the first digit after leading zeros.
pub(crate) fn long_digits(value: u64) -> ([u8; 24], usize) {
    let parts = [value / PART / PART, value / PART % PART, value % PART];
    let text: [u8; 24] =
        must_cast(parts.map(|part| (decimal_digits(part) | repeat_byte(b'0')).to_le_bytes()));
    let leading = text.iter().take(23).take_while(|digit| **digit == b'0').count();
    (text, leading)
}

/// Appends a signed number.
#[inline]
pub(crate) fn push_integer(out: &mut Vec<u8>, value: i64) {
    if value < 0 {
        out.push(b'-');
    }
    push_decimal(out, value.unsigned_abs());
}

/// Appends a number with at most eight decimals, without trailing zeros.
#[inline]
pub(crate) fn push_fixed(out: &mut Vec<u8>, value: i64, digits: u8) {
    let unit = POWERS.get(usize::from(digits)).copied().unwrap_or(PART);
    if value < 0 {
        out.push(b'-');
    }
    let value = value.unsigned_abs();
    push_decimal(out, value / unit);
    let fraction = value % unit;
    if fraction != 0 {
        out.push(b'.');
        // Padded to eight digits, first digit in the lowest byte: trailing zeros are the uppermost bytes.
        let text = decimal_digits(fraction * (PART / unit));
        let kept = 8 - text.leading_zeros() as usize / 8;
        push_part(out, (text | repeat_byte(b'0')).to_le_bytes(), kept);
    }
}

/// Powers of ten.
const POWERS: [u64; 9] = [1, 10, 100, 1_000, 10_000, 100_000, 1_000_000, 10_000_000, PART];

/// The digits of a number below 10^9, with leading zeros.
#[inline]
pub(crate) fn nine_digits(value: u64) -> [u8; 9] {
    let mut text = [b'0' | (value % 10).to_le_bytes()[0]; 9];
    if let Some(first) = text.first_chunk_mut() {
        *first = (decimal_digits(value / 10 % PART) | repeat_byte(b'0')).to_le_bytes();
    }
    text
}

/// Appends a number below 10^9 with nine digits.
#[inline]
pub(crate) fn push_nine(out: &mut Vec<u8>, value: u64) {
    out.extend_from_slice(&nine_digits(value));
}

/// Appends the last `digits` digits, at most eight, of a number below 100,000,000.
#[inline]
pub(crate) fn push_digits(out: &mut Vec<u8>, value: u64, digits: usize) {
    let digits = digits.clamp(1, 8);
    let text = (decimal_digits(value % PART) | repeat_byte(b'0')) >> ((8 - digits) * 8);
    push_part(out, text.to_le_bytes(), digits);
}

/// Appends a time in nanoseconds as seconds with nine decimals.
#[inline]
pub(crate) fn push_seconds(out: &mut Vec<u8>, nanoseconds: i64) {
    if nanoseconds < 0 {
        out.push(b'-');
    }
    let nanoseconds = nanoseconds.unsigned_abs();
    push_decimal(out, nanoseconds / 1_000_000_000);
    out.push(b'.');
    push_nine(out, nanoseconds % 1_000_000_000);
}

/// Pairs of upper-case hex digits of eight bytes.
#[inline]
fn hex_pairs(bytes: [u8; 8]) -> [u8; 16] {
    let bytes: u8x16 = must_cast([bytes, [0; 8]]);
    let low = bytes & u8x16::splat(0x0F);
    let words: u16x8 = must_cast(bytes);
    let high = must_cast::<_, u8x16>(words >> 4) & u8x16::splat(0x0F);
    let nibbles = u8x16::unpack_low(high, low);
    let is_letter = nibbles.simd_gt(u8x16::splat(9));
    (nibbles + u8x16::splat(b'0') + (is_letter & u8x16::splat(b'A' - b'0' - 10))).to_array()
}

/// Appends the first `kept` bytes as pairs of hex digits.
#[inline]
pub(crate) fn push_hex_word(out: &mut Vec<u8>, bytes: [u8; 8], kept: usize) {
    push_part(out, hex_pairs(bytes), kept * 2);
}

/// Appends bytes as pairs of hex digits.
pub(crate) fn push_hex(out: &mut Vec<u8>, bytes: &[u8]) {
    let (words, rest) = bytes.as_chunks::<8>();
    for word in words {
        push_hex_word(out, *word, 8);
    }
    if !rest.is_empty() {
        push_hex_word(out, pad_to_eight(rest), rest.len());
    }
}

/// Appends the first `kept` bytes as pairs of hex digits, each after a space.
#[inline]
pub(crate) fn push_spaced_word(out: &mut Vec<u8>, bytes: [u8; 8], kept: usize) {
    let mut text = [b' '; 24];
    let digits = hex_pairs(bytes);
    for ([_, high, low], pair) in text.as_chunks_mut().0.iter_mut().zip(digits.as_chunks().0) {
        [*high, *low] = *pair;
    }
    push_part(out, text, kept * 3);
}

/// Appends bytes as pairs of hex digits, each after a space.
#[inline]
pub(crate) fn push_spaced_hex(out: &mut Vec<u8>, bytes: &[u8]) {
    for chunk in bytes.chunks(8) {
        push_spaced_word(out, pad_to_eight(chunk), chunk.len());
    }
}

/// Appends spaces up to `width`, after `there` existing characters.
#[inline]
pub(crate) fn push_blanks(out: &mut Vec<u8>, width: usize, there: usize) {
    const MOST: usize = 32;
    push_part(out, [b' '; MOST], width.saturating_sub(there).min(MOST));
}

/// Appends a number with at least `digits` hex digits, at most eight.
#[inline]
pub(crate) fn push_code(out: &mut Vec<u8>, value: u32, digits: usize) {
    let needed = (8 - value.leading_zeros() as usize / 4).max(digits.clamp(1, 8));
    // Shift out the leading zeros, so that the first digit is the highest.
    let aligned = u64::from(value) << (64 - 4 * needed);
    let [text @ .., _, _, _, _, _, _, _, _] = hex_pairs(aligned.to_be_bytes());
    push_part(out, text, needed);
}

/// The bytes, padded with zeros to eight.
#[inline]
pub(crate) fn pad_to_eight(bytes: &[u8]) -> [u8; 8] {
    let mut word = [0; 8];
    for (target, byte) in word.iter_mut().zip(bytes) {
        *target = *byte;
    }
    word
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn text(write: impl FnOnce(&mut Vec<u8>)) -> String {
        let mut out = b"before ".to_vec();
        write(&mut out);
        String::from_utf8(out).unwrap().split_off(7)
    }

    #[test]
    fn numbers_at_their_limits() {
        for value in [0, 7, 10, 99_999_999, 100_000_000, 10_000_000_000_000_000, u64::MAX] {
            assert_eq!(text(|out| push_decimal(out, value)), value.to_string());
        }
        assert_eq!(text(|out| push_integer(out, i64::MIN)), i64::MIN.to_string());
        assert_eq!(text(|out| push_seconds(out, -1)), "-0.000000001");
    }

    proptest! {
        #![proptest_config(ProptestConfig { failure_persistence: None, ..ProptestConfig::default() })]

        #[test]
        fn everything_reads_as_the_standard_library_writes_it(
            value: u64, shift in 0_u32..64, code: u32, digits in 1_usize..=8, bytes: Vec<u8>,
        ) {
            let value = value >> shift;
            prop_assert_eq!(text(|out| push_decimal(out, value)), value.to_string());
            let signed = value.cast_signed();
            prop_assert_eq!(text(|out| push_integer(out, signed)), signed.to_string());
            let seconds = crate::frame::Timestamp(signed).to_string();
            prop_assert_eq!(text(|out| push_seconds(out, signed)), seconds);
            prop_assert_eq!(text(|out| push_code(out, code, digits)), format!("{code:0digits$X}"));
            let hex: Vec<String> = bytes.iter().map(|byte| format!("{byte:02X}")).collect();
            prop_assert_eq!(text(|out| push_hex(out, &bytes)), hex.concat());
            let spaced = hex.iter().fold(String::new(), |all, pair| all + " " + pair);
            prop_assert_eq!(text(|out| push_spaced_hex(out, &bytes)), spaced);
            let width = digits * 3;
            prop_assert_eq!(text(|out| push_padded(out, value, width)), format!("{value:width$}"));
            let few = short_digits(value).map(|(few, length)| text(|out| push_part(out, few.to_le_bytes(), length)));
            prop_assert_eq!(few, (value < 100_000_000).then(|| value.to_string()));
            let (digits_of_value, first) = long_digits(value);
            prop_assert_eq!(text(|out| out.extend_from_slice(&digits_of_value[first..])), value.to_string());
            prop_assert_eq!(text(|out| push_enclosed(out, *b" {", value, *b"}\n")), format!(" {{{value}}}\n"));
            let digits_behind = u8::try_from(digits).unwrap();
            let quantity = signed % 1_000_000_000_000_000;
            #[expect(clippy::cast_precision_loss, reason = "below 10^15")]
            let real = quantity as f64 / 10_f64.powi(i32::from(digits_behind));
            prop_assert_eq!(text(|out| push_fixed(out, quantity, digits_behind)), (real + 0.0).to_string());
            let last = value % 10_u64.pow(u32::try_from(digits).unwrap());
            prop_assert_eq!(text(|out| push_digits(out, last, digits)), format!("{last:0digits$}"));
        }
    }
}
