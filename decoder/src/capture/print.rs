//! Parts of lines of text captures: digits, and texts that come from outside.
//!
//! All of it appends to a line that is used again and again. Digits are made in arrays of a fixed size,
//! appended whole and cut: that takes no call, a copy of a length that is not known does.

use crate::frame::{Frame, FrameFlags, MAX_DATA};

/// Bytes of a classic frame.
const CLASSIC: usize = 8;

/// A hexadecimal digit, upper case.
const fn digit(nibble: u8) -> u8 {
    let nibble = nibble & 0x0F;
    if nibble > 9 { nibble + (b'A' - 10) } else { nibble + b'0' }
}

const fn pair(byte: u8) -> [u8; 2] {
    [digit(byte >> 4), digit(byte)]
}

/// Appends the first `count` bytes of a text.
#[inline]
pub(super) fn push_start<const N: usize>(line: &mut Vec<u8>, text: &[u8; N], count: usize) {
    let end = line.len().saturating_add(count.min(N));
    line.extend_from_slice(text);
    line.truncate(end);
}

/// Appends payload in pairs of hexadecimal digits.
#[inline]
pub(super) fn push_data(line: &mut Vec<u8>, frame: &Frame) {
    push_bytes(line, frame, pair);
}

/// Appends payload in pairs of hexadecimal digits with a blank before each.
#[inline]
pub(super) fn push_spaced_data(line: &mut Vec<u8>, frame: &Frame) {
    push_bytes(line, frame, |byte| [b' ', digit(byte >> 4), digit(byte)]);
}

/// Appends the payload, `N` characters a byte; a remote frame has none.
#[inline]
fn push_bytes<const N: usize>(line: &mut Vec<u8>, frame: &Frame, text: impl Fn(u8) -> [u8; N]) {
    if frame.flags.contains(FrameFlags::REMOTE) {
        return;
    }
    let length = usize::from(frame.length).min(MAX_DATA);
    let end = line.len().saturating_add(length.saturating_mul(N));
    match frame.bytes.first_chunk::<CLASSIC>() {
        Some(bytes) if length <= CLASSIC => line.extend_from_slice(bytes.map(text).as_flattened()),
        _ => line.extend_from_slice(frame.bytes.map(text).as_flattened()),
    }
    line.truncate(end);
}

/// Appends a number in hexadecimal, three digits or eight.
#[inline]
pub(super) fn push_hex(line: &mut Vec<u8>, number: u32, is_long: bool) {
    let [a, b, c, d] = number.to_be_bytes();
    if is_long {
        line.extend_from_slice([a, b, c, d].map(pair).as_flattened());
    } else {
        line.extend_from_slice(&[digit(c), digit(d >> 4), digit(d)]);
    }
}

/// Appends a number in hexadecimal without leading zeros; returns how many digits it has.
#[inline]
pub(super) fn push_short_hex(line: &mut Vec<u8>, number: u32) -> usize {
    if let (0..16, [.., last]) = (number, number.to_be_bytes()) {
        line.push(digit(last));
        return 1;
    }
    let digits = (u32::BITS - number.leading_zeros()).div_ceil(4);
    let all = number.rotate_right(4 * digits).to_be_bytes().map(pair);
    let count = digits as usize;
    if let Ok(text) = <&[u8; 8]>::try_from(all.as_flattened()) {
        push_start(line, text, count);
    }
    count
}

/// Appends a number in decimal, with blanks before it up to `width`.
#[inline]
pub(super) fn push_decimal(line: &mut Vec<u8>, mut number: u64, width: usize) {
    if number < 10 && width <= 1 {
        line.push(last_digit(number));
        return;
    }
    let mut text = [b' '; 20];
    let mut count = 0;
    for slot in text.iter_mut().rev() {
        *slot = last_digit(number);
        number /= 10;
        count += 1;
        if number == 0 {
            break;
        }
    }
    let start = text.len().saturating_sub(width.max(count));
    line.extend_from_slice(text.get(start..).unwrap_or_default());
}

/// Appends the last `N` decimal digits of a number.
#[inline]
pub(super) fn push_digits<const N: usize>(line: &mut Vec<u8>, mut number: u64) {
    let mut text = [0; N];
    for slot in text.iter_mut().rev() {
        *slot = last_digit(number);
        number /= 10;
    }
    line.extend_from_slice(&text);
}

#[inline]
fn last_digit(number: u64) -> u8 {
    u8::try_from(number % 10).unwrap_or(0) + b'0'
}

/// A text that is made anew only when what it stands for changes.
#[derive(Debug)]
pub(super) struct Kept<K> {
    of: Option<K>,
    text: Vec<u8>,
}

impl<K> Default for Kept<K> {
    fn default() -> Self {
        Self { of: None, text: Vec::new() }
    }
}

impl<K: PartialEq> Kept<K> {
    /// The text of `of`.
    #[inline]
    pub(super) fn text<Q>(&mut self, of: &Q, make: impl FnOnce(&mut Vec<u8>, &Q)) -> &[u8]
    where
        K: std::borrow::Borrow<Q>,
        Q: PartialEq + ToOwned<Owned = K> + ?Sized,
    {
        if self.of.as_ref().is_none_or(|known| known.borrow() != of) {
            self.of = Some(of.to_owned());
            self.text.clear();
            make(&mut self.text, of);
        }
        &self.text
    }
}

/// Numbers of buses, from 1 in order of appearance, for formats without names.
#[derive(Debug, Default)]
pub(super) struct Numbering {
    names: Vec<String>,
    last: usize,
}

impl Numbering {
    /// The number of a bus, and whether it is new.
    #[inline]
    pub(super) fn number(&mut self, bus: &str) -> (usize, bool) {
        if self.names.get(self.last).is_some_and(|name| name == bus) {
            return (self.last + 1, false);
        }
        let known = self.names.iter().position(|name| name == bus);
        self.last = known.unwrap_or(self.names.len());
        if known.is_none() {
            self.names.push(bus.to_owned());
        }
        (self.last + 1, known.is_none())
    }
}

/// Appends a text of lines, each behind a mark: what steers terminals is shown instead.
pub(super) fn push_lines(out: &mut Vec<u8>, mark: &str, text: &str, end: &str) {
    for line in text.lines() {
        out.extend_from_slice(mark.as_bytes());
        push_escaped(out, line);
        out.extend_from_slice(end.as_bytes());
    }
}

/// Appends a text with control characters, and marks that reorder text, as escapes.
pub(super) fn push_escaped(out: &mut Vec<u8>, text: &str) {
    for part in text.split_inclusive(steers) {
        let mut plain = part.chars();
        match plain.next_back() {
            Some(last) if steers(last) => {
                out.extend_from_slice(plain.as_str().as_bytes());
                out.extend_from_slice(last.escape_default().to_string().as_bytes());
            }
            _ => out.extend_from_slice(part.as_bytes()),
        }
    }
}

/// Control characters, and Unicode's bidirectional formatting.
fn steers(c: char) -> bool {
    c.is_control() || matches!(c, '\u{200E}' | '\u{200F}' | '\u{202A}'..='\u{202E}' | '\u{2066}'..='\u{2069}')
}

/// The beginning of a text of at most `limit` bytes, cut between characters.
pub(super) fn cut(text: &str, limit: usize) -> &str {
    text.get(..text.floor_char_boundary(limit)).unwrap_or(text)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::frame::CanId;

    fn made(make: impl FnOnce(&mut Vec<u8>)) -> String {
        let mut line = Vec::new();
        make(&mut line);
        String::from_utf8(line).unwrap()
    }

    #[test]
    fn digits_in_both_bases() {
        assert_eq!(made(|line| push_hex(line, 0x7A, false)), "07A");
        assert_eq!(made(|line| push_hex(line, 0x18FE_CA80, true)), "18FECA80");
        for (number, text) in [(0, "0"), (0xF, "F"), (0x123, "123"), (0x1FFF_FFFF, "1FFFFFFF")] {
            assert_eq!(made(|line| assert_eq!(push_short_hex(line, number), text.len())), text);
        }
        assert_eq!(made(|line| push_decimal(line, 0, 4)), "   0");
        assert_eq!(made(|line| push_decimal(line, 12_345, 4)), "12345");
        assert_eq!(made(|line| push_decimal(line, u64::MAX, 0)), u64::MAX.to_string());
        assert_eq!(made(|line| push_digits::<6>(line, 1_042)), "001042");
    }

    #[test]
    fn payload_of_every_length() {
        let mut frame = Frame::data_frame(CanId::standard(1), &[0x0A, 0xFF, 3, 4, 5, 6, 7, 8, 9]);
        assert_eq!(made(|line| push_data(line, &frame)), "0AFF03040506070809");
        frame.length = 2;
        assert_eq!(made(|line| push_spaced_data(line, &frame)), " 0A FF");
        frame.flags = FrameFlags::REMOTE;
        assert_eq!(made(|line| push_data(line, &frame)), "");
        let long = Frame { length: 255, ..Frame::EMPTY };
        assert_eq!(made(|line| push_data(line, &long)).len(), 128);
    }

    #[test]
    fn texts_are_made_once() {
        let mut kept = Kept::<i64>::default();
        assert_eq!(kept.text(&5, |text, _| text.push(b'a')), b"a");
        assert_eq!(kept.text(&5, |text, _| text.push(b'b')), b"a");
        assert_eq!(kept.text(&6, |text, _| text.push(b'c')), b"c");
    }

    #[test]
    fn buses_count_from_one() {
        let mut buses = Numbering::default();
        let found = ["b", "a", "a", "b"].map(|name| buses.number(name));
        assert_eq!(found, [(1, true), (2, true), (2, false), (1, false)]);
    }

    #[test]
    fn texts_from_outside_stay_in_their_line() {
        let text = "one\r\n\x1b[2J\rtwo\n\u{202e}é";
        assert_eq!(
            made(|line| push_lines(line, "// ", text, "\n")),
            "// one\n// \\u{1b}[2J\\rtwo\n// \\u{202e}é\n"
        );
        assert_eq!((cut("aé", 2), cut("aé", 3), cut("a", 9)), ("a", "aé", "a"));
    }
}
