//! Splits text captures into numbered lines of any length.

use crate::capture::{Batch, LARGEST_RECORD, Notice};
use crate::words::count_noun;

/// Maximum length of a line in bytes; of a longer line only the start is passed to the format.
const LONGEST_LINE: usize = LARGEST_RECORD / 2;

/// Splits input into lines and counts them.
#[derive(Debug, Clone, Default)]
pub(in crate::capture) struct LineSplitter {
    number: u64,
    skipping: bool,
}

/// Result of [`LineSplitter::next`].
pub(in crate::capture) enum LineStep<'a> {
    /// A line without its end (`\n`, `\r\n` or `\r`), and its size in bytes with the end.
    Line(&'a [u8], usize),
    /// Number of bytes to skip: the rest of a line that was too long.
    Skip(usize),
    /// More input is needed.
    More,
}

impl LineSplitter {
    /// Number of the last returned line, from 1.
    pub(in crate::capture) fn line_number(&self) -> u64 {
        self.number
    }

    /// Whether the next input is the rest of a line that was too long.
    pub(in crate::capture) fn is_skipping(&self) -> bool {
        self.skipping
    }

    /// Counts lines that were read without [`LineSplitter::next`].
    pub(in crate::capture) fn count_lines(&mut self, lines: u64) {
        self.number = self.number.saturating_add(lines);
    }

    /// Returns the first line of `input`.
    pub(in crate::capture) fn next<'a>(&mut self, input: &'a [u8], at_end: bool) -> LineStep<'a> {
        let found = memchr::memchr2(b'\n', b'\r', input);
        // The search finds the `\r` of `\r\n`; the next byte must be available to decide.
        let end = match found.and_then(|end| Some((end, input.get(end..)?))) {
            Some((end, [b'\r', b'\n', ..])) => Some((end, end + 2)),
            Some((_, [b'\r'])) if !at_end => None,
            Some((end, _)) => Some((end, end + 1)),
            None => None,
        };
        match end {
            Some((_, taken)) if self.skipping => {
                self.skipping = false;
                LineStep::Skip(taken)
            }
            Some((end, taken)) if end <= LONGEST_LINE => {
                self.split_line(input.get(..end).unwrap_or_default(), taken)
            }
            None if input.is_empty() => LineStep::More,
            // Keep a final `\r`, which may belong to a following `\n`.
            None if self.skipping => match found.unwrap_or(input.len()) {
                0 => LineStep::More,
                before => LineStep::Skip(before),
            },
            // The cut does not depend on the amount of input.
            _ if input.len() > LONGEST_LINE => {
                self.skipping = true;
                self.split_line(input.get(..LONGEST_LINE).unwrap_or_default(), LONGEST_LINE)
            }
            _ if at_end => self.split_line(input, input.len()),
            _ => LineStep::More,
        }
    }

    fn split_line<'a>(&mut self, line: &'a [u8], taken: usize) -> LineStep<'a> {
        self.number += 1;
        let line = if self.number == 1 { line.strip_prefix(b"\xEF\xBB\xBF").unwrap_or(line) } else { line };
        LineStep::Line(line, taken)
    }
}

/// Kind of lines of text around a capture.
pub(in crate::capture) const AROUND: &str = "of a shell prompt or Markdown";

/// Counts lines without a frame, by their kind.
#[derive(Debug, Clone, Default)]
pub(in crate::capture) struct SkippedLines {
    kinds: Vec<SkippedKind>,
}

#[derive(Debug, Clone)]
struct SkippedKind {
    /// Text after the number of lines: `of a shell prompt`.
    kind: &'static str,
    first: u64,
    count: u64,
}

impl SkippedLines {
    /// Counts the line with this number.
    pub(in crate::capture) fn add_line(&mut self, kind: &'static str, line: u64) {
        match self.kinds.iter_mut().find(|known| known.kind == kind) {
            Some(known) => known.count += 1,
            None => self.kinds.push(SkippedKind { kind, first: line, count: 1 }),
        }
    }

    /// Reports the lines at the end of the capture, once.
    pub(in crate::capture) fn report_lines(&mut self, batch: &mut Batch) {
        for SkippedKind { kind, first, count } in std::mem::take(&mut self.kinds) {
            let text = format!("{} {kind} skipped (first: line {first})", count_noun(count, "line"));
            batch.add_notice(Notice::Assumption(text));
        }
    }
}

/// Whether a line only states that lines were left out: `…`, `...`, `[snip]`.
pub(in crate::capture) fn is_ellipsis(line: &[u8]) -> bool {
    let line = line.trim_ascii();
    if line.len() > 16 {
        return false;
    }
    let inner = |mark: &[u8]| line == mark || (line.len() > mark.len() && has_brackets(line, mark));
    inner("…".as_bytes())
        || inner(b"...")
        || inner(b"....")
        || [&b"snip"[..], b"cut", b"omitted"].iter().any(|word| has_brackets(line, word))
}

/// Whether a line is `word` in brackets.
fn has_brackets(line: &[u8], word: &[u8]) -> bool {
    let ([b'[', inner @ .., b']'] | [b'(', inner @ .., b')'] | [b'<', inner @ .., b'>']) = line else {
        return false;
    };
    inner.trim_ascii().eq_ignore_ascii_case(word)
}

/// Start of a line for use in a message: escaped, at most 60 bytes.
pub(in crate::capture) fn line_excerpt(line: &[u8]) -> String {
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
        let mut lines = LineSplitter::default();
        let mut rest = input;
        let mut found = Vec::new();
        loop {
            match lines.next(rest, true) {
                LineStep::Line(line, taken) => {
                    found.push(String::from_utf8_lossy(line).into_owned());
                    rest = &rest[taken..];
                }
                LineStep::Skip(taken) => rest = &rest[taken..],
                LineStep::More => return found,
            }
        }
    }

    #[test]
    fn line_ends_and_byte_order_mark_are_taken_off() {
        assert_eq!(all(b"\xEF\xBB\xBFone\r\ntwo\n\nlast"), ["one", "two", "", "last"]);
        assert_eq!(all(b"one\rtwo\r\rlast\r"), ["one", "two", "", "last"]);
    }

    #[test]
    fn marks_of_lines_left_out() {
        for line in ["…", " ... ", "....", "[...]", "(…)", "<snip>", "[Cut]"] {
            assert!(is_ellipsis(line.as_bytes()), "{line}");
        }
        for line in ["", ".", "..", "snip", "... 5", "can0 701#05", "[12]"] {
            assert!(!is_ellipsis(line.as_bytes()), "{line}");
        }
    }

    #[test]
    fn a_line_without_end_waits_for_more_until_it_is_too_long() {
        let mut lines = LineSplitter::default();
        assert!(matches!(lines.next(b"half", false), LineStep::More));
        let long = vec![b'x'; LONGEST_LINE + 10];
        let LineStep::Line(line, taken) = lines.next(&long, false) else { panic!("expected a cut line") };
        assert_eq!((line.len(), taken), (LONGEST_LINE, LONGEST_LINE));
        assert!(matches!(lines.next(b"rest of it\nnext\n", false), LineStep::Skip(11)));
        assert!(matches!(lines.next(b"next\n", false), LineStep::Line(b"next", 5)));
        assert_eq!(lines.line_number(), 2);
    }
}
