//! Layouts of the columns that the user states.

use super::data_places::{DataPlaces, is_data_start};
use super::layout::{DataForm, IdentifierForm, Layout, TimeForm};
use super::places::word_places;
use super::sample::{Sample, numbers_of};
use super::token::{Token, TokenKind};
use crate::capture::column_list::{ColumnRole, ColumnUnit, MOST_COLUMNS, StatedColumn};

/// Layouts with the stated columns for the lines of a sample.
pub(super) fn stated_layouts(sample: &Sample, columns: &[StatedColumn]) -> Vec<Layout> {
    if sample.dialect.cell.is_some() {
        return [false, true].iter().filter_map(|packed| stated_layout(sample, columns, *packed)).collect();
    }
    // A bus name or the direction may be a number or a word.
    let without = |leaves: &[ColumnRole]| -> Vec<StatedColumn> {
        columns.iter().filter(|column| !leaves.contains(&column.role)).copied().collect()
    };
    let words = [ColumnRole::Direction, ColumnRole::Kind, ColumnRole::Extended, ColumnRole::Remote];
    let with_bus = [&words[..], &[ColumnRole::Bus]].concat();
    let mut all = Vec::new();
    for numbers in [without(&words), without(&with_bus)] {
        all.extend([false, true].iter().filter_map(|packed| stated_layout(sample, &numbers, *packed)));
    }
    all
}

fn stated_layout(sample: &Sample, columns: &[StatedColumn], is_packed: bool) -> Option<Layout> {
    let has_cells = sample.dialect.cell.is_some();
    let start = columns.iter().position(|column| column.role == ColumnRole::Data)?;
    let mut data = DataPlaces { start, is_packed, places: Vec::new(), bytes: Vec::new(), has_cells: false };
    for (index, line) in sample.lines.iter().enumerate() {
        let numbers = numbers_of(line);
        let place = if has_cells {
            numbers.iter().find(|(_, token)| usize::from(token.cell) == start)
        } else {
            numbers.get(start)
        };
        if let Some((at, token)) = place
            && is_data_start(*token, is_packed)
        {
            data.places.push((index, *at));
        }
    }
    let roles: Vec<ColumnRole> = columns.iter().map(|column| column.role).collect();
    let (before, after) = if has_cells {
        (roles.clone(), Vec::new())
    } else {
        (roles.get(..start)?.to_vec(), roles.get(start + 1..)?.to_vec())
    };
    let of_role = |role: ColumnRole| columns.iter().find(|column| column.role == role);
    let timed = of_role(ColumnRole::Time).or_else(|| of_role(ColumnRole::Delta));
    let words = word_places(sample, &data, &before);
    let is_decimal = of_role(ColumnRole::Data).is_some_and(|column| column.is_decimal);
    let mut layout = Layout {
        dialect: sample.dialect,
        record_start: sample.record_start.clone(),
        before,
        after,
        last_data_cell: start,
        data: DataForm {
            is_packed,
            is_decimal,
            has_length: of_role(ColumnRole::Length).is_some(),
            has_label: true,
            ..super::data_places::byte_distance(sample, &data)
        },
        data_label: None,
        has_tail: true,
        id: IdentifierForm {
            is_decimal: of_role(ColumnRole::Id).is_some_and(|column| column.is_decimal),
            ..IdentifierForm::default()
        },
        time: timed.map(|column| TimeForm {
            unit: Some(column.unit.unwrap_or(ColumnUnit::Seconds)),
            is_delta: column.role == ColumnRole::Delta,
            has_date: true,
        }),
        words,
    };
    if has_cells && start + 1 == columns.len() && !is_packed {
        // The bytes may have a cell each.
        layout.before.resize(MOST_COLUMNS.max(start + 64), ColumnRole::Data);
        layout.last_data_cell = layout.before.len();
    }
    learn_identifiers(sample, &data, &mut layout);
    Some(layout)
}

/// Determines how the sample marks extended identifiers.
fn learn_identifiers(sample: &Sample, data: &DataPlaces, layout: &mut Layout) {
    let Some(column) = layout.before.iter().position(|role| *role == ColumnRole::Id) else { return };
    let has_cells = layout.dialect.cell.is_some();
    let token = |(index, _): &(usize, usize)| -> Option<Token> {
        let line = sample.lines.get(*index)?;
        let numbers = numbers_of(line);
        let found = if has_cells {
            numbers.iter().find(|(_, token)| usize::from(token.cell) == column)
        } else {
            numbers.get(column)
        };
        found.map(|(_, token)| *token).filter(|token| token.kind == TokenKind::Hex)
    };
    let found: Vec<Token> = data.places.iter().filter_map(token).collect();
    let first = found.first().map(Token::width);
    if !layout.id.is_decimal {
        layout.id.is_wide_extended = found.iter().any(|token| Some(token.width()) != first);
    }
}
