//! Positions of words with a meaning.

use super::data_places::{DataPlaces, is_data_start};
use super::layout::{WORD_POSITIONS, WordPlaces, slot_after};
use super::row::word_position;
use super::sample::{Sample, SampleLine};
use super::token::{Token, names_truth};
use super::words::{LETTER_PAIRS, WordMeaning, column_name, is_bus_name, word_meaning};
use crate::capture::column_list::ColumnRole;
use crate::capture::column_list::MOST_COLUMNS;
use crate::frame::FrameFlags;

/// Maximum number of different words that are counted per position.
const MOST_WORDS: usize = 24;

/// Words at one position of all lines.
#[derive(Debug, Clone, Default)]
struct ColumnWordSet {
    words: Vec<(Vec<u8>, usize)>,
    total: usize,
    others: usize,
}

impl ColumnWordSet {
    fn add_word(&mut self, word: &[u8]) {
        self.total += 1;
        let lower = word.to_ascii_lowercase();
        let known = self.words.iter().position(|(known, _)| *known == lower);
        if let Some((_, count)) = known.and_then(|known| self.words.get_mut(known)) {
            *count += 1;
        } else if self.words.len() < MOST_WORDS {
            self.words.push((lower, 1));
        } else {
            self.others += 1;
        }
    }

    /// Whether the words of the position have a meaning: all are known, or the same in each line.
    fn has_meaning(&self, lines: usize) -> bool {
        let is_constant = |count: usize| count == lines;
        let is_neutral = |(word, count): &&(Vec<u8>, usize)| {
            word_meaning(word).is_some()
                || word.len() == 1
                || is_constant(*count)
                || column_name(word).is_some()
        };
        let neutral: usize = self.words.iter().filter(is_neutral).map(|(_, count)| count).sum();
        let means = |(word, count): &(Vec<u8>, usize)| match word_meaning(word) {
            // A word of all lines does not distinguish them.
            Some(WordMeaning::Flags(flags)) => {
                !is_constant(*count)
                    || !(flags.contains(FrameFlags::ERROR) || flags.contains(FrameFlags::REMOTE))
            }
            Some(WordMeaning::Extended(_)) => true,
            Some(WordMeaning::Nothing) | None => false,
        };
        self.others == 0 && neutral * 5 >= self.total * 4 && self.words.iter().any(means)
    }

    fn is_bus(&self, lines: usize) -> bool {
        self.others == 0
            && self.total * 20 >= lines * 19
            && self.words.iter().all(|(word, _)| is_bus_name(word))
    }
}

impl WordPlaces {
    /// Whether words state more than bus names.
    pub(super) fn has_direction(&self) -> bool {
        self.positions.iter().any(|positions| *positions != 0) || self.letters.iter().any(|pair| *pair != 0)
    }
}

/// Positions with a meaning in the lines with data; `roles` are those of the cells or of the numbers before the data.
pub(super) fn word_places(sample: &Sample, data: &DataPlaces, roles: &[ColumnRole]) -> WordPlaces {
    let mut found: Vec<Vec<ColumnWordSet>> =
        vec![vec![ColumnWordSet::default(); WORD_POSITIONS]; MOST_COLUMNS];
    let mut letters: Vec<Vec<(u8, usize)>> = vec![Vec::new(); MOST_COLUMNS];
    let has_cells = sample.dialect.cell.is_some();
    for (index, at) in &data.places {
        let Some(line) = sample.lines.get(*index) else { continue };
        for_each_word(line, *at, data.is_packed, has_cells, |slot, position, token| {
            let word = token.text(&line.text);
            if let (Some(found), [letter]) = (letters.get_mut(slot), word) {
                let known = found.iter().position(|(known, _)| known == letter);
                if let Some((_, count)) = known.and_then(|known| found.get_mut(known)) {
                    *count += 1;
                } else if found.len() < MOST_WORDS {
                    found.push((*letter, 1));
                }
            }
            if let Some(place) = found.get_mut(slot).and_then(|slot| slot.get_mut(position)) {
                place.add_word(word);
            }
        });
    }
    let lines = data.places.len();
    let mut places = WordPlaces::default();
    for (slot, words) in found.iter().enumerate() {
        // A cell whose heading names a text has no meaning.
        for (position, words) in words.iter().enumerate() {
            if words.total > 0 && words.has_meaning(lines) {
                set_bit(&mut places.positions, slot, position);
            }
            let is_bus_cell = has_cells && roles.get(slot) == Some(&ColumnRole::Bus);
            let is_bus = words.total > 0 && (words.is_bus(lines) || is_bus_cell);
            if is_bus && places.bus.is_none() {
                places.bus = u8::try_from(slot).ok().zip(u8::try_from(position).ok());
            }
        }
        let pair = letters.get(slot).and_then(|found| letter_pair(found, lines));
        if let (Some(pair), Some(target)) = (pair, places.letters.get_mut(slot)) {
            *target = pair;
        }
    }
    places
}

fn set_bit(positions: &mut [u8; MOST_COLUMNS], slot: usize, position: usize) {
    if let Some(positions) = positions.get_mut(slot) {
        *positions |= 1 << position;
    }
}

/// Number of the pair in the table, from 1, if exactly its letters occur; letters of each line, such as units, do not count.
fn letter_pair(found: &[(u8, usize)], lines: usize) -> Option<u8> {
    let found: Vec<u8> =
        found.iter().filter(|(_, count)| *count < lines).map(|(letter, _)| *letter).collect();
    let is_pair =
        |(pair, _): &([u8; 2], _)| found.len() == 2 && pair.iter().all(|letter| found.contains(letter));
    let at = LETTER_PAIRS.iter().position(is_pair)?;
    u8::try_from(at + 1).ok()
}

/// Calls `take` with slot, position and token of each word outside of the data.
fn for_each_word(
    line: &SampleLine,
    data: usize,
    is_packed: bool,
    has_cells: bool,
    mut take: impl FnMut(usize, usize, Token),
) {
    let tokens = line.tokens.list();
    let run = tokens.iter().skip(data).take_while(|token| is_data_start(**token, is_packed)).count();
    let end = data + if is_packed { run.min(1) } else { run };
    let mut numbers = 0;
    let mut at = 0;
    while let Some(token) = tokens.get(at) {
        if token.is_number() {
            numbers += 1;
            at += 1;
            continue;
        }
        let is_part = |other: &&Token| !other.is_number() && (!has_cells || other.cell == token.cell);
        let count = tokens.iter().skip(at).take_while(is_part).count();
        let slot = match at > data {
            _ if has_cells => usize::from(token.cell),
            true => {
                let after = tokens.iter().take(at).skip(end).filter(|token| token.is_number()).count();
                slot_after(after)
            }
            false => numbers,
        };
        for (index, word) in tokens.iter().skip(at).take(count).enumerate() {
            let position = if has_cells { count - index - 1 } else { word_position(index, count, slot) };
            if !names_truth(&line.text, *word, tokens.get(at + index + 1)) {
                take(slot, position, *word);
            }
        }
        at += count;
    }
}
