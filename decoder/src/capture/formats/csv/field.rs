//! Fields of a row, quoted as in RFC 4180.

/// A field of a row.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct CsvField<'a> {
    /// Text without the enclosing quotes.
    pub(super) text: &'a [u8],
    /// Whether the text contains doubled quotes.
    pub(super) has_quotes: bool,
}

impl CsvField<'_> {
    /// Copies the text to `room`, with single instead of doubled quotes.
    pub(super) fn unquote_into(self, room: &mut Vec<u8>) {
        room.clear();
        let mut rest = self.text;
        while let Some((byte, behind)) = rest.split_first() {
            room.push(*byte);
            rest = if *byte == b'"' { behind.strip_prefix(b"\"").unwrap_or(behind) } else { behind };
        }
    }
}

/// Iterator over the fields of a row.
#[derive(Debug, Clone)]
pub(super) struct CsvFields<'a> {
    rest: Option<&'a [u8]>,
    separator: u8,
}

impl<'a> CsvFields<'a> {
    /// Iterates over the fields of `row`, separated by `separator`.
    pub(super) fn new(row: &'a [u8], separator: u8) -> Self {
        Self { rest: Some(row), separator }
    }

    /// Length of a quoted field without the enclosing quotes, and whether it contains quotes. A field without
    /// closing quote extends to the end of the row.
    fn quoted_length(text: &[u8]) -> (usize, bool) {
        let (mut at, mut has_quotes) = (0, false);
        loop {
            let Some(quote) = text.get(at..).and_then(|rest| memchr::memchr(b'"', rest)) else {
                return (text.len(), has_quotes);
            };
            at += quote;
            if text.get(at + 1) != Some(&b'"') {
                return (at, has_quotes);
            }
            has_quotes = true;
            at += 2;
        }
    }
}

impl<'a> Iterator for CsvFields<'a> {
    type Item = CsvField<'a>;

    fn next(&mut self) -> Option<CsvField<'a>> {
        let rest = self.rest?;
        let (start, end, has_quotes) = match rest.strip_prefix(b"\"") {
            Some(text) => {
                let (length, has_quotes) = Self::quoted_length(text);
                (1, length + 1, has_quotes)
            }
            None => (0, memchr::memchr(self.separator, rest).unwrap_or(rest.len()), false),
        };
        let behind = rest.get(end..).unwrap_or_default();
        let next = memchr::memchr(self.separator, behind);
        self.rest = next.and_then(|next| behind.get(next + 1..));
        Some(CsvField { text: rest.get(start..end).unwrap_or_default(), has_quotes })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn fields(row: &str) -> Vec<String> {
        let text = |field: CsvField<'_>| {
            let mut room = Vec::new();
            field.unquote_into(&mut room);
            String::from_utf8(room).unwrap()
        };
        CsvFields::new(row.as_bytes(), b',').map(text).collect()
    }

    #[test]
    fn fields_with_and_without_quotes() {
        assert_eq!(fields("a,,\"b,c\",\"d \"\"e\"\"\",f"), ["a", "", "b,c", "d \"e\"", "f"]);
        assert_eq!(fields(""), [""]);
        assert_eq!(fields("a,"), ["a", ""]);
        assert_eq!(fields("\"\",\"\"\"\""), ["", "\""]);
    }

    #[test]
    fn quotes_that_are_not_closed_or_not_at_the_end_do_no_harm() {
        assert_eq!(fields("a,\"b,c"), ["a", "b,c"]);
        assert_eq!(fields("\"a\"x,b"), ["a", "b"]);
        assert_eq!(fields("a\"b,c"), ["a\"b", "c"]);
        assert_eq!(fields("\""), [""]);
    }
}
