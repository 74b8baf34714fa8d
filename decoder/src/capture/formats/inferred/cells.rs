//! Proposes layouts of tables whose cells may be empty.

use super::assignment::assign_roles;
use super::data_places::{DataPlaces, is_data_start};
use super::facts::{ColumnFacts, ColumnPlace, agree};
use super::layout::{DataForm, Layout};
use super::places::word_places;
use super::proposal::Proposal;
use super::row::parse_length;
use super::sample::{Sample, SampleLine};
use super::token::Token;
use crate::capture::column_list::ColumnRole;
use crate::capture::column_list::MOST_COLUMNS;

/// Layouts of tables that may fit the sample: each start of the data with each cell that may be the length.
pub(super) fn propose_cells(sample: &Sample) -> Vec<Proposal> {
    let mut all = Vec::new();
    let named = sample.heading.iter().position(|name| name.is_some_and(|name| name.role == ColumnRole::Data));
    // Without a heading, only empty cells require this way of counting.
    if sample.heading_line.is_none() && !sample.lines.iter().any(has_empty_cell) {
        return all;
    }
    let last = usize::from(sample.lines.iter().map(|line| line.tokens.last_cell).max().unwrap_or(0));
    let starts = match named {
        Some(start) => start..start + 1,
        None if sample.heading_line.is_some() => 0..0,
        None => 1..last.min(MOST_COLUMNS - 1) + 1,
    };
    for start in starts {
        for is_packed in [false, true] {
            propose_start(sample, start, last, is_packed, &mut all);
        }
    }
    all
}

/// Whether a cell before the last one with text is empty.
fn has_empty_cell(line: &SampleLine) -> bool {
    let tokens = line.tokens.list();
    let last = tokens.last().map_or(0, |token| token.cell);
    (0..last).any(|cell| tokens.iter().all(|token| token.cell != cell))
}

fn first_of_cell(line: &SampleLine, cell: usize) -> Option<(usize, Token)> {
    let mut tokens = line.tokens.list().iter().enumerate();
    tokens
        .find(|(_, token)| usize::from(token.cell) == cell && token.is_number())
        .map(|(at, token)| (at, *token))
}

/// Data that start in the same cell of each line.
fn data_places(sample: &Sample, start: usize, is_packed: bool) -> Option<DataPlaces> {
    let mut data = DataPlaces { start, is_packed, places: Vec::new(), bytes: Vec::new(), has_cells: true };
    let mut with_data = 0;
    for (index, line) in sample.lines.iter().enumerate() {
        let Some((at, token)) = first_of_cell(line, start) else { continue };
        with_data += 1;
        if is_data_start(token, is_packed) {
            data.places.push((index, at));
            let run = line.tokens.list().iter().skip(at).take(if is_packed { 1 } else { 8 });
            let run = run.take_while(|token| is_data_start(**token, is_packed));
            data.bytes.extend(run.map(|token| (index, *token)));
        }
    }
    let is_long = data.bytes.iter().any(|(_, token)| token.width() >= 4);
    (agree(data.places.len(), with_data) && (is_long || !is_packed)).then_some(data)
}

/// Facts about a cell in the lines with data.
fn cell_facts(sample: &Sample, data: &DataPlaces, cell: usize) -> ColumnFacts {
    let place = |(index, _): &ColumnPlace| {
        sample.lines.get(*index).and_then(|line| first_of_cell(line, cell)).map(|(at, _)| (*index, at))
    };
    let places: Vec<ColumnPlace> = data.places.iter().filter_map(place).collect();
    let heading = sample.heading.get(cell).copied().flatten();
    // Words of a cell are no label: the next cell has its own.
    ColumnFacts { label: None, ..ColumnFacts::new(sample, &places, heading) }
}

/// Whether a cell may contain the length: its name states it, or it has small numbers in each line.
fn may_be_length(sample: &Sample, data: &DataPlaces, facts: &ColumnFacts) -> bool {
    let is_number = |(line, token): &(usize, Token)| {
        let line = sample.lines.get(*line);
        line.is_some_and(|line| parse_length(token.text(&line.text), *token).is_some())
    };
    facts.tokens.len() == data.places.len()
        && match facts.named_role() {
            Some(role) => role == ColumnRole::Length,
            None => facts.tokens.iter().all(is_number),
        }
}

fn propose_start(sample: &Sample, start: usize, last: usize, is_packed: bool, all: &mut Vec<Proposal>) {
    let Some(data) = data_places(sample, start, is_packed) else { return };
    let end = last_data_cell(sample, start, last, is_packed);
    let last = last.min(MOST_COLUMNS - 1);
    let cells: Vec<usize> = (0..=last).filter(|cell| *cell < start || *cell > end).collect();
    let facts: Vec<ColumnFacts> = cells.iter().map(|cell| cell_facts(sample, &data, *cell)).collect();
    let heading = sample.heading.get(start).copied().flatten();
    let payload = ColumnFacts::new(sample, &data.places, heading);
    let is_named = facts.iter().any(|facts| facts.named_role() == Some(ColumnRole::Length));
    let is_length =
        |column: &usize| facts.get(*column).is_some_and(|facts| may_be_length(sample, &data, facts));
    let lengths = (0..facts.len()).filter(is_length).map(Some).chain((!is_named).then_some(None));
    for length in lengths {
        let Some(found) = assign_roles(sample, &facts, &data, &payload, length) else { continue };
        let roles = cell_roles(sample, &cells, &found.roles, (start, end, last));
        let has_label = payload.named_role() == Some(ColumnRole::Data);
        let words = word_places(sample, &data, &roles);
        let layout = Layout {
            dialect: sample.dialect,
            record_start: None,
            before: roles,
            after: Vec::new(),
            last_data_cell: end,
            data: DataForm {
                is_packed,
                is_decimal: found.is_decimal_data,
                has_length: length.is_some(),
                has_label,
                ..DataForm::default()
            },
            data_label: None,
            has_tail: true,
            id: found.id,
            time: found.time,
            words,
        };
        let score = found.score + if has_label { 3 } else { 0 } + if words.has_direction() { 2 } else { 0 };
        all.push(Proposal { layout, score, defect: found.defect, remarks: found.remarks });
    }
}

/// Roles of all cells; cells without numbers have those of their names.
fn cell_roles(
    sample: &Sample,
    cells: &[usize],
    found: &[ColumnRole],
    (start, end, last): (usize, usize, usize),
) -> Vec<ColumnRole> {
    let mut roles = vec![ColumnRole::Skip; last.max(end) + 1];
    for (cell, role) in cells.iter().zip(found) {
        if let Some(slot) = roles.get_mut(*cell) {
            *slot = *role;
        }
    }
    for (slot, name) in roles.iter_mut().zip(&sample.heading) {
        if let Some(name) = name
            && *slot == ColumnRole::Skip
            && matches!(
                name.role,
                ColumnRole::Extended
                    | ColumnRole::Remote
                    | ColumnRole::Bus
                    | ColumnRole::Direction
                    | ColumnRole::Kind
            )
        {
            *slot = name.role;
        }
    }
    for slot in roles.iter_mut().take(end + 1).skip(start) {
        *slot = ColumnRole::Data;
    }
    roles
}

/// Last cell of the data: that of the last numbered name, or of the bytes in further cells.
fn last_data_cell(sample: &Sample, start: usize, last: usize, is_packed: bool) -> usize {
    let is_data = |cell: usize| {
        sample.heading.get(cell).copied().flatten().is_some_and(|name| name.role == ColumnRole::Data)
    };
    let mut end = start;
    while is_data(end + 1) {
        end += 1;
    }
    if is_packed || end > start {
        return end;
    }
    // Each byte has its own cell if no cell of the first column has two.
    let has_two = sample.lines.iter().any(|line| {
        line.tokens
            .list()
            .iter()
            .filter(|token| usize::from(token.cell) == start && token.is_number())
            .count()
            > 1
    });
    let is_byte_cell = |cell: usize| {
        sample.heading.get(cell).copied().flatten().is_none()
            && sample
                .lines
                .iter()
                .all(|line| first_of_cell(line, cell).is_none_or(|(_, token)| token.is_byte()))
            && sample.lines.iter().any(|line| first_of_cell(line, cell).is_some())
    };
    while !has_two && end < last && is_byte_cell(end + 1) {
        end += 1;
    }
    end
}
