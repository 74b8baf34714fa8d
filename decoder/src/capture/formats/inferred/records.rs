//! Frames on several lines, and the marks around a line.

use std::borrow::Cow;

use crate::capture::formats::candump::line::without_colors;

/// Maximum number of lines of one frame.
const MOST_LINES: usize = 12;

/// Text of a line without quote marks, colours and surrounding blanks.
pub(super) fn clean_line(text: &[u8]) -> Cow<'_, [u8]> {
    // Tabs at the start are empty cells.
    let is_mark = |byte: &u8| matches!(byte, b' ' | b'>');
    let marks = text.iter().take_while(|byte| is_mark(byte)).count();
    let start = if text.get(..marks).unwrap_or_default().contains(&b'>') { marks } else { 0 };
    let text = text.get(start..).unwrap_or_default().trim_ascii_end();
    let text = text.get(text.iter().take_while(|byte| **byte == b' ').count()..).unwrap_or_default();
    if memchr::memchr(0x1B, text).is_some() { without_colors(text) } else { text.into() }
}

/// First word of a line, without the colon of a label.
pub(super) fn first_word(line: &[u8]) -> &[u8] {
    let is_letter = |byte: &u8| byte.is_ascii_alphanumeric() || *byte >= 0x80 || matches!(byte, b'_' | b'-');
    let end = line.iter().position(|byte| !is_letter(byte)).unwrap_or(line.len());
    line.get(..end).unwrap_or_default()
}

/// Joins the lines of a frame.
#[derive(Debug, Clone, Default)]
pub(super) struct RecordLines {
    start: Option<Vec<u8>>,
    text: Vec<u8>,
    first: u64,
    count: usize,
}

impl RecordLines {
    /// Joins lines to frames that begin with the word `start`; with `None` each line is complete.
    pub(super) fn new(start: Option<Vec<u8>>) -> Self {
        Self { start, ..Self::default() }
    }

    /// Whether the line begins a frame.
    pub(super) fn is_start(&self, line: &[u8]) -> bool {
        self.start.as_ref().is_none_or(|start| first_word(line).eq_ignore_ascii_case(start))
    }

    /// Adds a line; `take` receives a complete frame and the number of its first line.
    pub(super) fn add_line(&mut self, number: u64, line: &[u8], take: impl FnMut(u64, &[u8])) {
        if self.start.is_none() {
            let mut take = take;
            return take(number, line);
        }
        if self.is_start(line) || self.count >= MOST_LINES {
            self.finish(take);
        }
        if self.count == 0 {
            self.first = number;
        } else {
            self.text.push(b' ');
        }
        self.text.extend_from_slice(line);
        self.count += 1;
    }

    /// Passes the last frame.
    pub(super) fn finish(&mut self, mut take: impl FnMut(u64, &[u8])) {
        if self.count > 0 {
            take(self.first, &self.text);
        }
        self.text.clear();
        self.count = 0;
    }

    /// Whether a frame has several lines.
    pub(super) fn has_several_lines(&self) -> bool {
        self.start.is_some()
    }
}
