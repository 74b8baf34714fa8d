//! ASCII substitutes of the characters on the screen, each one cell wide.

use ratatui::buffer::{Buffer, Cell};

/// Substitute of a character without an entry.
const UNKNOWN: &str = "?";

/// Characters with their substitutes. Blocks of a bar keep their order, so that a higher bar looks denser.
const SUBSTITUTES: &[(&str, &str)] = &[
    ("→", ">"),
    ("←", "<"),
    ("↑", "^"),
    ("↓", "v"),
    ("▲", "^"),
    ("▼", "v"),
    ("▸", "+"),
    ("▾", "-"),
    ("✓", "+"),
    ("✗", "x"),
    ("⚠", "!"),
    ("×", "x"),
    ("±", "~"),
    ("…", "~"),
    ("Δ", "d"),
    ("·", "."),
    ("–", "-"),
    ("—", "-"),
    ("−", "-"),
    ("≥", ">"),
    ("≤", "<"),
    ("≠", "#"),
    ("≈", "~"),
    ("µ", "u"),
    ("μ", "u"),
    ("°", "*"),
    ("²", "2"),
    ("³", "3"),
    ("Ω", "R"),
    ("§", "S"),
    ("«", "\""),
    ("»", "\""),
    ("“", "\""),
    ("”", "\""),
    ("‘", "'"),
    ("’", "'"),
    ("\u{a0}", " "),
    ("│", "|"),
    ("┆", ":"),
    ("─", "-"),
    ("═", "="),
    ("┬", "+"),
    ("┴", "+"),
    ("├", "+"),
    ("┤", "+"),
    ("┼", "+"),
    ("┌", "+"),
    ("┐", "+"),
    ("└", "+"),
    ("┘", "+"),
    ("▁", "_"),
    ("▂", "."),
    ("▃", ":"),
    ("▄", "-"),
    ("▅", "="),
    ("▆", "+"),
    ("▇", "*"),
    ("█", "#"),
    ("░", "."),
];

/// Substitute of a character.
pub fn ascii_substitute(symbol: &str) -> &'static str {
    SUBSTITUTES.iter().find(|(from, _)| *from == symbol).map_or(UNKNOWN, |(_, to)| to)
}

/// Arrow with its substitute over two cells, if the second one is blank: `>` alone reads as a comparison.
const ARROW: (&str, [&str; 2]) = ("→", ["-", ">"]);

/// Replaces all characters of a screen that are not ASCII.
pub fn replace_symbols(buf: &mut Buffer) {
    let width = usize::from(buf.area.width).max(1);
    for row in buf.content.chunks_mut(width) {
        for place in 1..row.len() {
            if let Some([arrow, blank]) = row.get_mut(place - 1..=place)
                && arrow.symbol() == ARROW.0
                && blank.symbol() == " "
            {
                arrow.set_symbol(ARROW.1[0]);
                blank.set_symbol(ARROW.1[1]);
            }
        }
    }
    let other = buf.content.iter_mut().filter(|cell| !cell.symbol().is_ascii());
    other.for_each(|cell: &mut Cell| {
        cell.set_symbol(ascii_substitute(cell.symbol()));
    });
}

#[cfg(test)]
mod tests {
    use ratatui::layout::Rect;
    use ratatui::style::Style;
    use ratatui::text::Span;

    use super::*;

    #[test]
    fn each_substitute_is_one_ascii_character_for_one_cell() {
        for (place, (from, to)) in SUBSTITUTES.iter().enumerate() {
            assert!(to.is_ascii() && to.len() == 1, "{to}");
            assert!(!from.is_ascii() && Span::raw(*from).width() == 1, "{from}");
            assert!(SUBSTITUTES.iter().skip(place + 1).all(|(other, _)| other != from), "{from} twice");
        }
    }

    #[test]
    fn a_screen_keeps_its_columns() {
        let mut buf = Buffer::empty(Rect::new(0, 0, 12, 1));
        buf.set_string(0, 0, "a→日b e\u{301}±ö", Style::new());
        replace_symbols(&mut buf);
        let text: String = buf.content.iter().map(Cell::symbol).collect();
        // A wide character covers two cells.
        assert_eq!(text, "a>? b ?~?   ");
        buf.set_string(0, 0, "1 → 2 → ", Style::new());
        buf.set_string(11, 0, "→", Style::new());
        replace_symbols(&mut buf);
        let text: String = buf.content.iter().map(Cell::symbol).collect();
        assert_eq!(text, "1 ->2 ->?  >");
    }
}
