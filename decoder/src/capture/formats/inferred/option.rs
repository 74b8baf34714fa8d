//! Columns that the user states: `--columns 'time:ms id len data'`.

use std::fmt;
use std::str::FromStr;

use super::layout::{DataForm, IdentifierForm, Layout, MOST_COLUMNS, TimeForm};
use super::places::word_places;
use super::proposal::{DataPlaces, is_data_start};
use super::row::{FLAG_BIT, hex_number};
use super::sample::{Sample, numbers_of};
use super::token::{Token, TokenKind};
use super::words::{ColumnRole, TimeUnit};

/// A column that the user states.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub(super) struct StatedColumn {
    pub(super) role: ColumnRole,
    pub(super) unit: Option<TimeUnit>,
    pub(super) is_decimal: bool,
}

/// Columns of the lines of a text capture, in their order: `time:ms id len data`.
///
/// `time` and `delta` (time since the frame before) may have a unit (`s`, `ms`, `0.1ms`, `us`, `ns`); without one, numbers are
/// seconds. `id` and `data` may be decimal (`id:dec`). `len` is a length or DLC. `bus`, `dir`, `kind`, `ext`, `rtr` and `date` are
/// further columns; `skip` is a number or cell without meaning. Words other than bus names are not columns, unless each
/// cell of the lines has a separator.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct ColumnList {
    columns: [StatedColumn; MOST_COLUMNS],
    count: u8,
}

impl ColumnList {
    /// The columns in order.
    pub(super) fn columns(&self) -> &[StatedColumn] {
        self.columns.get(..usize::from(self.count)).unwrap_or_default()
    }
}

impl fmt::Display for ColumnList {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        for (index, column) in self.columns().iter().enumerate() {
            let separator = if index == 0 { "" } else { " " };
            write!(f, "{separator}{}", column.role.name())?;
            match column.unit {
                Some(unit) => write!(f, ":{}", unit.symbol())?,
                None if column.is_decimal => f.write_str(":dec")?,
                None => {}
            }
        }
        Ok(())
    }
}

impl FromStr for ColumnList {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let mut columns = [StatedColumn::default(); MOST_COLUMNS];
        let mut count = 0;
        for word in text.split([' ', ',']).filter(|word| !word.is_empty()) {
            let slot = columns.get_mut(count).ok_or(format!("more than {MOST_COLUMNS} columns"))?;
            *slot = parse_column(word)?;
            count += 1;
        }
        let list = Self { columns, count: u8::try_from(count).unwrap_or(u8::MAX) };
        for role in [ColumnRole::Id, ColumnRole::Data] {
            let count = list.columns().iter().filter(|column| column.role == role).count();
            if count != 1 {
                return Err(format!("{count} columns {}; expected one, as in 'time:s id len data'", role.name()));
            }
        }
        Ok(list)
    }
}

const ROLES: &[ColumnRole] = &[
    ColumnRole::Time,
    ColumnRole::Delta,
    ColumnRole::Date,
    ColumnRole::Id,
    ColumnRole::Length,
    ColumnRole::Data,
    ColumnRole::Bus,
    ColumnRole::Direction,
    ColumnRole::Kind,
    ColumnRole::Extended,
    ColumnRole::Remote,
    ColumnRole::Skip,
];

fn parse_column(word: &str) -> Result<StatedColumn, String> {
    let (name, detail) = word.split_once(':').map_or((word, None), |(name, detail)| (name, Some(detail)));
    let name = if name == "dlc" { "len" } else { name };
    let role = ROLES.iter().copied().find(|role| role.name() == name);
    let names = || ROLES.iter().map(|role| role.name()).collect::<Vec<_>>().join(", ");
    let role = role.ok_or_else(|| format!("unknown column {name:?}; expected {}", names()))?;
    let mut column = StatedColumn { role, ..StatedColumn::default() };
    match (role, detail) {
        (ColumnRole::Time | ColumnRole::Delta, Some(unit)) => {
            column.unit = Some(
                TimeUnit::of_word(unit)
                    .ok_or_else(|| format!("unknown unit {unit:?}; expected s, ms, 0.1ms, us or ns"))?,
            );
        }
        (ColumnRole::Id | ColumnRole::Data, Some("dec")) => column.is_decimal = true,
        (ColumnRole::Id | ColumnRole::Data, Some("hex")) | (_, None) => {}
        (_, Some(detail)) => {
            return Err(format!("{name}:{detail}; expected a unit after time or delta, hex or dec after id or data"));
        }
    }
    Ok(column)
}

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
    let mut data = DataPlaces { start, is_packed, places: Vec::new(), bytes: Vec::new() };
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
            ..DataForm::default()
        },
        id: IdentifierForm {
            is_decimal: of_role(ColumnRole::Id).is_some_and(|column| column.is_decimal),
            ..IdentifierForm::default()
        },
        time: timed.map(|column| TimeForm {
            unit: Some(column.unit.unwrap_or(TimeUnit::Seconds)),
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
    let token = |(index, _): &(usize, usize)| -> Option<(u32, Token)> {
        let line = sample.lines.get(*index)?;
        let numbers = numbers_of(line);
        let found = if has_cells {
            numbers.iter().find(|(_, token)| usize::from(token.cell) == column)
        } else {
            numbers.get(column)
        };
        let (_, token) = found.filter(|(_, token)| token.kind == TokenKind::Hex)?;
        Some((hex_number(token.text(&line.text))?, *token))
    };
    let found: Vec<(u32, Token)> = data.places.iter().filter_map(token).collect();
    let first = found.first().map(|(_, token)| token.width());
    if !layout.id.is_decimal {
        layout.id.has_flag_bit = found.iter().any(|(value, _)| value & FLAG_BIT != 0);
        layout.id.is_wide_extended = found.iter().any(|(_, token)| Some(token.width()) != first);
    }
}
