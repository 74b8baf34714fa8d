//! Positions of the data in the lines of a sample.

use super::facts::{ColumnFacts, ColumnPlace};
use super::layout::DataForm;
use super::sample::{Sample, label_name, words_before};
use super::token::{Token, TokenKind};
use crate::capture::column_list::ColumnRole;

/// Data that start at the same number of each line.
pub(super) struct DataPlaces {
    /// Number of columns before the data.
    pub(super) start: usize,
    /// Whether the bytes follow each other without separator.
    pub(super) is_packed: bool,
    /// Line and index of the first token of the data.
    pub(super) places: Vec<ColumnPlace>,
    /// The first tokens of the data, at most eight per line.
    pub(super) bytes: Vec<(usize, Token)>,
    /// Whether the data have cells of their own.
    pub(super) has_cells: bool,
}

impl DataPlaces {
    /// The data from the number `start` on.
    pub(super) fn new(
        sample: &Sample,
        numbers: &[Vec<(usize, Token)>],
        start: usize,
        is_packed: bool,
    ) -> Self {
        let mut found = Self { start, is_packed, places: Vec::new(), bytes: Vec::new(), has_cells: false };
        for (index, line) in numbers.iter().enumerate() {
            let Some((at, token)) = line.get(start) else { continue };
            if is_data_start(*token, is_packed) {
                found.places.push((index, *at));
                found.add_bytes(sample, index, *at);
            }
        }
        // Pairs of digits alone are bytes, packed or not.
        let is_long = |(_, token): &(usize, Token)| token.width() >= 4;
        if is_packed && !found.bytes.iter().any(is_long) {
            found.places.clear();
        }
        found
    }

    /// Leaves out the few lines whose numbers before the data are of other types: damaged ones.
    pub(super) fn keep_usual(&mut self, numbers: &[Vec<(usize, Token)>]) {
        let types = |(index, _): &ColumnPlace| -> Vec<TokenKind> {
            let line = numbers.get(*index).map(Vec::as_slice).unwrap_or_default();
            line.iter().take(self.start).map(|(_, token)| token.kind).collect()
        };
        let mut counts: Vec<(Vec<TokenKind>, usize)> = Vec::new();
        for place in &self.places {
            let found = types(place);
            let known = counts.iter().position(|(known, _)| *known == found);
            if let Some((_, count)) = known.and_then(|known| counts.get_mut(known)) {
                *count += 1;
            } else if counts.len() < 20 {
                counts.push((found, 1));
            }
        }
        let usual = counts.into_iter().max_by_key(|(_, count)| *count);
        if let Some((usual, count)) = usual
            && count * 5 >= self.places.len() * 4
        {
            let kept: Vec<ColumnPlace> =
                self.places.iter().filter(|place| types(place) == usual).copied().collect();
            let is_kept = |(line, _): &(usize, Token)| kept.iter().any(|(index, _)| index == line);
            self.bytes.retain(is_kept);
            self.places = kept;
        }
    }

    /// Facts about the first bytes. If a name precedes the data, lines without it have no data.
    pub(super) fn keep_labelled(&mut self, sample: &Sample) -> ColumnFacts {
        let label_of = |(index, at): &ColumnPlace| {
            let words = words_before(sample.lines.get(*index)?, *at);
            let name = label_name(&words)?;
            (name.role == ColumnRole::Data).then(|| words.last().map(|word| word.to_ascii_lowercase()))?
        };
        let label = self.places.iter().find_map(label_of);
        if let Some(label) = label {
            self.places.retain(|place| label_of(place).as_ref() == Some(&label));
            self.bytes.clear();
            for (index, at) in self.places.clone() {
                self.add_bytes(sample, index, at);
            }
        }
        ColumnFacts::new(sample, &self.places, None)
    }

    fn add_bytes(&mut self, sample: &Sample, index: usize, at: usize) {
        let Some(line) = sample.lines.get(index) else { return };
        let run = line.tokens.list().iter().skip(at).take(if self.is_packed { 1 } else { 8 });
        let run = run.take_while(|token| is_data_start(**token, self.is_packed));
        self.bytes.extend(run.map(|token| (index, *token)));
    }
}

/// Whether a number may be the first byte of the data, or all of them.
pub(super) fn is_data_start(token: Token, is_packed: bool) -> bool {
    let is_plain = token.kind == TokenKind::Hex && token.suffix == 0;
    let is_decimal_byte = token.is_decimal && token.width() == 3;
    if is_packed {
        return is_plain && token.width().is_multiple_of(2) && token.width() <= 128;
    }
    is_plain && (token.width() <= 2 || is_decimal_byte)
}

/// Separator and pitch of most bytes.
pub(super) fn byte_distance(sample: &Sample, data: &DataPlaces) -> DataForm {
    let mut counts: Vec<((u8, u8, u8), usize)> = Vec::new();
    for (index, at) in &data.places {
        let Some(line) = sample.lines.get(*index) else { continue };
        let run = line.tokens.list().iter().skip(at + 1).take(7);
        for token in run.take_while(|token| is_data_start(**token, data.is_packed)) {
            let pitch = u8::try_from(token.width()).unwrap_or(u8::MAX).saturating_add(token.gap_width);
            let key = (token.gap, token.gap_width, pitch);
            let known = counts.iter().position(|(known, _)| *known == key);
            if let Some((_, count)) = known.and_then(|known| counts.get_mut(known)) {
                *count += 1;
            } else if counts.len() < 40 {
                counts.push((key, 1));
            }
        }
    }
    let best = counts.iter().max_by_key(|(_, count)| *count);
    let (gap, width, pitch) = best.map_or((b' ', 0, 0), |(key, _)| *key);
    DataForm { separator: (gap, width), pitch, ..DataForm::default() }
}
