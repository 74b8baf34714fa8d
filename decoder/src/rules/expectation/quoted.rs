//! Positions in TOML strings: from an offset in the parsed text to the offset in the file.

/// Offset in the TOML string `raw` (with its quotes) of byte `at` of the parsed text.
pub(super) fn source_offset(raw: &str, at: usize) -> usize {
    let (quote, is_literal) = match raw.as_bytes() {
        [b'\'', b'\'', b'\'', ..] => (3, true),
        [b'"', b'"', b'"', ..] => (3, false),
        [b'\'', ..] => (1, true),
        _ => (1, false),
    };
    let inner = raw.get(quote..).unwrap_or_default();
    // TOML: a line end directly after the opening quotes is not part of the text.
    let skipped = match inner {
        _ if quote == 1 => 0,
        text if text.starts_with("\r\n") => 2,
        text if text.starts_with('\n') => 1,
        _ => 0,
    };
    let start = quote + skipped;
    let mut rest = raw.get(start..).unwrap_or_default();
    if is_literal {
        return (start + at).min(raw.len().saturating_sub(quote)).max(start);
    }
    let mut stated = 0;
    while stated < at && !rest.is_empty() {
        let (read, says) = escape_length(rest);
        stated += says;
        rest = rest.get(read..).unwrap_or_default();
    }
    // TOML: a backslash at the line end produces no text; the position moves to the text after it.
    while let Some(read) =
        Some(escape_length(rest)).and_then(|(read, says)| (says == 0 && read > 0).then_some(read))
    {
        rest = rest.get(read..).unwrap_or_default();
    }
    raw.len().saturating_sub(rest.len().max(quote))
}

/// Length of the first character or escape sequence, and of its text, in bytes.
fn escape_length(text: &str) -> (usize, usize) {
    let mut letters = text.chars();
    match letters.next() {
        None => (0, 0),
        Some('\\') => match letters.next() {
            Some('x') => (4, scalar_length(text, 2)),
            Some('u') => (6, scalar_length(text, 4)),
            Some('U') => (10, scalar_length(text, 8)),
            Some(' ' | '\t' | '\r' | '\n') => {
                let rest = text.get(1..).unwrap_or_default();
                (1 + rest.len() - rest.trim_start_matches([' ', '\t', '\r', '\n']).len(), 0)
            }
            Some(letter) => (1 + letter.len_utf8(), 1),
            None => (1, 1),
        },
        Some(letter) => (letter.len_utf8(), letter.len_utf8()),
    }
}

/// UTF-8 length of the character given by `digits` hexadecimal digits after `\u`.
fn scalar_length(text: &str, digits: usize) -> usize {
    let number = text.get(2..2 + digits).and_then(|digits| u32::from_str_radix(digits, 16).ok());
    number.and_then(char::from_u32).map_or(1, char::len_utf8)
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;
    use serde::Deserialize;
    use toml::Spanned;

    use super::*;

    #[derive(Deserialize)]
    struct QuotedFile {
        a: Spanned<String>,
    }

    /// Checks that the position of each character contains that character or an escape sequence.
    #[track_caller]
    fn check(text: &str) {
        let file: QuotedFile = toml::from_str(text).unwrap_or_else(|error| panic!("{text:?}: {error}"));
        let raw = &text[file.a.span()];
        let mut last = 0;
        for (at, letter) in file.a.get_ref().char_indices() {
            let place = source_offset(raw, at);
            let found = raw[place..].chars().next().unwrap();
            assert!(found == letter || found == '\\', "{raw:?} at {at}: {place} is {found:?}");
            assert!(place > last, "{raw:?} at {at}");
            last = place;
        }
        let end = source_offset(raw, file.a.get_ref().len());
        assert!(
            end > last && raw[end..].chars().all(|letter| matches!(letter, '"' | '\'')),
            "{raw:?}: {end}"
        );
    }

    #[test]
    fn every_form_of_string() {
        check("a = 'node == \"x\"'");
        check("a = \"\"");
        check("a = \"node == \\\"ä\\\" \\u00e4 \\U0001F600 \\x41 \\t z\"");
        check("a = '''\nnode\n  == 5'''");
        check("a = '''node'''");
        check("a = \"\"\"\r\nnode \\\n    == \\\"5 \\   \r\n  \"\"\"");
        check("a = \"\"\"\\\n   x\"\"\"");
    }

    proptest! {
        #![proptest_config(ProptestConfig { cases: 256, failure_persistence: None, ..ProptestConfig::default() })]

        #[test]
        fn whatever_it_says(text in "[a-z \"'\\\\äß\u{1F600}\t\n=]{0,30}") {
            let escaped: String = text.chars().map(|letter| match letter {
                '"' => "\\\"".into(),
                '\\' => "\\\\".into(),
                '\n' => "\\n".into(),
                'ß' => "\\u00df".into(),
                other => other.to_string(),
            }).collect();
            check(&format!("a = \"{escaped}\""));
            check(&format!("a = \"\"\"{escaped}\"\"\""));
            if !text.contains(['\'', '\n']) {
                check(&format!("a = '{text}'"));
            }
        }

        #[test]
        fn no_text_breaks_it(raw in "\\PC{0,20}", at in 0..40_usize) {
            prop_assert!(raw.is_empty() || source_offset(&raw, at) <= raw.len());
        }
    }
}
