//! Proposes layouts for a sample: each start of the data with each column that may be the length.

use super::assignment::{RoleAssignment, assign_roles};
use super::facts::{ColumnFacts, ColumnPlace, agree};
use super::layout::{DataForm, Layout, MOST_COLUMNS};
use super::row::parse_length;
use super::sample::{Sample, number_names, numbers_of};
use super::token::{Token, TokenKind};
use super::words::ColumnRole;

/// Maximum number of columns before the data.
const MOST_BEFORE: usize = 10;

/// Maximum number of columns after the data.
const MOST_AFTER: usize = 4;

/// A layout that may fit, with the evidence that does not depend on its frames.
#[derive(Debug, Clone, Default)]
pub(super) struct Proposal {
    /// The layout.
    pub(super) layout: Layout,
    /// Evidence for it.
    pub(super) score: i32,
    /// Reason why it must not be used.
    pub(super) defect: Option<&'static str>,
    /// What it ignores.
    pub(super) remarks: Vec<&'static str>,
}

/// Layouts that may fit the sample.
pub(super) fn propose_layouts(sample: &Sample) -> Vec<Proposal> {
    let numbers: Vec<Vec<(usize, Token)>> = sample.lines.iter().map(numbers_of).collect();
    if sample.dialect.cell.is_some() {
        return super::cells::propose_cells(sample);
    }
    let lines = numbers.iter().filter(|numbers| numbers.len() >= 2).count().max(1);
    let mut all = Vec::new();
    for start in 0..=MOST_BEFORE {
        for is_packed in [false, true] {
            let data = DataPlaces::new(sample, &numbers, start, is_packed);
            if data.places.len() * 2 >= lines {
                propose_lengths(sample, &numbers, &data, &mut all);
            }
        }
    }
    all
}

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
}

impl DataPlaces {
    fn new(sample: &Sample, numbers: &[Vec<(usize, Token)>], start: usize, is_packed: bool) -> Self {
        let mut found = Self { start, is_packed, places: Vec::new(), bytes: Vec::new() };
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
    match is_packed {
        true => is_plain && token.width() % 2 == 0 && token.width() <= 128,
        false => is_plain && (token.width() <= 2 || is_decimal_byte),
    }
}

/// Adds a layout without length, and one for each column that may be the length.
fn propose_lengths(
    sample: &Sample,
    numbers: &[Vec<(usize, Token)>],
    data: &DataPlaces,
    all: &mut Vec<Proposal>,
) {
    let heading = number_names(&sample.heading, data.start).unwrap_or_default();
    let facts: Vec<ColumnFacts> = (0..data.start)
        .map(|column| {
            let place = |(line, _): &ColumnPlace| {
                numbers.get(*line).and_then(|numbers| numbers.get(column)).map(|(at, _)| (*line, *at))
            };
            let places: Vec<ColumnPlace> = data.places.iter().filter_map(place).collect();
            ColumnFacts::new(sample, &places, heading.get(column).copied().flatten())
        })
        .collect();
    let after = facts_after(sample, data);
    let payload = ColumnFacts::new(sample, &data.places, None);
    let is_length = |column: &usize| {
        facts.get(*column).is_some_and(|facts| match facts.named_role() {
            Some(role) => role == ColumnRole::Length,
            None => facts.tokens.iter().all(|(line, token)| {
                sample.lines.get(*line).is_some_and(|line| parse_length(token.text(&line.text), *token).is_some())
            }),
        })
    };
    let is_named = facts.iter().any(|facts| facts.named_role() == Some(ColumnRole::Length));
    let lengths = (0..data.start).filter(is_length).map(Some);
    for length in lengths.chain((!is_named).then_some(None)) {
        let columns = [&facts[..], &after[..]].concat();
        let Some(found) = assign_roles(sample, &columns, data, &payload, length) else { continue };
        all.push(build_proposal(sample, data, &payload, length.is_some(), found, after.len()));
    }
}

/// Columns after the data: numbers that are not joined to the bytes.
fn facts_after(sample: &Sample, data: &DataPlaces) -> Vec<ColumnFacts> {
    let mut places: Vec<Vec<ColumnPlace>> = vec![Vec::new(); MOST_AFTER];
    for (index, at) in &data.places {
        let Some(line) = sample.lines.get(*index) else { continue };
        let tokens = line.tokens.list();
        let run = tokens.iter().skip(*at).take_while(|token| is_data_start(**token, data.is_packed)).count();
        let run = if data.is_packed { run.min(1) } else { run };
        let rest = tokens.iter().enumerate().skip(at + run).filter(|(_, token)| token.is_number());
        for (place, (at, _)) in places.iter_mut().zip(rest) {
            place.push((*index, at));
        }
    }
    let used = places.iter().position(|place| !agree(place.len(), data.places.len())).unwrap_or(MOST_AFTER);
    places.iter().take(used).map(|places| ColumnFacts::new(sample, places, None)).collect()
}

fn build_proposal(
    sample: &Sample,
    data: &DataPlaces,
    payload: &ColumnFacts,
    has_length: bool,
    found: RoleAssignment,
    after: usize,
) -> Proposal {
    let mut before = found.roles.clone();
    let after = before.split_off(before.len().saturating_sub(after).min(MOST_COLUMNS));
    let has_label = payload.named_role() == Some(ColumnRole::Data);
    let layout = Layout {
        dialect: sample.dialect,
        record_start: sample.record_start.clone(),
        words: super::places::word_places(sample, data, &before),
        before,
        after,
        last_data_cell: 0,
        data: DataForm {
            is_packed: data.is_packed,
            is_decimal: found.is_decimal_data,
            has_length,
            has_label,
            ..byte_distance(sample, data)
        },
        id: found.id,
        time: found.time,
    };
    let mut score = found.score;
    score += if has_label { 3 } else { 0 };
    score += if layout.words.has_direction() { 2 } else { 0 };
    Proposal { layout, score, defect: found.defect, remarks: found.remarks }
}

/// Separator and pitch of the second byte in most lines.
fn byte_distance(sample: &Sample, data: &DataPlaces) -> DataForm {
    let mut counts: Vec<((u8, u8, u8), usize)> = Vec::new();
    for (index, at) in &data.places {
        let Some(line) = sample.lines.get(*index) else { continue };
        let second = line.tokens.list().get(at + 1).filter(|token| is_data_start(**token, data.is_packed));
        let Some(token) = second else { continue };
        let pitch = u8::try_from(token.width()).unwrap_or(u8::MAX).saturating_add(token.gap_width);
        let key = (token.gap, token.gap_width, pitch);
        match counts.iter_mut().find(|(known, _)| *known == key) {
            Some((_, count)) => *count += 1,
            None => counts.push((key, 1)),
        }
    }
    let best = counts.iter().max_by_key(|(_, count)| *count);
    let (gap, width, pitch) = best.map_or((b' ', 0, 0), |(key, _)| *key);
    DataForm { separator: (gap, width), pitch, ..DataForm::default() }
}
