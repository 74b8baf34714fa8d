//! The text of sources without what is no code.

#![allow(clippy::indexing_slicing, reason = "a test that cannot go on has failed")]

/// The text without comments, and without what stands in strings and characters.
pub fn blanked(text: &str) -> String {
    let (mut out, mut rest) = (String::with_capacity(text.len()), text);
    while let Some(c) = rest.chars().next() {
        let taken = literal(rest);
        if taken == 0 {
            out.push(c);
            rest = &rest[c.len_utf8()..];
            // An `r` or a `b` within a word begins no string.
            if c.is_alphanumeric() || c == '_' {
                let end = rest.find(|c: char| !c.is_alphanumeric() && c != '_').unwrap_or(rest.len());
                out.push_str(&rest[..end]);
                rest = &rest[end..];
            }
        } else {
            rest = &rest[taken..];
        }
    }
    out
}

/// Bytes of the comment, string or character that begins here; 0 where none does.
fn literal(text: &str) -> usize {
    let until =
        |end: &str, from: usize| text[from..].find(end).map_or(text.len(), |at| from + at + end.len());
    if text.starts_with("//") {
        return text.find('\n').unwrap_or(text.len());
    }
    if text.starts_with("/*") {
        return until("*/", 2);
    }
    let bare = text.strip_prefix('b').unwrap_or(text);
    let prefix = text.len() - bare.len();
    let hashes = bare.strip_prefix('r').map_or(0, |raw| raw.len() - raw.trim_start_matches('#').len());
    if bare.starts_with('r') && bare[1 + hashes..].starts_with('"') {
        return until(&format!("\"{}", "#".repeat(hashes)), prefix + hashes + 2);
    }
    let mut inside = bare.char_indices();
    match inside.next() {
        Some((_, '"')) => {
            let mut is_escaped = false;
            for (at, c) in inside {
                if c == '"' && !is_escaped {
                    return prefix + at + 1;
                }
                is_escaped = c == '\\' && !is_escaped;
            }
            text.len()
        }
        // A lifetime is no character: behind one letter stands no quote.
        Some((_, '\'')) => match (inside.next(), inside.next()) {
            (Some((_, '\\')), Some(_)) => prefix + bare[3..].find('\'').map_or(0, |at| at + 4),
            (Some(_), Some((at, '\''))) => prefix + at + 1,
            _ => 0,
        },
        _ => 0,
    }
}
