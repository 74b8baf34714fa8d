//! Text on profiles, for `explain`, `profiles show` and the reference.

pub mod behaviour;
pub mod j1939;
pub mod network;
pub mod object;
pub mod uds;

use cobscope_decoder::sink::escape;

/// Maximum line width.
const WIDTH: usize = 120;

/// A space without a line break.
pub const FIRM: &str = "\u{a0}";

/// Width of the key column.
const KEY: usize = 12;

/// Appends `first` and `text`, wrapped at spaces; further lines are indented by `indent` columns.
pub fn fold_text(out: &mut String, first: &str, text: &str, indent: usize) {
    let first = escape(first);
    out.push_str(&first);
    let mut column = first.chars().count();
    let mut gap = 0;
    for word in escape(text).trim().split(' ') {
        let width = word.chars().count();
        if gap > 0 && width > 0 && column + gap + width > WIDTH {
            out.push('\n');
            gap = indent;
            column = 0;
        }
        if width > 0 {
            out.push_str(&" ".repeat(gap));
            out.push_str(&word.replace(FIRM, " "));
            column += gap + width;
            gap = 0;
        }
        gap += 1;
    }
    out.push('\n');
}

/// A heading with rows of key and text.
pub struct TextBlock {
    text: String,
    indent: usize,
}

impl TextBlock {
    /// Starts a block `thing  what`; rows are aligned with `what`.
    pub fn new(thing: &str, what: &str) -> Self {
        let first = format!("{thing}  ");
        let indent = first.chars().count();
        let mut text = String::new();
        fold_text(&mut text, &first, what, indent);
        Self { text, indent }
    }

    /// Appends a row; omitted if `text` is empty.
    pub fn push_row(&mut self, key: &str, text: &str) {
        if !text.is_empty() {
            let first = format!("{:indent$}{key:<KEY$} ", "", indent = self.indent);
            fold_text(&mut self.text, &first, text, self.indent + KEY + 1);
        }
    }

    /// Appends several rows with one key.
    pub fn push_rows<T: AsRef<str>>(&mut self, key: &str, lines: &[T]) {
        for (place, line) in lines.iter().enumerate() {
            self.push_row(if place == 0 { key } else { "" }, line.as_ref());
        }
    }

    /// Appends a line without a key; omitted if `text` is empty.
    pub fn push_line(&mut self, text: &str) {
        if text.is_empty() {
            return;
        }
        let indent = self.indent + text.len() - text.trim_start().len();
        fold_text(&mut self.text, &" ".repeat(indent), text, indent + 2);
    }

    /// Appends lines without a key, and the line `below` if there are any.
    pub fn push_list(&mut self, lines: &[String], below: &str) {
        for line in lines {
            self.push_line(line);
        }
        if !lines.is_empty() {
            self.push_line(below);
        }
    }

    /// The finished text.
    pub fn finish(self) -> String {
        self.text
    }
}

/// Text without line breaks, unless it is long.
pub fn unbroken_text(text: &str) -> String {
    if text.chars().count() > WIDTH / 2 { text.to_owned() } else { text.replace(' ', FIRM) }
}

/// `[14.3.1]`; empty without a section.
pub fn section_text(source: &str) -> String {
    if source.is_empty() { String::new() } else { unbroken_text(&format!("[{source}]")) }
}

/// A name with blanks instead of hyphens: `set-point` becomes "set point".
pub fn spaced_name(name: &str) -> String {
    name.replace('-', " ")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn long_lines_are_folded_below_their_text() {
        let mut block = TextBlock::new("8102", "what");
        block.push_row("check", &"word ".repeat(40));
        block.push_row("nothing", "");
        let text = block.finish();
        let lines: Vec<&str> = text.lines().collect();
        assert_eq!(lines[0], "8102  what");
        assert!(lines[1].starts_with("      check        word word"), "{text}");
        assert!(lines[2].starts_with(&format!("{}word", " ".repeat(19))), "{text}");
        assert!(text.lines().all(|line| line.chars().count() <= WIDTH && !line.ends_with(' ')), "{text}");
        assert!(!text.contains("nothing"));
    }
}
