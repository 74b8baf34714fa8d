//! Lines of a text capture: numbered, without their ends, however long.

use crate::capture::LARGEST_RECORD;

/// Longest line that is looked at; of a longer one only this much is shown to the format.
const LONGEST_LINE: usize = LARGEST_RECORD / 2;

/// Cuts input into lines and counts them.
#[derive(Debug, Clone, Default)]
pub(in crate::capture) struct Lines {
    number: u64,
    skipping: bool,
}

/// What [`Lines::next`] found.
pub(in crate::capture) enum Step<'a> {
    /// A line without its end (`\n`, `\r\n` or `\r`), and how many bytes it takes with it.
    Line(&'a [u8], usize),
    /// Bytes to pass over: the rest of a line that was too long.
    Skip(usize),
    /// More input is needed.
    More,
}

impl Lines {
    /// Number of the line last returned, from 1.
    pub(in crate::capture) fn number(&self) -> u64 {
        self.number
    }

    /// Whether what follows is the rest of a line that was too long.
    pub(in crate::capture) fn is_skipping(&self) -> bool {
        self.skipping
    }

    /// Counts a line that was taken without [`Lines::next`].
    #[inline]
    pub(in crate::capture) fn count_one(&mut self) {
        self.number += 1;
    }

    /// The first line of `input`.
    pub(in crate::capture) fn next<'a>(&mut self, input: &'a [u8], at_end: bool) -> Step<'a> {
        let found = memchr::memchr2(b'\n', b'\r', input);
        // Of `\r\n` the first byte is found; whether the second follows must be known.
        let end = match found.and_then(|end| Some((end, input.get(end..)?))) {
            Some((end, [b'\r', b'\n', ..])) => Some((end, end + 2)),
            Some((_, [b'\r'])) if !at_end => None,
            Some((end, _)) => Some((end, end + 1)),
            None => None,
        };
        match end {
            Some((_, taken)) if self.skipping => {
                self.skipping = false;
                Step::Skip(taken)
            }
            Some((end, taken)) if end <= LONGEST_LINE => {
                self.line(input.get(..end).unwrap_or_default(), taken)
            }
            None if input.is_empty() => Step::More,
            // All but a `\r` that may belong to a `\n` behind it.
            None if self.skipping => match found.unwrap_or(input.len()) {
                0 => Step::More,
                before => Step::Skip(before),
            },
            // Cut at the same byte however much input there is.
            _ if input.len() > LONGEST_LINE => {
                self.skipping = true;
                self.line(input.get(..LONGEST_LINE).unwrap_or_default(), LONGEST_LINE)
            }
            _ if at_end => self.line(input, input.len()),
            _ => Step::More,
        }
    }

    fn line<'a>(&mut self, line: &'a [u8], taken: usize) -> Step<'a> {
        self.number += 1;
        let line = if self.number == 1 { line.strip_prefix(b"\xEF\xBB\xBF").unwrap_or(line) } else { line };
        Step::Line(line, taken)
    }
}

/// The start of a line as it may be shown in a message: printable, at most 60 bytes of it.
pub(in crate::capture) fn excerpt(line: &[u8]) -> String {
    const SHOWN: usize = 60;
    match line.get(..SHOWN) {
        Some(start) if line.len() > SHOWN => format!("\"{}…\"", start.escape_ascii()),
        _ => format!("\"{}\"", line.escape_ascii()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn all(input: &[u8]) -> Vec<String> {
        let mut lines = Lines::default();
        let mut rest = input;
        let mut found = Vec::new();
        loop {
            match lines.next(rest, true) {
                Step::Line(line, taken) => {
                    found.push(String::from_utf8_lossy(line).into_owned());
                    rest = &rest[taken..];
                }
                Step::Skip(taken) => rest = &rest[taken..],
                Step::More => return found,
            }
        }
    }

    #[test]
    fn line_ends_and_byte_order_mark_are_taken_off() {
        assert_eq!(all(b"\xEF\xBB\xBFone\r\ntwo\n\nlast"), ["one", "two", "", "last"]);
        assert_eq!(all(b"one\rtwo\r\rlast\r"), ["one", "two", "", "last"]);
    }

    #[test]
    fn a_line_without_end_waits_for_more_until_it_is_too_long() {
        let mut lines = Lines::default();
        assert!(matches!(lines.next(b"half", false), Step::More));
        let long = vec![b'x'; LONGEST_LINE + 10];
        let Step::Line(line, taken) = lines.next(&long, false) else { panic!("expected a cut line") };
        assert_eq!((line.len(), taken), (LONGEST_LINE, LONGEST_LINE));
        assert!(matches!(lines.next(b"rest of it\nnext\n", false), Step::Skip(11)));
        assert!(matches!(lines.next(b"next\n", false), Step::Line(b"next", 5)));
        assert_eq!(lines.number(), 2);
    }
}
