//! The first lines of a capture, split in the way of one dialect.

use super::records::{RecordLines, clean_line};
use super::token::{Dialect, Token, Tokens, is_ruler};
use super::words::{ColumnName, column_name, is_bus_name};
use crate::capture::column_list::ColumnRole;
use crate::capture::formats::candump::line::is_around;

/// Maximum number of lines that decide about the layout.
const MOST_LINES: usize = 600;

/// Maximum number of lines before the one with the names of the columns.
const HEADING_LINES: usize = 40;

/// A line, or the lines of one frame.
#[derive(Debug, Clone)]
pub(super) struct SampleLine {
    /// Number of the line, from 1.
    pub(super) number: u64,
    /// Text of the line.
    pub(super) text: Vec<u8>,
    /// Numbers and words.
    pub(super) tokens: Tokens,
}

/// Lines of a sample with their tokens.
#[derive(Debug, Clone, Default)]
pub(super) struct Sample {
    /// Separators.
    pub(super) dialect: Dialect,
    /// First word of a frame on several lines.
    pub(super) record_start: Option<Vec<u8>>,
    /// Lines that may contain frames.
    pub(super) lines: Vec<SampleLine>,
    /// Names of the columns, in order; with cells, one per cell.
    pub(super) heading: Vec<Option<ColumnName>>,
    /// Number of the line with the names.
    pub(super) heading_line: Option<u64>,
}

impl Sample {
    /// Splits the lines of `head`; with `record_start`, the lines of a frame are joined.
    pub(super) fn new(head: &[u8], dialect: Dialect, record_start: Option<Vec<u8>>) -> Self {
        let mut sample = Self { dialect, record_start, ..Self::default() };
        let mut records = RecordLines::new(sample.record_start.clone());
        for (index, text) in split_lines(head).enumerate() {
            let text = clean_line(text);
            if sample.lines.len() >= MOST_LINES {
                break;
            }
            if !is_ruler(&text) && !is_around(&text) {
                records.add_line(index as u64 + 1, &text, |number, text| sample.add_line(number, text));
            }
        }
        records.finish(|number, text| sample.add_line(number, text));
        sample
    }

    fn add_line(&mut self, number: u64, text: &[u8]) {
        if self.heading_line.is_none() && number <= HEADING_LINES as u64 && self.record_start.is_none() {
            let names = heading_names(text, self.dialect);
            if is_heading(&names) {
                (self.heading, self.heading_line) = (names, Some(number));
                return;
            }
        }
        let mut tokens = Tokens::default();
        tokens.split_line(text, self.dialect);
        self.lines.push(SampleLine { number, text: text.to_vec(), tokens });
    }
}

/// Lines of a capture without byte order mark and line ends.
pub(super) fn split_lines(head: &[u8]) -> impl Iterator<Item = &[u8]> {
    let head = head.strip_prefix(b"\xEF\xBB\xBF").unwrap_or(head);
    let mut last = 0;
    let mut ends = memchr::memchr2_iter(b'\n', b'\r', head);
    let mut is_over = false;
    std::iter::from_fn(move || {
        if is_over {
            return None;
        }
        loop {
            let Some(end) = ends.next() else {
                is_over = true;
                return head.get(last..).filter(|rest| !rest.is_empty());
            };
            // The second byte of `\r\n` ends no line.
            if head.get(end) == Some(&b'\n') && end > 0 && head.get(end - 1) == Some(&b'\r') {
                last = end + 1;
                continue;
            }
            let line = head.get(last..end).unwrap_or_default();
            last = end + 1;
            return Some(line);
        }
    })
}

/// Whether these are names of columns: at least two besides those of bytes, which are bytes themselves (`D3`).
pub(super) fn is_heading(names: &[Option<ColumnName>]) -> bool {
    names.iter().flatten().filter(|name| name.byte.is_none()).count() >= 2
}

/// Names of columns in a line; empty if it has numbers or bytes.
pub(super) fn heading_names(text: &[u8], dialect: Dialect) -> Vec<Option<ColumnName>> {
    if let Some(cell) = dialect.cell {
        let mut cells: Vec<_> = text.split(|byte| *byte == cell).map(column_name).collect();
        // A cell of one number is a row, not a head.
        let is_number = |cell: &[u8]| !cell.trim_ascii().is_empty() && is_plain_number(cell.trim_ascii());
        if text.split(|byte| *byte == cell).any(is_number) {
            cells.clear();
        }
        return cells;
    }
    let mut tokens = Tokens::default();
    tokens.split_line(text, dialect);
    let words: Vec<&[u8]> = words_of(text);
    let mut names = Vec::new();
    let mut at = 0;
    while at < words.len() {
        // The longest name first: "CAN ID (hex)", "Data Bytes".
        let name = (1..=4).rev().find_map(|count| {
            let joined = words.get(at..at + count)?.join(&b' ');
            column_name(&joined).map(|name| (name, count))
        });
        match name {
            Some((name, count)) => {
                names.push(Some(name));
                at += count;
            }
            None if words.get(at).is_some_and(|word| is_plain_number(word)) => return Vec::new(),
            None => {
                names.push(None);
                at += 1;
            }
        }
    }
    // A sentence that contains names of columns is not a head.
    let known = names.iter().flatten().count();
    if known * 2 < names.len() { Vec::new() } else { names }
}

fn is_plain_number(word: &[u8]) -> bool {
    word.iter().all(|byte| byte.is_ascii_digit() || matches!(byte, b'.' | b':' | b'-' | b'x'))
        && word.iter().any(u8::is_ascii_digit)
}

fn words_of(text: &[u8]) -> Vec<&[u8]> {
    let is_separator = |byte: &u8| byte.is_ascii_whitespace() || matches!(byte, b',' | b';' | b'|');
    text.split(is_separator).filter(|word| !word.is_empty()).collect()
}

/// Words before the token at `at` of the same cell, the nearest last: at most three.
pub(super) fn words_before(line: &SampleLine, at: usize) -> Vec<&[u8]> {
    let tokens = line.tokens.list();
    let Some(own) = tokens.get(at) else { return Vec::new() };
    let before = tokens.get(..at).unwrap_or_default().iter().rev();
    let words = before.take_while(|token| !token.is_number() && token.cell == own.cell).take(3);
    let mut words: Vec<_> = words.map(|token| token.text(&line.text)).collect();
    words.reverse();
    words
}

/// Name of a column from the words before its numbers: "CAN ID:", "DLC =".
pub(super) fn label_name(words: &[&[u8]]) -> Option<ColumnName> {
    let name = (0..words.len()).find_map(|start| column_name(&words.get(start..)?.join(&b' ')))?;
    // `Ext` before a number is a frame type, not the name of the number.
    let is_word = |role| {
        matches!(role, ColumnRole::Extended | ColumnRole::Remote | ColumnRole::Direction | ColumnRole::Kind)
    };
    (!is_word(name.role)).then_some(name)
}

/// Names in a heading without cells for `count` numbers before the data. Columns of words are not counted.
pub(super) fn number_names(sample: &Sample, count: usize) -> Option<Vec<Option<ColumnName>>> {
    let heading = &sample.heading;
    let is_data = |name: &Option<ColumnName>| name.is_some_and(|name| name.role == ColumnRole::Data);
    let end = heading.iter().position(is_data).unwrap_or(heading.len());
    let names = heading.get(..end).unwrap_or_default();
    let has_word = |test: fn(&[u8]) -> bool| {
        let has = |line: &&SampleLine| {
            let mut words = line.tokens.list().iter().filter(|token| !token.is_number());
            words.any(|token| test(token.text(&line.text)))
        };
        sample.lines.iter().filter(has).count() * 2 > sample.lines.len()
    };
    let words = [ColumnRole::Direction, ColumnRole::Kind];
    let mut leaves: Vec<ColumnRole> = if has_word(|_| true) { words.to_vec() } else { Vec::new() };
    if has_word(is_bus_name) {
        leaves.push(ColumnRole::Bus);
    }
    let with = |leaves: &[ColumnRole]| {
        let kept = |name: &&Option<ColumnName>| name.is_none_or(|name| !leaves.contains(&name.role));
        let names: Vec<_> = names.iter().filter(kept).copied().collect();
        (names.len() == count).then_some(names)
    };
    let more = |others: &[ColumnRole]| with(&[&leaves[..], others].concat());
    more(&[])
        .or_else(|| more(&words))
        .or_else(|| more(&[ColumnRole::Skip]))
        .or_else(|| more(&[&words[..], &[ColumnRole::Skip, ColumnRole::Bus]].concat()))
}

/// Numbers of a line with their positions among the tokens.
pub(super) fn numbers_of(line: &SampleLine) -> Vec<(usize, Token)> {
    let tokens = line.tokens.list().iter().enumerate();
    tokens.filter(|(_, token)| token.is_number()).map(|(at, token)| (at, *token)).collect()
}
