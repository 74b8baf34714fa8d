//! Splits a line into numbers and words.
//!
//! ```text
//! [12:01:22.123] Rx ID=0x181 len: 2 data: 37,02
//!  clock         word word hex  word hex word hex hex
//! ```

use crate::capture::text::columns::ColumnWords;

/// Longest line with a frame, in bytes.
pub(super) const LONGEST_ROW: usize = 4_096;

/// Maximum number of tokens of a line: 64 bytes and the other columns.
pub(super) const MOST_TOKENS: usize = 160;

/// Separators that a capture leaves to its lines.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub(super) struct Dialect {
    /// Separator of cells that may be empty; `None` if columns are counted by their numbers.
    pub(super) cell: Option<u8>,
    /// Whether `1,5` is a number with a fraction.
    pub(super) decimal_comma: bool,
    /// Whether `11:22:33` are three bytes; a time of day then has a fraction.
    pub(super) colon_bytes: bool,
    /// Whether each byte has its number: `0 = 11, 1 = 22`.
    pub(super) numbered_bytes: bool,
}

/// Type of a token.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub(super) enum TokenKind {
    /// Hexadecimal digits, which may all be decimal ones.
    #[default]
    Hex,
    /// Decimal digits with a fraction or a sign.
    Fraction,
    /// Decimal digits with a unit of time.
    Quantity,
    /// Time of day with colons.
    Clock,
    /// Calendar date.
    Date,
    /// Other text.
    Word,
}

/// A token of a line.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub(super) struct Token {
    /// Start in the line, in bytes; of a number without its prefix.
    pub(super) start: u16,
    /// End in the line, in bytes; of a number without its suffix.
    pub(super) end: u16,
    /// Type.
    pub(super) kind: TokenKind,
    /// Strongest separator before the token.
    pub(super) gap: u8,
    /// Number of separators before the token, up to 255.
    pub(super) gap_width: u8,
    /// Number of the cell, from 0.
    pub(super) cell: u8,
    /// Whether a number has only decimal digits.
    pub(super) is_decimal: bool,
    /// Whether a number has a prefix such as 0x.
    pub(super) has_prefix: bool,
    /// The letter after a number: `h` or `x`; 0 if there is none.
    pub(super) suffix: u8,
}

impl Token {
    /// Text of the token.
    pub(super) fn text<'a>(&self, line: &'a [u8]) -> &'a [u8] {
        line.get(usize::from(self.start)..usize::from(self.end)).unwrap_or_default()
    }

    /// Number of characters.
    pub(super) fn width(&self) -> usize {
        usize::from(self.end.saturating_sub(self.start))
    }

    /// Whether the token is a column: a number or a time.
    pub(super) fn is_number(&self) -> bool {
        self.kind != TokenKind::Word
    }

    /// Whether the token has the form of one byte.
    #[inline]
    pub(super) fn is_byte(&self) -> bool {
        self.kind == TokenKind::Hex && matches!(self.width(), 1..=2) && self.suffix != b'x'
    }
}

/// Whether a word names the number 0 or 1 after it: `EXT=1`, `RTR: 0`.
pub(super) fn names_truth(line: &[u8], word: Token, next: Option<&Token>) -> bool {
    let Some(next) = next.filter(|next| matches!(next.text(line), b"0" | b"1")) else { return false };
    let between = line.get(usize::from(word.end)..usize::from(next.start)).unwrap_or_default();
    between.iter().any(|byte| matches!(byte, b'=' | b':'))
}

/// Tokens of a line, in memory that is used again.
#[derive(Debug, Clone, Default)]
pub(super) struct Tokens {
    list: Vec<Token>,
    /// Number of the last cell.
    pub(super) last_cell: u8,
    /// Whether the line has more tokens than fit.
    pub(super) is_cut: bool,
}

const DIGIT: u8 = 1;
const HEX_LETTER: u8 = 2;
const LETTER: u8 = 4;
const POINT: u8 = 8;
const COLON: u8 = 16;
const DASH: u8 = 32;
const OTHER: u8 = 64;
const SEPARATOR: u8 = 128;

/// Class of each byte.
static CLASSES: [u8; 256] = classes();

#[expect(clippy::indexing_slicing, reason = "evaluated at compile time")]
const fn classes() -> [u8; 256] {
    let mut table = [OTHER; 256];
    let mut byte: u8 = 0;
    loop {
        table[byte as usize] = match byte {
            b'0'..=b'9' => DIGIT,
            b'A'..=b'F' | b'a'..=b'f' => HEX_LETTER,
            b'G'..=b'Z' | b'g'..=b'z' | b'_' | 0x80..=0xFF => LETTER,
            b'.' => POINT,
            b':' => COLON,
            b'-' | b'+' => DASH,
            0..=b' '
            | b','
            | b';'
            | b'|'
            | b'#'
            | b'='
            | b'"'
            | b'`'
            | b'('
            | b')'
            | b'['
            | b']'
            | b'{'
            | b'}' => SEPARATOR,
            _ => OTHER,
        };
        if byte == u8::MAX {
            return table;
        }
        byte += 1;
    }
}

fn class_of(byte: u8) -> u8 {
    CLASSES.get(usize::from(byte)).copied().unwrap_or(OTHER)
}

/// Strength of a separator: the strongest of several names the gap.
const fn strength(separator: u8) -> u8 {
    match separator {
        b' ' => 0,
        b'=' | b'#' => 2,
        b':' | b'-' => 3,
        b',' => 4,
        b';' => 5,
        b'|' => 6,
        b'(' | b')' | b'[' | b']' | b'{' | b'}' => 8,
        _ => 1,
    }
}

impl Tokens {
    /// The tokens of the last line.
    pub(super) fn list(&self) -> &[Token] {
        &self.list
    }

    /// Splits a line.
    pub(super) fn split_line(&mut self, line: &[u8], dialect: Dialect) {
        self.list.clear();
        (self.last_cell, self.is_cut) = (0, line.len() > LONGEST_ROW);
        if self.is_cut {
            return;
        }
        let mut gap = Gap::START;
        let mut at = 0;
        while let Some(byte) = line.get(at).copied() {
            if class_of(byte) == SEPARATOR {
                if Some(byte) == dialect.cell {
                    self.last_cell = self.last_cell.saturating_add(1);
                }
                gap.add_separator(byte);
                at += 1;
                continue;
            }
            let (end, classes) = word_end(line, at, dialect);
            self.add_word(line, (at, end), classes, gap, dialect);
            gap = Gap::NONE;
            at = end;
            if self.list.len() > MOST_TOKENS {
                self.is_cut = true;
                return;
            }
        }
    }

    /// Whether a byte takes the place of its number before it.
    fn takes_number(&self, dialect: Dialect, token: Token, gap: Gap) -> bool {
        let is_number = |last: &Token| last.is_byte() && last.is_decimal;
        dialect.numbered_bytes
            && gap.separator == b'='
            && token.is_byte()
            && self.list.last().is_some_and(is_number)
    }

    #[inline]
    fn push(&mut self, token: Token, (start, end): (usize, usize), gap: Gap, dialect: Dialect) {
        let place = |at: usize| u16::try_from(at).unwrap_or(u16::MAX);
        let (start, end) = (place(start), place(end));
        // A date and the time of day after a blank are one time.
        if token.kind == TokenKind::Clock
            && gap.separator == b' '
            && let Some(last) = self.list.last_mut()
            && last.kind == TokenKind::Date
            && last.cell == self.last_cell
        {
            last.end = end;
            return;
        }
        if self.takes_number(dialect, Token { start, end, ..token }, gap)
            && let Some(number) = self.list.last_mut()
        {
            (number.start, number.end, number.is_decimal) = (start, end, token.is_decimal);
            return;
        }
        self.list.push(Token {
            start,
            end,
            gap: gap.separator,
            gap_width: gap.width,
            cell: self.last_cell,
            ..token
        });
    }

    /// Adds a word without separators; it may contain several numbers joined by colons or dashes.
    #[inline]
    fn add_word(
        &mut self,
        line: &[u8],
        (start, end): (usize, usize),
        classes: u8,
        gap: Gap,
        dialect: Dialect,
    ) {
        if classes & !(DIGIT | HEX_LETTER) == 0 {
            let token = Token { is_decimal: classes == DIGIT, ..Token::default() };
            return self.push(token, (start, end), gap, dialect);
        }
        self.add_other(line, (start, end), classes, gap, dialect);
    }

    fn add_other(
        &mut self,
        line: &[u8],
        (mut start, mut end): (usize, usize),
        classes: u8,
        gap: Gap,
        dialect: Dialect,
    ) {
        let text = |start: usize, end: usize| line.get(start..end).unwrap_or_default();
        // Punctuation around a word, such as the colon of a label; arrows and dots are words of their own.
        if classes & (DIGIT | HEX_LETTER | LETTER) != 0 {
            while end > start
                && matches!(text(start, end).last(), Some(b':' | b'.' | b'!' | b'?' | b'\'' | b'>'))
            {
                end -= 1;
            }
            while end > start && matches!(text(start, end).first(), Some(b':' | b'\'' | b'<')) {
                start += 1;
            }
        }
        let word = text(start, end);
        if let Some((token, from, to)) = parse_number(word, dialect) {
            return self.push(token, (start + from, start + to), gap, dialect);
        }
        // `Time:12:01:22.5`: the name, then the time.
        if classes & COLON != 0
            && let Some(colon) = word.iter().position(|byte| *byte == b':')
            && word.iter().take(colon).any(|byte| class_of(*byte) & (LETTER | OTHER) != 0)
        {
            self.push(
                Token { kind: TokenKind::Word, ..Token::default() },
                (start, start + colon),
                gap,
                dialect,
            );
            let gap = Gap { separator: b':', width: 1 };
            return self.add_other(line, (start + colon + 1, end), classes, gap, dialect);
        }
        if classes & (COLON | DASH) != 0
            && let Some(separator) = joined_by(word)
        {
            let mut gap = gap;
            let mut from = start;
            for part in word.split(|byte| *byte == separator) {
                let to = from + part.len();
                match parse_number(part, dialect) {
                    _ if part.is_empty() => {}
                    Some((token, first, last)) => self.push(token, (from + first, from + last), gap, dialect),
                    None => self.push(
                        Token { kind: TokenKind::Word, ..Token::default() },
                        (from, to),
                        gap,
                        dialect,
                    ),
                }
                gap = Gap { separator, width: 1 };
                from = to + 1;
            }
            return;
        }
        self.push(Token { kind: TokenKind::Word, ..Token::default() }, (start, end), gap, dialect);
    }
}

/// Separators before a token.
#[derive(Debug, Clone, Copy)]
struct Gap {
    separator: u8,
    width: u8,
}

impl Gap {
    const START: Self = Self { separator: b' ', width: 0 };
    const NONE: Self = Self { separator: b' ', width: 0 };

    #[inline]
    fn add_separator(&mut self, byte: u8) {
        if strength(byte) > strength(self.separator) {
            self.separator = byte;
        }
        self.width = self.width.saturating_add(1);
    }
}

/// End of the word at `start`, and the classes of its bytes.
#[inline]
fn word_end(line: &[u8], start: usize, dialect: Dialect) -> (usize, u8) {
    let mut classes = 0;
    let mut at = start;
    while let Some(byte) = line.get(at).copied() {
        let class = class_of(byte);
        if class == SEPARATOR {
            let is_digit = |at: Option<usize>| at.and_then(|at| line.get(at)).is_some_and(u8::is_ascii_digit);
            let is_point = byte == b','
                && dialect.decimal_comma
                && is_digit(at.checked_sub(1))
                && is_digit(Some(at + 1))
                && classes & (HEX_LETTER | LETTER | POINT) == 0;
            if !is_point {
                break;
            }
            classes |= POINT;
        }
        classes |= class & !SEPARATOR;
        at += 1;
    }
    (at, classes)
}

/// The separator of a word that consists of numbers joined by colons or by dashes.
fn joined_by(word: &[u8]) -> Option<u8> {
    let is_hex = |part: &[u8]| !part.is_empty() && part.iter().all(u8::is_ascii_hexdigit);
    if word.contains(&b':') {
        return Some(b':');
    }
    let parts = || word.split(|byte| *byte == b'-');
    (parts().count() > 1 && parts().all(|part| part.len() == 2 && is_hex(part))).then_some(b'-')
}

/// Parses a word that is one number: the token, and the start and the end of its digits.
fn parse_number(word: &[u8], dialect: Dialect) -> Option<(Token, usize, usize)> {
    let hex = |digits: &[u8], token: Token, from: usize| {
        let is_hex = !digits.is_empty() && digits.iter().all(u8::is_ascii_hexdigit);
        let is_decimal = digits.iter().all(u8::is_ascii_digit);
        is_hex.then_some((Token { is_decimal, ..token }, from, from + digits.len()))
    };
    let prefixed = Token { has_prefix: true, ..Token::default() };
    match word {
        [b'0', b'x' | b'X', digits @ ..] | [b'\\', b'x', digits @ ..] => return hex(digits, prefixed, 2),
        [b'$', digits @ ..] => return hex(digits, prefixed, 1),
        _ => {}
    }
    if let Some(found) = hex(word, Token::default(), 0) {
        return Some(found);
    }
    let of_kind = |kind| Some((Token { kind, ..Token::default() }, 0, word.len()));
    if word.first().is_some_and(|byte| byte.is_ascii_digit() || matches!(byte, b'-' | b'+' | b'.')) {
        if is_fraction(word) {
            return of_kind(TokenKind::Fraction);
        }
        if is_quantity(word) {
            return of_kind(TokenKind::Quantity);
        }
        if is_clock(word, dialect.colon_bytes) {
            return of_kind(TokenKind::Clock);
        }
        if is_date(word) {
            return of_kind(TokenKind::Date);
        }
    }
    match word {
        [digits @ .., suffix @ (b'h' | b'H' | b'x')] => {
            hex(digits, Token { suffix: suffix.to_ascii_lowercase(), ..Token::default() }, 0)
        }
        _ => None,
    }
}

/// Whether a word is a decimal number with a fraction or a sign.
fn is_fraction(word: &[u8]) -> bool {
    let (has_sign, digits) = match word {
        [b'-' | b'+', digits @ ..] => (true, digits),
        digits => (false, digits),
    };
    let mut points = 0;
    for byte in digits {
        match byte {
            b'.' | b',' => points += 1,
            b'0'..=b'9' => {}
            _ => return false,
        }
    }
    points <= 1 && (has_sign || points == 1) && digits.last().is_some_and(u8::is_ascii_digit)
}

/// Units of time at the end of a number, the longest first.
const UNITS: &[&str] = &["msec", "usec", "sec", "ms", "us", "\u{b5}s", "\u{3bc}s", "ns", "s"];

/// Number and unit of a word such as `12.5ms`.
pub(super) fn split_unit(word: &[u8]) -> (&[u8], &[u8]) {
    let end = word.iter().rposition(u8::is_ascii_digit).map_or(0, |at| at + 1);
    word.split_at_checked(end).unwrap_or((word, &[]))
}

fn is_quantity(word: &[u8]) -> bool {
    let (number, unit) = split_unit(word);
    let is_number = is_fraction(number) || number.iter().all(u8::is_ascii_digit);
    !number.is_empty() && is_number && UNITS.iter().any(|known| known.as_bytes() == unit)
}

/// Whether a word is a time of day: `12:01:22`, `12:01:22.123`, `12:01:22:1234`, `01:22.5`.
fn is_clock(word: &[u8], needs_fraction: bool) -> bool {
    let mut parts = word.split(|byte| *byte == b':');
    let number = |part: Option<&[u8]>| {
        part.filter(|part| !part.is_empty() && part.iter().all(u8::is_ascii_digit)).map(<[u8]>::len)
    };
    let Some(1..=4) = number(parts.next()) else { return false };
    let rest: Vec<&[u8]> = parts.take(4).collect();
    let is_sexagesimal =
        |part: &[u8]| matches!(part, [b'0'..=b'5', b'0'..=b'9']) || matches!(part, [b'0'..=b'9']);
    let is_second = |part: &[u8]| {
        let point = part.iter().position(|byte| matches!(byte, b'.' | b','));
        let (whole, fraction) = part.split_at_checked(point.unwrap_or(part.len())).unwrap_or((part, &[]));
        is_sexagesimal(whole) && fraction.get(1..).unwrap_or_default().iter().all(u8::is_ascii_digit)
    };
    let has_point = |part: &[u8]| part.iter().any(|byte| matches!(byte, b'.' | b','));
    match rest.as_slice() {
        // Minutes and seconds.
        [second] => has_point(second) && is_second(second),
        [minute, second] => {
            is_sexagesimal(minute) && is_second(second) && (has_point(second) || !needs_fraction)
        }
        [minute, second, fraction] => {
            is_sexagesimal(minute)
                && is_sexagesimal(second)
                && matches!(fraction.len(), 3..=9)
                && fraction.iter().all(u8::is_ascii_digit)
        }
        _ => false,
    }
}

/// Whether a word is a date, possibly with a time of day: `2024-05-01`, `01.05.2024`, `2024-05-01T08:17:32.5Z`.
fn is_date(word: &[u8]) -> bool {
    let (day, time, _) = split_date(word);
    let Some(separator) = day.iter().copied().find(|byte| !byte.is_ascii_digit()) else { return false };
    let mut parts = day.split(|byte| *byte == separator);
    let mut width = || parts.next().filter(|part| part.iter().all(u8::is_ascii_digit)).map_or(0, <[u8]>::len);
    let widths = [width(), width(), width()];
    let is_order = matches!(widths, [4, 1..=2, 1..=2] | [1..=2, 1..=2, 4]);
    is_order && matches!(separator, b'-' | b'.' | b'/') && (time.is_empty() || is_clock(time, false))
}

/// Date, time of day and zone of a date such as `2024-05-01T08:17:32.5+02:00`.
pub(super) fn split_date(word: &[u8]) -> (&[u8], &[u8], &[u8]) {
    let at = word.iter().position(|byte| matches!(byte, b'T' | b't' | b'_' | b' '));
    let (day, rest) = word.split_at_checked(at.unwrap_or(word.len())).unwrap_or((word, &[]));
    let time = rest.get(1..).unwrap_or_default().trim_ascii_start();
    let zone = time.iter().position(|byte| !byte.is_ascii_digit() && !matches!(byte, b':' | b'.' | b','));
    let (time, zone) = time.split_at_checked(zone.unwrap_or(time.len())).unwrap_or((time, &[]));
    (day, time, zone)
}

/// Whether the line is blank or consists of rulers, such as the second line of a Markdown table.
pub(super) fn is_ruler(line: &[u8]) -> bool {
    let mut words = ColumnWords::new(line);
    words.all(|word| word.iter().all(|byte| matches!(byte, b'-' | b'=' | b'+' | b'|' | b':' | b'_' | b'*')))
}
