//! Parts of lines in text captures: payload, bus numbers, and escaped text.

use crate::ascii::{push_hex, push_hex_word, push_spaced_hex, push_spaced_word};
use crate::frame::Frame;

/// Maximum data size of a classic frame in bytes.
const CLASSIC: usize = 8;

/// Appends the payload in pairs of hexadecimal digits; a remote frame has none.
#[inline]
pub(in crate::capture) fn push_data(line: &mut Vec<u8>, frame: &Frame) {
    let data = frame.data();
    match frame.bytes.first_chunk() {
        Some(bytes) if data.len() <= CLASSIC => push_hex_word(line, *bytes, data.len()),
        _ => push_hex(line, data),
    }
}

/// Appends the payload in pairs of hexadecimal digits, each after a space; a remote frame has none.
#[inline]
pub(in crate::capture) fn push_spaced_data(line: &mut Vec<u8>, frame: &Frame) {
    let data = frame.data();
    match frame.bytes.first_chunk() {
        Some(bytes) if data.len() <= CLASSIC => push_spaced_word(line, *bytes, data.len()),
        _ => push_spaced_hex(line, data),
    }
}

/// Text that is rebuilt only if its key changes.
#[derive(Debug)]
pub(in crate::capture) struct CachedText<K> {
    of: Option<K>,
    text: Vec<u8>,
}

impl<K> Default for CachedText<K> {
    fn default() -> Self {
        Self { of: None, text: Vec::new() }
    }
}

impl<K: PartialEq> CachedText<K> {
    /// The text of the key `of`; calls `make` to rebuild it.
    #[inline]
    pub(in crate::capture) fn cached_text<Q>(&mut self, of: &Q, make: impl FnOnce(&mut Vec<u8>, &Q)) -> &[u8]
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

/// Bus numbers, from 1 in order of appearance, for formats without bus names.
#[derive(Debug, Default)]
pub(in crate::capture) struct BusNumbering {
    names: Vec<String>,
    last: usize,
}

impl BusNumbering {
    /// The number of a bus, and whether it is new.
    #[inline]
    pub(in crate::capture) fn bus_number(&mut self, bus: &str) -> (usize, bool) {
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

/// Appends the lines of a text, each with `mark` before and `end` after it, with control characters escaped.
pub(in crate::capture) fn push_lines(out: &mut Vec<u8>, mark: &str, text: &str, end: &str) {
    for line in text.lines() {
        out.extend_from_slice(mark.as_bytes());
        push_escaped(out, line);
        out.extend_from_slice(end.as_bytes());
    }
}

/// Appends a text in which control characters and bidirectional formatting are escaped.
pub(in crate::capture) fn push_escaped(out: &mut Vec<u8>, text: &str) {
    for part in text.split_inclusive(is_terminal_control) {
        let mut plain = part.chars();
        match plain.next_back() {
            Some(last) if is_terminal_control(last) => {
                out.extend_from_slice(plain.as_str().as_bytes());
                out.extend_from_slice(last.escape_default().to_string().as_bytes());
            }
            _ => out.extend_from_slice(part.as_bytes()),
        }
    }
}

/// Whether the character is a control character or bidirectional formatting of Unicode.
fn is_terminal_control(c: char) -> bool {
    c.is_control() || matches!(c, '\u{200E}' | '\u{200F}' | '\u{202A}'..='\u{202E}' | '\u{2066}'..='\u{2069}')
}

/// Start of a text, at most `limit` bytes, cut between characters.
pub(in crate::capture) fn cut_text(text: &str, limit: usize) -> &str {
    text.get(..text.floor_char_boundary(limit)).unwrap_or(text)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::frame::{CanId, FrameFlags};

    fn made(make: impl FnOnce(&mut Vec<u8>)) -> String {
        let mut line = Vec::new();
        make(&mut line);
        String::from_utf8(line).unwrap()
    }

    #[test]
    fn payload_of_every_length() {
        let mut frame = Frame::data_frame(CanId::from_standard(1), &[0x0A, 0xFF, 3, 4, 5, 6, 7, 8, 9]);
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
        let mut kept = CachedText::<i64>::default();
        assert_eq!(kept.cached_text(&5, |text, _| text.push(b'a')), b"a");
        assert_eq!(kept.cached_text(&5, |text, _| text.push(b'b')), b"a");
        assert_eq!(kept.cached_text(&6, |text, _| text.push(b'c')), b"c");
    }

    #[test]
    fn buses_count_from_one() {
        let mut buses = BusNumbering::default();
        let found = ["b", "a", "a", "b"].map(|name| buses.bus_number(name));
        assert_eq!(found, [(1, true), (2, true), (2, false), (1, false)]);
    }

    #[test]
    fn texts_from_outside_stay_in_their_line() {
        let text = "one\r\n\x1b[2J\rtwo\n\u{202e}é";
        assert_eq!(
            made(|line| push_lines(line, "// ", text, "\n")),
            "// one\n// \\u{1b}[2J\\rtwo\n// \\u{202e}é\n"
        );
        assert_eq!((cut_text("aé", 2), cut_text("aé", 3), cut_text("a", 9)), ("a", "aé", "a"));
    }
}
