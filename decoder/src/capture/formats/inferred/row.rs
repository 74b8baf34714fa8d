//! Reads one line by its layout.

use super::layout::{LAST_SLOT, Layout, WORD_POSITIONS, is_after, slot_after};
use super::time::RowTime;
use super::token::{Token, TokenKind, Tokens, names_truth};
use super::words::{LETTER_PAIRS, WordMeaning, is_bus_name, truth_value, word_meaning};
use crate::capture::bus_error::{Violation, violation_frame};
use crate::capture::column_list::ColumnRole;
use crate::capture::text::payload::{by_either, by_length};
use crate::frame::{CanId, Frame, FrameFlags, MAX_DATA};

/// Bit of an identifier that marks it as extended in many programs.
pub(super) const FLAG_BIT: u32 = 0x8000_0000;

/// A frame of a line.
#[derive(Debug, Clone, Copy)]
pub(super) struct Row<'a> {
    /// Time, as far as the line states it.
    pub(super) time: RowTime,
    /// Bus name; `None` if the line has none.
    pub(super) bus: Option<&'a [u8]>,
    /// The frame, without number, time and bus.
    pub(super) frame: Frame,
    /// Value of the length column.
    pub(super) length: Option<u32>,
}

/// Reason why a line is not a frame.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum RowFault {
    /// Text without the columns of a frame.
    Text,
    /// A frame with a part that cannot be read.
    Broken(&'static str),
}

use RowFault::Broken;

const SHORT: RowFault = Broken("data: fewer bytes than the length");
const LONG: RowFault = Broken("data: more bytes than the length");
const IDENTIFIER: RowFault =
    Broken("identifier: expected 1 to 8 hex digits, up to 1FFFFFFF, in the column of the other lines");
const BYTES: RowFault = Broken("data: expected bytes in the form of the other lines");

/// State while a line is read.
struct RowReader<'a> {
    layout: &'a Layout,
    line: &'a [u8],
    tokens: &'a [Token],
    time: RowTime,
    bus: Option<&'a [u8]>,
    id: Option<Token>,
    length: Option<u32>,
    flags: FrameFlags,
    extended: Option<bool>,
    bytes: [u8; MAX_DATA],
    count: usize,
    /// Number of columns before the data so far.
    before: usize,
    /// Number of columns after the data so far; `None` before the data.
    after: Option<usize>,
}

impl Layout {
    /// Reads a line.
    ///
    /// # Errors
    /// If the line has no frame of this layout.
    pub(super) fn read_row<'a>(&'a self, line: &'a [u8], tokens: &'a Tokens) -> Result<Row<'a>, RowFault> {
        if tokens.is_cut {
            return Err(Broken("line: longer than a frame"));
        }
        let mut reader = RowReader {
            layout: self,
            line,
            tokens: tokens.list(),
            time: RowTime::default(),
            bus: None,
            id: None,
            length: None,
            flags: FrameFlags(0),
            extended: None,
            bytes: [0; MAX_DATA],
            count: 0,
            before: 0,
            after: None,
        };
        let found = reader.read_tokens();
        match found.and_then(|()| reader.build_row()) {
            Err(_) if reader.flags.contains(FrameFlags::ERROR) => reader.build_error_row(),
            found => found,
        }
    }
}

impl<'a> RowReader<'a> {
    fn read_tokens(&mut self) -> Result<(), RowFault> {
        let has_cells = self.layout.dialect.cell.is_some();
        let mut at = 0;
        while let Some(token) = self.tokens.get(at) {
            let role = if has_cells { self.cell_role(usize::from(token.cell)) } else { self.next_role() };
            if token.is_number() {
                at = if role == ColumnRole::Data && self.after.is_none() && self.lacks_data(at, *token) {
                    // The data are empty: the number belongs to the next column.
                    self.after = Some(0);
                    at
                } else if role == ColumnRole::Data && self.after.is_none() {
                    self.take_data(at)?
                } else if role == ColumnRole::Data && has_cells {
                    // A number after the bytes in a cell of the data.
                    return Err(LONG);
                } else {
                    self.take_column(at, *token, role)?;
                    at + 1
                };
            } else if has_cells && matches!(role, ColumnRole::Extended | ColumnRole::Remote) {
                self.take_column(at, *token, role)?;
                at += 1;
            } else {
                at = self.take_words(at);
            }
        }
        Ok(())
    }

    /// Whether the word of the data precedes the number, if the layout has one.
    fn has_data_label(&self, at: usize) -> bool {
        let before = at.checked_sub(1).and_then(|at| self.tokens.get(at));
        self.layout.data_label.as_deref().is_none_or(|label| {
            before.is_some_and(|before| before.text(self.line).eq_ignore_ascii_case(label))
        })
    }

    /// Whether the line has no data although a number follows: the layout has a word before the data, and the number has
    /// none or is not a byte.
    fn lacks_data(&self, at: usize, token: Token) -> bool {
        let is_other = token.kind != TokenKind::Hex;
        self.layout.data_label.is_some() && (is_other || !self.has_data_label(at))
    }

    fn cell_role(&self, cell: usize) -> ColumnRole {
        self.layout.before.get(cell).copied().unwrap_or_default()
    }

    /// Role of the next number of a line without cells.
    fn next_role(&self) -> ColumnRole {
        match self.after {
            Some(after) => self.layout.after.get(after).copied().unwrap_or_default(),
            None => self.layout.before.get(self.before).copied().unwrap_or(ColumnRole::Data),
        }
    }

    fn take_column(&mut self, at: usize, token: Token, role: ColumnRole) -> Result<(), RowFault> {
        match &mut self.after {
            Some(after) => {
                let layout = self.layout;
                let may_follow = layout.has_tail && self.count > 0;
                if *after >= layout.after.len() && !may_follow && layout.dialect.cell.is_none() {
                    return Err(Broken("columns: more than in the other lines"));
                }
                *after += 1;
            }
            None => self.before += 1,
        }
        let text = token.text(self.line);
        match role {
            ColumnRole::Time | ColumnRole::Delta | ColumnRole::Date => {
                self.time.add_token(text, token.kind, self.layout.time).ok_or(Broken(
                    "time: expected a number or a time of day in the form of the other lines",
                ))?;
            }
            ColumnRole::Id if self.id.is_none() => {
                let label = self.layout.id.label.as_deref();
                let before = at.checked_sub(1).and_then(|at| self.tokens.get(at));
                let has_label =
                    |label: &[u8]| before.is_some_and(|it| it.text(self.line).eq_ignore_ascii_case(label));
                if token.kind != TokenKind::Hex || !label.is_none_or(has_label) {
                    return Err(RowFault::Text);
                }
                let is_narrow = token.width() < usize::from(self.layout.id.least_width);
                if is_narrow || self.layout.id.gap.is_some_and(|gap| gap != token.gap) {
                    return Err(IDENTIFIER);
                }
                self.id = Some(token);
            }
            ColumnRole::Length if self.length.is_none() => {
                let value = parse_length(text, token).ok_or(Broken("length: expected 0 to 64"))?;
                self.length = Some(value);
            }
            ColumnRole::Bus => self.bus = Some(text),
            ColumnRole::Extended => self.extended = truth_value(text),
            ColumnRole::Remote if truth_value(text) == Some(true) => {
                self.flags = self.flags.with(FrameFlags::REMOTE);
            }
            _ => {}
        }
        Ok(())
    }

    /// Takes the words up to the next number; returns its position.
    fn take_words(&mut self, at: usize) -> usize {
        let has_cells = self.layout.dialect.cell.is_some();
        let first_cell = self.tokens.get(at).map_or(0, |token| token.cell);
        let is_part = |token: &&Token| !token.is_number() && (!has_cells || token.cell == first_cell);
        let count = self.tokens.iter().skip(at).take_while(is_part).count();
        let slot = match self.after {
            _ if has_cells => usize::from(first_cell),
            Some(after) => slot_after(after),
            None => self.before,
        };
        let words = &self.layout.words;
        let (mut positions, mut letters) = words.of_slot(slot);
        let mut bus = words.bus.filter(|(of, _)| usize::from(*of) == slot);
        // Without data, the words before and after them follow each other.
        let is_empty = at + count >= self.tokens.len() || !self.has_data_label(at + count);
        let is_merged =
            is_empty && !has_cells && self.after.is_none() && self.before == self.layout.before.len();
        if is_merged {
            let (last_positions, last_letters) = words.of_slot(LAST_SLOT);
            let any = |positions: u8| if positions == 0 { 0 } else { u8::MAX };
            (positions, letters) = (any(positions | last_positions), letters.max(last_letters));
            bus = bus.or(words.bus.filter(|(of, _)| usize::from(*of) == LAST_SLOT));
        }
        if positions == 0 && letters == 0 && bus.is_none() {
            if self.after.is_none() && at + count >= self.tokens.len() {
                self.take_remote_word(at);
            }
            return at + count;
        }
        for (index, token) in self.tokens.iter().skip(at).take(count).enumerate() {
            let position = if has_cells { count - index - 1 } else { word_position(index, count, slot) };
            let word = token.text(self.line);
            if names_truth(self.line, *token, self.tokens.get(at + index + 1)) {
                continue;
            }
            let is_bus = match bus {
                Some(_) if is_merged => is_bus_name(word),
                Some((_, of)) => usize::from(of) == position,
                None => false,
            };
            if is_bus {
                self.bus = Some(word);
            } else if let [letter] = word {
                self.apply_letter(*letter, letters);
            } else if position < WORD_POSITIONS && positions & (1 << position) != 0 {
                self.apply_word(word_meaning(word));
            }
        }
        at + count
    }

    /// A line without data that ends with the word of a remote frame is one, although no column has such words. It is not
    /// an empty data frame.
    fn take_remote_word(&mut self, at: usize) {
        let words = self.tokens.iter().skip(at).map(|token| word_meaning(token.text(self.line)));
        let is_remote = |meaning| matches!(meaning, Some(WordMeaning::Flags(flags)) if flags.contains(FrameFlags::REMOTE));
        if words.into_iter().any(is_remote) {
            self.flags = self.flags.with(FrameFlags::REMOTE);
        }
    }

    fn apply_letter(&mut self, letter: u8, letters: u8) {
        let pair = usize::from(letters).checked_sub(1).and_then(|pair| LETTER_PAIRS.get(pair));
        if let Some((pair, meanings)) = pair {
            let found = pair.iter().position(|known| *known == letter);
            self.apply_word(found.and_then(|found| meanings.get(found)).copied());
        }
    }

    fn apply_word(&mut self, meaning: Option<WordMeaning>) {
        match meaning {
            Some(WordMeaning::Flags(flags)) => self.flags = self.flags.with(flags),
            Some(WordMeaning::Extended(extended)) => self.extended = Some(extended),
            Some(WordMeaning::Nothing) | None => {}
        }
    }

    /// Takes the data from the number at `at`; returns the position after them.
    fn take_data(&mut self, at: usize) -> Result<usize, RowFault> {
        self.after = Some(0);
        let form = &self.layout.data;
        let limit = if form.has_length && self.length.is_some() { self.byte_count(at) } else { None };
        let mut at = at;
        if form.is_packed {
            while let Some(token) = self.tokens.get(at).copied().filter(|token| self.is_packed(*token)) {
                if limit.is_some_and(|limit| self.count >= limit) {
                    break;
                }
                for pair in token.text(self.line).chunks_exact(2) {
                    self.push_byte(hex_value(pair).ok_or(BYTES)?)?;
                }
                at += 1;
                if limit.is_none() {
                    break;
                }
            }
        } else {
            while let Some(token) =
                self.tokens.get(at).copied().filter(|token| self.is_next_byte(*token, limit))
            {
                let value = self.byte_value(token).ok_or(BYTES)?;
                self.push_byte(value)?;
                at += 1;
            }
        }
        match limit {
            Some(limit) if self.count > limit => Err(LONG),
            Some(limit) if self.count == limit && self.continues_at(at) => Err(LONG),
            Some(limit) if self.count < limit => Err(SHORT),
            _ if self.count == 0 && limit.is_none() => Err(BYTES),
            _ => Ok(at),
        }
    }

    /// Whether a further byte follows the data at the distance of the bytes before.
    fn continues_at(&self, at: usize) -> bool {
        let has_more = |token: &Token| {
            self.byte_value(*token).is_some() && self.is_joined(*token) && self.is_data_cell(*token)
        };
        !self.layout.data.is_packed && self.count > 0 && self.tokens.get(at).is_some_and(has_more)
    }

    fn is_data_cell(&self, token: Token) -> bool {
        self.layout.dialect.cell.is_none() || self.cell_role(usize::from(token.cell)) == ColumnRole::Data
    }

    fn is_packed(&self, token: Token) -> bool {
        token.kind == TokenKind::Hex
            && token.suffix == 0
            && token.width().is_multiple_of(2)
            && self.is_data_cell(token)
            && (self.count == 0 || self.is_joined(token))
    }

    /// Number of bytes of the data from its length column; `None` if the length is not valid.
    fn byte_count(&self, at: usize) -> Option<usize> {
        let length = u8::try_from(self.length?).ok()?;
        if length <= 8 {
            return Some(length.into());
        }
        // The same number may be a DLC or a length of CAN FD: the bytes decide.
        let there = if self.layout.data.is_packed {
            self.tokens.get(at).map_or(0, |token| token.width() / 2)
        } else {
            let mut run = self.tokens.iter().skip(at).enumerate();
            let is_byte = |(index, token): &(usize, &Token)| {
                self.byte_value(**token).is_some()
                    && self.is_data_cell(**token)
                    && (*index == 0 || self.is_joined(**token))
            };
            run.by_ref().take_while(is_byte).take(MAX_DATA).count()
        };
        let flags = if there > 8 { FrameFlags::FD } else { FrameFlags(0) };
        by_either(length, there, flags).map(|(length, _)| length.into())
    }

    #[inline]
    fn is_next_byte(&self, token: Token, limit: Option<usize>) -> bool {
        let is_form = if self.layout.data.is_decimal {
            token.kind == TokenKind::Hex && token.is_decimal && token.width() <= 3
        } else {
            token.is_byte()
        };
        is_form
            && self.is_data_cell(token)
            && limit.is_none_or(|limit| self.count < limit)
            && (self.count == 0 || self.is_joined(token))
    }

    /// Whether a token follows the byte before it at the distance of the sample's bytes.
    #[inline]
    fn is_joined(&self, token: Token) -> bool {
        if self.layout.dialect.cell.is_some() {
            return true;
        }
        let form = &self.layout.data;
        let (separator, width) = form.separator;
        let pitch = token.width() + usize::from(token.gap_width);
        // Some programs leave a wider gap after each fourth byte.
        let is_group = form.has_length && self.count.is_multiple_of(4) && token.gap_width == width + 1;
        width == 0
            || token.gap == separator
                && (token.gap_width == width || usize::from(form.pitch) == pitch || is_group)
    }

    #[inline]
    fn byte_value(&self, token: Token) -> Option<u8> {
        let text = token.text(self.line);
        if self.layout.data.is_decimal {
            let value = decimal_value(text).filter(|_| token.kind == TokenKind::Hex && token.is_decimal)?;
            return u8::try_from(value).ok();
        }
        if !token.is_byte() {
            return None;
        }
        hex_value(text)
    }

    fn push_byte(&mut self, byte: u8) -> Result<(), RowFault> {
        *self.bytes.get_mut(self.count).ok_or(BYTES)? = byte;
        self.count += 1;
        Ok(())
    }

    /// An error frame, whose identifier and data the line need not state.
    fn build_error_row(&self) -> Result<Row<'a>, RowFault> {
        if self.layout.time.is_some() && self.time.is_missing() {
            return Err(RowFault::Text);
        }
        let frame = violation_frame(Violation::Other, false, 0, None);
        let flags = frame.flags.with(self.flags);
        Ok(Row { time: self.time, bus: self.bus, frame: Frame { flags, ..frame }, length: None })
    }

    fn build_row(&mut self) -> Result<Row<'a>, RowFault> {
        let Some(token) = self.id else {
            let has_data = self.count > 1 || self.length.is_some();
            return Err(if has_data { IDENTIFIER } else { RowFault::Text });
        };
        let id = self.identifier(token)?;
        // A length without bytes and a word of remote frames, wherever it is.
        if self.count == 0 && self.length.is_some_and(|length| length > 0) {
            self.take_remote_word(0);
        }
        let (length, raw_dlc) = self.frame_length()?;
        if self.layout.time.is_some() && self.time.is_missing() {
            return Err(Broken("time: missing"));
        }
        if length > 8 {
            self.flags = self.flags.with(FrameFlags::FD);
        }
        let frame = Frame { id, flags: self.flags, length, raw_dlc, bytes: self.bytes, ..Frame::EMPTY };
        Ok(Row { time: self.time, bus: self.bus, frame, length: self.length })
    }

    /// Length and DLC of the frame, from the data and the length column.
    fn frame_length(&self) -> Result<(u8, u8), RowFault> {
        let count = u8::try_from(self.count).map_err(|_| BYTES)?;
        let is_remote = self.flags.contains(FrameFlags::REMOTE);
        let fd = if count > 8 { self.flags.with(FrameFlags::FD) } else { self.flags };
        let found = match self.length {
            _ if is_remote && count > 0 => return Err(Broken("data: a remote frame has none")),
            Some(length) if is_remote => u8::try_from(length).ok().filter(|it| *it <= 8).map(|it| (it, 0)),
            None if is_remote => Some((0, 0)),
            Some(length) => {
                let length = u8::try_from(length).map_err(|_| SHORT)?;
                let found = by_either(length, self.count, fd).filter(|(length, _)| *length == count);
                return found.ok_or(if count < length { SHORT } else { LONG });
            }
            // Without a length, text with one number would be a frame without data.
            None if count == 0 && !self.layout.data.has_label => {
                let is_bare = self.tokens.iter().all(Token::is_number)
                    && self.before == self.layout.before.len()
                    && self.id.is_some_and(|id| id.width() >= 3);
                return if is_bare { Ok((0, 0)) } else { Err(RowFault::Text) };
            }
            None => by_length(count, fd),
        };
        found.ok_or(Broken("data: expected 0 to 8, 12, 16, 20, 24, 32, 48 or 64 bytes"))
    }

    fn identifier(&self, token: Token) -> Result<CanId, RowFault> {
        let form = &self.layout.id;
        let text = token.text(self.line);
        let value =
            if form.is_decimal { decimal_value(text).filter(|_| token.is_decimal) } else { hex_number(text) };
        let value = value.ok_or(IDENTIFIER)?;
        let has_flag = !form.is_decimal && value & FLAG_BIT != 0;
        let value = if has_flag { value & !FLAG_BIT } else { value };
        let is_wide = form.is_wide_extended && token.width() > 4;
        let extended = match self.extended {
            Some(extended) => extended,
            None => has_flag || is_wide || token.suffix == b'x' || value > 0x7FF,
        };
        crate::capture::text::columns::parse_identifier(value, extended).ok_or(IDENTIFIER)
    }
}

/// Position of a word in its slot: counted from the end, after the data from the start.
pub(super) fn word_position(index: usize, count: usize, slot: usize) -> usize {
    if is_after(slot) { index } else { count.saturating_sub(index + 1) }
}

/// Value of a length column: decimal, or hexadecimal with a prefix.
pub(super) fn parse_length(text: &[u8], token: Token) -> Option<u32> {
    if token.kind != TokenKind::Hex || text.len() > 2 || token.suffix != 0 {
        return None;
    }
    let value = if token.has_prefix { hex_number(text) } else { decimal_value(text) };
    value.filter(|value| *value <= 64)
}

/// Value of one or two hexadecimal digits.
#[inline]
fn hex_value(text: &[u8]) -> Option<u8> {
    match text {
        [high, low] => Some(digit_value(*high)? << 4 | digit_value(*low)?),
        [digit] => digit_value(*digit),
        _ => None,
    }
}

#[inline]
fn digit_value(digit: u8) -> Option<u8> {
    match digit {
        b'0'..=b'9' => Some(digit - b'0'),
        b'a'..=b'f' => Some(digit - b'a' + 10),
        b'A'..=b'F' => Some(digit - b'A' + 10),
        _ => None,
    }
}

/// Value of up to eight hexadecimal digits.
pub(super) fn hex_number(text: &[u8]) -> Option<u32> {
    if !matches!(text.len(), 1..=8) {
        return None;
    }
    text.iter().try_fold(0_u32, |value, digit| Some(value << 4 | u32::from(digit_value(*digit)?)))
}

/// Value of a decimal number of up to nine digits.
pub(super) fn decimal_value(text: &[u8]) -> Option<u32> {
    if !matches!(text.len(), 1..=9) {
        return None;
    }
    text.iter()
        .try_fold(0_u32, |value, digit| digit.is_ascii_digit().then(|| value * 10 + u32::from(digit - b'0')))
}
