//! Proposes layouts for a sample: each start of the data with each column that may be the length.

use super::assignment::{RoleAssignment, assign_roles};
use super::data_places::{DataPlaces, byte_distance, is_data_start};
use super::facts::{ColumnFacts, ColumnPlace, agree};
use super::layout::{DataForm, Layout};
use super::row::parse_length;
use super::sample::{Sample, number_names, numbers_of};
use super::token::Token;
use crate::capture::column_list::ColumnRole;
use crate::capture::column_list::MOST_COLUMNS;

/// Maximum number of columns before the data.
const MOST_BEFORE: usize = 10;

/// Maximum number of columns after the data.
const MOST_AFTER: usize = 8;

/// A layout that may fit, with the evidence that does not depend on its frames.
#[derive(Debug, Clone, Default)]
pub(super) struct Proposal {
    /// The layout.
    pub(super) layout: Layout,
    /// Evidence for it.
    pub(super) score: i32,
    /// Reason why it must not be used.
    pub(super) defect: Option<&'static str>,
    /// Ignored parts of the lines.
    pub(super) remarks: Vec<&'static str>,
}

/// Layouts that may fit the sample.
pub(super) fn propose_layouts(sample: &Sample) -> Vec<Proposal> {
    let numbers: Vec<Vec<(usize, Token)>> = sample.lines.iter().map(numbers_of).collect();
    let mut all = Vec::new();
    for start in 0..=MOST_BEFORE {
        let lines = numbers.iter().filter(|numbers| numbers.len() > start.max(1)).count().max(1);
        for is_packed in [false, true] {
            let mut data = DataPlaces::new(sample, &numbers, start, is_packed);
            data.keep_usual(&numbers);
            let payload = data.keep_labelled(sample);
            let is_named = payload.named_role() == Some(ColumnRole::Data);
            if data.places.len() * 5 >= lines || (is_named && data.places.len() >= 2) {
                propose_lengths(sample, &numbers, &data, &payload, &mut all);
            }
        }
    }
    all
}

/// Adds a layout without length, and one for each column that may be the length.
fn propose_lengths(
    sample: &Sample,
    numbers: &[Vec<(usize, Token)>],
    data: &DataPlaces,
    payload: &ColumnFacts,
    all: &mut Vec<Proposal>,
) {
    let names = number_names(sample, data.start);
    // A heading that does not fit the columns is evidence against them.
    let penalty = if sample.heading_line.is_some() && names.is_none() { 4 } else { 0 };
    let heading = names.unwrap_or_default();
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
    let is_length = |column: &usize| {
        facts.get(*column).is_some_and(|facts| match facts.named_role() {
            Some(ColumnRole::Length) => true,
            // `Data 8`: a frame type before the length.
            Some(ColumnRole::Data) if facts.label.is_none() => false,
            Some(ColumnRole::Data) | None => facts.tokens.iter().all(|(line, token)| {
                sample
                    .lines
                    .get(*line)
                    .is_some_and(|line| parse_length(token.text(&line.text), *token).is_some())
            }),
            Some(_) => false,
        })
    };
    let is_named = facts.iter().any(|facts| facts.named_role() == Some(ColumnRole::Length));
    let lengths = (0..data.start).filter(is_length).map(Some);
    for length in lengths.chain((!is_named).then_some(None)) {
        let columns = [&facts[..], &after[..]].concat();
        let Some(found) = assign_roles(sample, &columns, data, payload, length) else { continue };
        let is_byte = data.start.checked_sub(1).and_then(|last| found.roles.get(last)).is_some_and(|role| {
            let is_counter = facts.last().is_some_and(|facts| facts.is_counter(sample));
            matches!(role, ColumnRole::Skip | ColumnRole::Bus)
                && !is_counter
                && continues_column(sample, data)
        });
        if !is_byte {
            let proposal = build_proposal(sample, data, payload, length.is_some(), found, after.len());
            all.push(Proposal { score: proposal.score - penalty, ..proposal });
        }
    }
}

/// Whether the number before the data has the form and the distance of their bytes: it is one of them.
fn continues_column(sample: &Sample, data: &DataPlaces) -> bool {
    let form = byte_distance(sample, data);
    let is_joined = |(index, at): &&ColumnPlace| {
        let tokens = sample.lines.get(*index).map(|line| line.tokens.list()).unwrap_or_default();
        let before = at.checked_sub(1).and_then(|before| tokens.get(before));
        let (Some(before), Some(first)) = (before, tokens.get(*at)) else { return false };
        let gap = (first.gap, first.gap_width);
        before.is_byte()
            && (gap == form.separator || (form.separator.1 == 0 && gap == (before.gap, before.gap_width)))
    };
    !data.is_packed && data.places.iter().filter(is_joined).count() * 10 >= data.places.len() * 3
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
    let has_tail = has_length && has_tail(sample, data, after.len());
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
        data_label: payload.label.clone().filter(|_| has_label),
        has_tail,
        id: found.id,
        time: found.time,
    };
    let mut score = found.score;
    score += if has_label { 3 } else { 0 };
    score += if layout.words.has_direction() { 2 } else { 0 };
    Proposal { layout, score, defect: found.defect, remarks: found.remarks }
}

/// Whether lines have more numbers after the data than these columns.
fn has_tail(sample: &Sample, data: &DataPlaces, columns: usize) -> bool {
    data.places.iter().any(|(index, at)| {
        let tokens = sample.lines.get(*index).map(|line| line.tokens.list()).unwrap_or_default();
        let is_byte = |token: &&Token| is_data_start(**token, data.is_packed);
        let run = tokens.iter().skip(*at).take_while(is_byte).count();
        tokens.iter().skip(at + run).filter(|token| token.is_number()).count() > columns
    })
}
