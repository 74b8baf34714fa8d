//! Source texts, divided into code, comments and literals.

#![allow(clippy::indexing_slicing, reason = "a test that cannot go on has failed")]

/// A part of a source text.
#[derive(Clone, Copy)]
pub enum CodePart<'a> {
    Code(&'a str),
    Comment,
    /// A string with its quotes.
    String(&'a str),
    Character,
}

/// Parts of a text, each with its offset.
pub fn parts(text: &str) -> Vec<(usize, CodePart<'_>)> {
    let (mut parts, mut at) = (Vec::new(), 0);
    while let Some(c) = text[at..].chars().next() {
        let rest = &text[at..];
        let length = literal(rest);
        if length == 0 {
            // An `r` or a `b` inside a word does not start a string.
            let is_word = |c: char| c.is_alphanumeric() || c == '_';
            let word = rest.find(|c| !is_word(c)).unwrap_or(rest.len());
            let length = word.max(c.len_utf8());
            parts.push((at, CodePart::Code(&rest[..length])));
            at += length;
        } else {
            parts.push((at, literal_kind(&rest[..length])));
            at += length;
        }
    }
    parts
}

fn literal_kind(text: &str) -> CodePart<'_> {
    if text.starts_with('/') {
        CodePart::Comment
    } else if text.ends_with('\'') {
        CodePart::Character
    } else {
        CodePart::String(text)
    }
}

/// The text without comments, strings and characters.
pub fn blanked(text: &str) -> String {
    let code = |(_, part)| if let CodePart::Code(code) = part { Some(code) } else { None };
    parts(text).into_iter().filter_map(code).collect()
}

/// Length in bytes of a comment, string or character at the start; 0 if there is none.
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
        // A lifetime is not a character: no quote follows its first letter.
        Some((_, '\'')) => match (inside.next(), inside.next()) {
            (Some((_, '\\')), Some(_)) => prefix + bare[3..].find('\'').map_or(0, |at| at + 4),
            (Some(_), Some((at, '\''))) => prefix + at + 1,
            _ => 0,
        },
        _ => 0,
    }
}
