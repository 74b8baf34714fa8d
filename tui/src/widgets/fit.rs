//! Cuts a sentence to a width: prose first; numbers, names of states and `NOT` stay.
//!
//! ```text
//! spool +37.5 %? NOT effective: needs device ACTIVE
//! spool +37.5 %? NOT effective:… ACTIVE
//! ```

use super::draw;
use crate::theme::{Glyph, Theme};

/// Marks that end a clause.
const ENDS: [char; 2] = [',', ';'];

/// Maximum length of a unit after a number.
const LONGEST_UNIT: usize = 4;

/// Maximum length of a number; a longer word with digits is a text.
const LONGEST_NUMBER: usize = 16;

/// Minimum room for the start of a further clause.
const LEAST_CLAUSE: u16 = 8;

/// The text in at most `room` columns; each omitted part is an ellipsis.
pub fn fit_text(text: &str, room: u16, theme: &Theme) -> String {
    if draw::text_width(text) <= room {
        return text.to_owned();
    }
    let ellipsis = theme.glyph(Glyph::Ellipsis);
    let last = draw::text_width(ellipsis);
    let clauses = split_clauses(text);
    let (mut shown, mut is_complete) = (String::new(), false);
    for (number, clause) in clauses.iter().enumerate() {
        let is_last = number + 1 == clauses.len();
        let left =
            room.saturating_sub(draw::text_width(&shown)).saturating_sub(if is_last { 0 } else { last });
        if draw::text_width(clause) <= left {
            shown.push_str(clause);
            continue;
        }
        is_complete = number == 0 && is_last;
        if number == 0 {
            shown = shorten_clause(clause, left, ellipsis);
        } else if left >= LEAST_CLAUSE {
            let start = start_of(clause, room.saturating_sub(draw::text_width(&shown)), ellipsis);
            if start.is_empty() && left > room / 2 {
                shown.push_str(&cut_text(&shorten_clause(clause, left, ellipsis), left, ellipsis));
                is_complete = is_last;
            }
            shown.push_str(&start);
        }
        break;
    }
    if !is_complete && !shown.ends_with(ellipsis) {
        shown.push_str(ellipsis);
    }
    cut_text(&shown, room, ellipsis)
}

/// The clauses of a text; together they are the text.
fn split_clauses(text: &str) -> Vec<&str> {
    let mut clauses = Vec::new();
    let mut rest = text;
    let mut from = 0;
    while let Some(at) = rest.get(from..).and_then(|part| part.find(' ')).map(|at| at.saturating_add(from)) {
        let (before, after) = (rest.get(..at).unwrap_or_default(), rest.get(at..).unwrap_or_default());
        if before.ends_with(ENDS) || begins_clause(before, after) {
            clauses.push(before);
            (rest, from) = (after, 1);
        } else {
            from = at.saturating_add(1);
        }
    }
    clauses.push(rest);
    clauses
}

/// Whether `after` starts a remark, a further part, a payload, or the consequence of prose. An arrow after a
/// value or a state shows its change.
fn begins_clause(before: &str, after: &str) -> bool {
    let inside = after.strip_prefix(" (").map(|rest| rest.split(')').next().unwrap_or_default());
    let remark = inside.is_some_and(|inside| inside.contains(' '));
    let mut words = before.rsplit(' ');
    let (last, previous) = (words.next().unwrap_or_default(), words.next().unwrap_or_default());
    let is_value = is_firm(last) || is_unit(previous, last);
    let mut next = after.trim_start().split(' ');
    let are_bytes =
        last.ends_with(':') && next.next().is_some_and(is_byte) && next.next().is_some_and(is_byte);
    remark || are_bytes || after.starts_with(" | ") || (after.starts_with(" → ") && !is_value)
}

/// Whether a word is a payload byte.
fn is_byte(word: &str) -> bool {
    let word = word.trim_end_matches(ENDS);
    word.len() == 2 && word.bytes().all(|digit| digit.is_ascii_digit() || (b'A'..=b'F').contains(&digit))
}

/// Whether a word is the unit of the number before it.
fn is_unit(previous: &str, word: &str) -> bool {
    word.len() <= LONGEST_UNIT && previous.ends_with(|letter: char| letter.is_ascii_digit())
}

/// Whether a word carries a number, a unit, a state or a negation.
fn is_firm(word: &str) -> bool {
    let mut letters = word.chars().filter(|letter| letter.is_alphabetic()).peekable();
    let has_digit = word.chars().any(|letter| letter.is_ascii_digit());
    let is_sign = letters.peek().is_none();
    has_digit || is_sign || letters.all(char::is_uppercase)
}

/// Drops words of prose from the end of a clause until it fits, each run as an ellipsis.
fn shorten_clause(clause: &str, room: u16, ellipsis: &str) -> String {
    let words: Vec<&str> = clause.split(' ').collect();
    let mut is_kept = vec![true; words.len()];
    let joined = |is_kept: &[bool]| {
        let mut text = String::new();
        let mut is_gap = false;
        for (at, (word, is_kept)) in words.iter().zip(is_kept).enumerate() {
            if *is_kept {
                if at > 0 {
                    text.push(' ');
                }
                text.push_str(word);
            } else if !is_gap {
                text.push_str(ellipsis);
            }
            is_gap = !is_kept;
        }
        text
    };
    let word = |at: usize| words.get(at).copied().unwrap_or_default();
    let is_prose = |at: &usize| !is_firm(word(*at)) && !is_unit(word(at.saturating_sub(1)), word(*at));
    let prose = (1..words.len()).rev().filter(is_prose);
    for at in prose {
        if draw::text_width(&joined(&is_kept)) <= room {
            break;
        }
        if let Some(is_kept) = is_kept.get_mut(at) {
            *is_kept = false;
        }
    }
    joined(&is_kept)
}

/// The first words of a clause; nothing if a number or state were among the omitted ones, because a label
/// without its value states nothing.
fn start_of(clause: &str, room: u16, ellipsis: &str) -> String {
    let mut words: Vec<&str> = clause.split(' ').collect();
    let width =
        |words: &[&str]| draw::text_width(&words.join(" ")).saturating_add(draw::text_width(ellipsis));
    while width(&words) > room {
        let Some(word) = words.pop() else { return String::new() };
        // The start of a payload is useful.
        let is_of_payload = is_byte(word) && words.last().is_some_and(|word| is_byte(word));
        if is_firm(word) && !is_of_payload {
            return String::new();
        }
    }
    let text = words.join(" ");
    if text.trim().is_empty() { String::new() } else { text + ellipsis }
}

/// The start of a text, cut within a word, but not within a number.
fn cut_text(text: &str, room: u16, ellipsis: &str) -> String {
    if draw::text_width(text) <= room {
        return text.to_owned();
    }
    let mut shown = text.to_owned();
    while !shown.is_empty() && draw::text_width(&shown).saturating_add(draw::text_width(ellipsis)) > room {
        shown.pop();
    }
    let start = shown.rfind(' ').map_or(0, |at| at.saturating_add(1));
    let word = text.get(start..).and_then(|rest| rest.split(' ').next()).unwrap_or_default();
    let is_whole = shown.len().saturating_sub(start) == word.len();
    let is_number = word.len() <= LONGEST_NUMBER && word.contains(|letter: char| letter.is_ascii_digit());
    let before = text.get(..start).unwrap_or_default().trim_end();
    let number = before.rfind(' ').map_or(0, |at| at.saturating_add(1));
    if !is_whole && start > 0 && is_unit(before.get(number..).unwrap_or_default(), word) {
        shown.truncate(number);
    } else if !is_whole && start > 0 && is_number {
        shown.truncate(start.saturating_sub(1));
    }
    let shown = shown.trim_end_matches(' ').trim_end_matches(ellipsis);
    format!("{shown}{ellipsis}")
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::theme::LineCharacters;
    use crate::widgets::draw::tests::plain_theme;

    fn fitted(text: &str, room: u16) -> String {
        let text = fit_text(text, room, &plain_theme(LineCharacters::Unicode));
        assert!(draw::text_width(&text) <= room, "{text}");
        text
    }

    #[test]
    fn numbers_and_negations_stay() {
        let text = "spool +37.5 %? NOT effective: needs device ACTIVE";
        assert_eq!(fitted(text, 60), text);
        assert_eq!(fitted(text, 48), "spool +37.5 %? NOT effective: needs… ACTIVE");
        assert_eq!(fitted(text, 30), "spool +37.5 %? NOT… ACTIVE");
        assert_eq!(fitted(text, 16), "spool +37.5 %?…");
    }

    #[test]
    fn later_clauses_go_first() {
        let text = "8305 spool position error → FAULT HOLD, register 21 (generic, device-profile), counter 3";
        assert_eq!(fitted(text, 60), "8305 spool position error → FAULT HOLD, register 21…");
        assert_eq!(fitted(text, 45), "8305 spool position error → FAULT HOLD,…");
        assert_eq!(fitted(text, 30), "8305 spool position error…");
        assert_eq!(fitted(text, 18), "8305 spool…");
        assert_eq!(fitted("ACTIVE → FAULT HOLD, cause EMCY 8305", 22), "ACTIVE → FAULT HOLD,…");
        assert_eq!(fitted("heartbeat time 250 ms → 1000 ms", 24), "heartbeat… 250 ms →…");
        assert_eq!(fitted("TP 1785 bytes: 41 42 43 44 45 46, name", 25), "TP 1785 bytes: 41 42 43…");
        // Much room is not left empty.
        assert_eq!(fitted("SDO, NO RESPONSE after 250 ms to 1017:00", 26), "SDO, NO RESPONSE… 250 ms…");
        // Neither a number without its unit nor a label without its value is shown.
        assert_eq!(fitted("stopped, valid for 250 ms", 22), "stopped, valid… 250 ms");
        assert_eq!(fitted("stopped, valid for 250 ms", 16), "stopped,…");
        assert_eq!(cut_text("p 12 250 ms", 10, "…"), "p 12…");
        assert_eq!(fitted("stopped, by the other controller", 22), "stopped, by the other…");
    }

    #[test]
    fn all_clauses_are_the_text() {
        for text in ["", "a", "a, b; c (d, e) | f", "x  y, z", "ä → ö, ü"] {
            assert_eq!(split_clauses(text).concat(), text);
        }
    }
}
