//! Observations about one column of the sample: names, widths, order of values.

use super::row::{FLAG_BIT, decimal_value, hex_number};
use super::sample::{Sample, label_name, words_before};
use super::token::{Token, TokenKind, names_truth};
use super::words::{ColumnName, column_name};
use crate::capture::column_list::{ColumnRole, ColumnUnit};

/// Share of lines that must agree, in percent.
const AGREEMENT: usize = 90;

/// Whether `part` of `all` lines agree.
pub(super) fn agree(part: usize, all: usize) -> bool {
    all > 0 && part * 100 >= all * AGREEMENT
}

/// Position of a column: line of the sample and index of the token.
pub(super) type ColumnPlace = (usize, usize);

/// A column of the sample.
#[derive(Debug, Clone, Default)]
pub(super) struct ColumnFacts {
    /// Line and token of each number.
    pub(super) tokens: Vec<(usize, Token)>,
    /// Name from the heading or from the words before the numbers.
    pub(super) name: Option<ColumnName>,
    /// Word before each number, in lower case.
    pub(super) label: Option<Vec<u8>>,
}

impl ColumnFacts {
    /// Collects the numbers at `places`; `heading` is the name in the heading.
    pub(super) fn new(sample: &Sample, places: &[ColumnPlace], heading: Option<ColumnName>) -> Self {
        let mut facts = Self { name: heading, ..Self::default() };
        let mut first: Option<Vec<Vec<u8>>> = None;
        let mut equal = [0_usize; 4];
        for (index, at) in places {
            let Some(line) = sample.lines.get(*index) else { continue };
            let Some(token) = line.tokens.list().get(*at) else { continue };
            facts.tokens.push((*index, *token));
            let words: Vec<Vec<u8>> =
                words_before(line, *at).iter().rev().map(|word| word.to_ascii_lowercase()).collect();
            let first = first.get_or_insert_with(|| words.clone());
            let count = first.iter().zip(&words).take_while(|(first, word)| first == word).count();
            equal.iter_mut().take(count + 1).for_each(|equal| *equal += 1);
        }
        let count = (1..=3).rev().find(|count| equal.get(*count).is_some_and(|it| agree(*it, places.len())));
        if let (Some(count), Some(first)) = (count, first) {
            let words: Vec<&[u8]> = first.iter().take(count).rev().map(Vec::as_slice).collect();
            // `CAN 701`: a bus has a short number.
            let is_wide = facts.tokens.iter().all(|(_, token)| token.width() >= 3);
            // `MSG 0x701`: the name of a message has no prefix.
            let is_marked = facts.tokens.iter().all(|(_, token)| token.has_prefix || token.suffix != 0);
            let is_name = |name: &ColumnName| match name.role {
                ColumnRole::Bus => !is_wide,
                ColumnRole::Skip => !is_marked,
                _ => true,
            };
            let name = label_name(&words).filter(is_name);
            let name = name.or_else(|| truth_name(sample, places, words.last()?));
            facts.name = facts.name.or(name);
            // Other words, such as the frame type of most lines, do not belong to the column.
            facts.label = name.and_then(|_| first.first().cloned());
        }
        facts
    }

    /// Role that a name states.
    pub(super) fn named_role(&self) -> Option<ColumnRole> {
        self.name.map(|name| name.role)
    }

    fn is_named(&self, role: ColumnRole) -> bool {
        self.named_role() == Some(role)
    }

    fn texts<'a>(&'a self, sample: &'a Sample) -> impl Iterator<Item = (&'a [u8], Token)> {
        let text = |(index, token): &(usize, Token)| {
            sample.lines.get(*index).map(|line| (token.text(&line.text), *token))
        };
        self.tokens.iter().filter_map(text)
    }

    /// Whether nearly all numbers are of this type.
    pub(super) fn is_all(&self, kind: TokenKind) -> bool {
        self.all(|token| token.kind == kind)
    }

    /// Whether nearly all numbers pass a test; the others may be damaged.
    fn all(&self, test: impl Fn(&Token) -> bool) -> bool {
        agree(self.tokens.iter().filter(|(_, token)| test(token)).count(), self.tokens.len())
    }

    /// Values of a column of decimal digits; `None` if it has others.
    pub(super) fn decimal_values(&self, sample: &Sample) -> Option<Vec<i64>> {
        let value = |(text, token): (&[u8], Token)| {
            let text = std::str::from_utf8(text).ok()?;
            (token.kind == TokenKind::Hex && token.is_decimal && !token.has_prefix).then_some(())?;
            text.parse().ok()
        };
        self.texts(sample).map(value).collect()
    }

    /// Whether the values count the lines, or the frames among them.
    pub(super) fn is_counter(&self, sample: &Sample) -> bool {
        let Some(values) = self.decimal_values(sample) else { return false };
        let counted: Vec<(i64, usize)> =
            values.into_iter().zip(self.tokens.iter().map(|(line, _)| *line)).collect();
        let is_step = |pair: &&[(i64, usize)]| match pair {
            [(first, line), (second, next)] => {
                let lines = i64::try_from(next.saturating_sub(*line)).unwrap_or(0);
                (1..=lines.max(1)).contains(&(second - first))
            }
            _ => false,
        };
        let steps = counted.windows(2).filter(is_step).count();
        counted.len() >= 3 && agree(steps, counted.len() - 1)
    }

    /// Evidence that the column contains identifiers; `None` if it cannot.
    pub(super) fn identifier_score(&self, sample: &Sample, is_decimal: bool) -> Option<i32> {
        match self.named_role() {
            Some(ColumnRole::Id) | None => {}
            Some(_) => return None,
        }
        let valid = |(text, token): (&[u8], Token)| {
            let value = if is_decimal { decimal_value(text) } else { hex_number(text) }?;
            let is_flagged = value & FLAG_BIT != 0 && value & 0x6000_0000 == 0;
            (token.kind == TokenKind::Hex && (value < 0x2000_0000 || is_flagged)).then_some(value)
        };
        let values: Vec<u32> = self.texts(sample).filter_map(valid).collect();
        if !agree(values.len(), self.tokens.len()) {
            return None;
        }
        let mut score = 0;
        let mut add = |points: i32, holds: bool| score += if holds { points } else { 0 };
        let is_wide = self.all(|token| token.width() >= 3);
        let has_mark = self.all(|token| token.has_prefix || token.suffix != 0);
        add(10, self.is_named(ColumnRole::Id));
        add(3, has_mark);
        add(2, !self.all(|token| token.is_decimal));
        add(2, is_wide);
        add(1, self.all(|token| matches!(token.width(), 3 | 4 | 8)));
        add(-6, !self.is_named(ColumnRole::Id) && self.is_counter(sample));
        add(-4, !has_mark && self.all(|token| token.width() == 1));
        let is_rising = values.windows(2).all(|pair| matches!(pair, [a, b] if a <= b));
        let is_long = values.len() >= 4 && values.first() != values.last();
        add(-4, is_long && is_rising && !has_mark && !self.is_named(ColumnRole::Id));
        Some(score)
    }

    /// Whether the identifiers can only be decimal: more than eight digits, or the name states it.
    pub(super) fn is_decimal_identifier(&self) -> bool {
        let is_stated = self.name.and_then(|name| name.is_decimal);
        let is_long = |token: &Token| token.is_decimal && token.width() == 9 && !token.has_prefix;
        is_stated.unwrap_or_else(|| {
            self.all(|token| token.is_decimal && !token.has_prefix && token.suffix == 0)
                && self.tokens.iter().any(|(_, token)| is_long(token))
        })
    }

    /// Whether the identifiers may be hexadecimal or decimal: digits of decimal numbers above 7FFh that would all be
    /// 11-bit identifiers as decimal numbers.
    pub(super) fn has_unknown_base(&self, sample: &Sample) -> bool {
        if self.name.is_some_and(|name| name.is_decimal.is_some()) {
            return false;
        }
        let plain = |token: &Token| token.is_decimal && !token.has_prefix && token.suffix == 0;
        let mut texts = self.texts(sample);
        let is_large =
            |text: &[u8]| text.first() != Some(&b'0') && hex_number(text).is_some_and(|value| value > 0x7FF);
        self.all(plain)
            && self.texts(sample).all(|(text, _)| decimal_value(text).is_some_and(|value| value <= 0x7FF))
            && texts.any(|(text, _)| is_large(text))
    }

    /// Times of the column in its unit, in ns for times of day; `None` if it has other numbers.
    pub(super) fn time_values(&self, sample: &Sample) -> Option<Vec<i128>> {
        let value = |(text, token): (&[u8], Token)| match token.kind {
            TokenKind::Clock | TokenKind::Date | TokenKind::Word => None,
            _ => scaled_value(text),
        };
        self.texts(sample).map(value).collect()
    }

    /// Largest number of digits after the decimal point.
    pub(super) fn fraction_digits(&self, sample: &Sample) -> usize {
        let digits = |text: &[u8]| {
            let point = text.iter().position(|byte| matches!(byte, b'.' | b','));
            point.map_or(0, |point| text.len() - point - 1)
        };
        self.texts(sample).map(|(text, _)| digits(text)).max().unwrap_or(0)
    }
}

/// Name of a column with 0 or 1 for extended identifiers or remote frames.
fn truth_name(sample: &Sample, places: &[ColumnPlace], word: &[u8]) -> Option<ColumnName> {
    let is_named = |(line, at): &ColumnPlace| {
        let Some(line) = sample.lines.get(*line) else { return false };
        let tokens = line.tokens.list();
        let before = at.checked_sub(1).and_then(|before| tokens.get(before));
        before.is_some_and(|before| names_truth(&line.text, *before, tokens.get(*at)))
    };
    let name = column_name(word)?;
    let is_truth = matches!(name.role, ColumnRole::Extended | ColumnRole::Remote);
    (is_truth && places.iter().all(is_named)).then_some(name)
}

/// Value of a number in billionths.
fn scaled_value(text: &[u8]) -> Option<i128> {
    let (number, _) = super::token::split_unit(text);
    let sign = if number.starts_with(b"-") { -1 } else { 1 };
    let digits = number.strip_prefix(b"-").or(number.strip_prefix(b"+")).unwrap_or(number);
    let point = digits.iter().position(|byte| matches!(byte, b'.' | b',')).unwrap_or(digits.len());
    let (whole, fraction) = digits.split_at_checked(point)?;
    let fraction = fraction.get(1..).unwrap_or_default();
    if whole.len() > 19 || fraction.len() > 9 {
        return None;
    }
    let padding = std::iter::repeat_n(&b'0', 9 - fraction.len());
    let mut all = whole.iter().chain(fraction).chain(padding);
    let value = all.try_fold(0_i128, |value, digit| {
        digit.is_ascii_digit().then(|| value * 10 + i128::from(digit - b'0'))
    })?;
    Some(sign * value)
}

/// One unit in [`ColumnFacts::time_values`].
const UNIT: i128 = 1_000_000_000;

/// Whether times run backwards more often than a recorder of several buses explains.
pub(super) fn runs_backwards(values: &[i128]) -> bool {
    let back = values.windows(2).filter(|pair| matches!(pair, [a, b] if b < a)).count();
    back * 10 > values.len()
}

/// Minimum distance of two frames in µs: 47 bits at 1 Mbit/s (ISO 11898-1).
const CLOSEST: i128 = 47 * UNIT;

/// The same at 500 kbit/s.
const USUAL_CLOSEST: i128 = 94 * UNIT;

/// Unit of times without one; `None` if it cannot be inferred.
///
/// Whole numbers are µs or ms. Two frames closer than the bus permits in µs exclude µs.
pub(super) fn infer_unit(values: &[i128], fraction_digits: usize) -> Option<ColumnUnit> {
    let mut steps: Vec<i128> = values
        .windows(2)
        .filter_map(|pair| {
            matches!(pair, [a, b] if b >= a).then(|| pair.last()?.checked_sub(*pair.first()?)).flatten()
        })
        .collect();
    steps.sort_unstable();
    let median = steps.get(steps.len() / 2).copied().unwrap_or(0);
    let first = values.first().copied().unwrap_or(0) / UNIT;
    let may_be_seconds = (1_000_000_000..2_000_000_000).contains(&first);
    if fraction_digits > 0 {
        // One digit suffices for seconds since 1970, of 2001 to 2033.
        let is_precise = fraction_digits >= 2 || may_be_seconds;
        let is_seconds = fraction_digits >= 5 || (is_precise && median < 5 * UNIT);
        return is_seconds.then_some(ColumnUnit::Seconds);
    }
    match first {
        1_000_000_000_000..=9_999_999_999_999 => return Some(ColumnUnit::Milliseconds),
        1_000_000_000_000_000..=9_999_999_999_999_999 => return Some(ColumnUnit::Microseconds),
        _ => {}
    }
    let least = steps.iter().copied().find(|step| *step > 0)?;
    let largest = steps.last().copied().unwrap_or(0);
    if may_be_seconds && largest <= 2 * UNIT {
        return None;
    }
    (least < CLOSEST || least < USUAL_CLOSEST).then_some(ColumnUnit::Milliseconds)
}
