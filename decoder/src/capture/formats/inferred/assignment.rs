//! Assigns roles to the columns next to the data.

use super::data_places::DataPlaces;
use super::facts::{ColumnFacts, agree, infer_unit, runs_backwards};
use super::layout::{IdentifierForm, TimeForm};
use super::sample::Sample;
use super::token::{Token, TokenKind, split_date};
use crate::capture::column_list::{ColumnRole, ColumnUnit};

/// Roles of the columns before and after the data.
#[derive(Debug, Clone, Default)]
pub(super) struct RoleAssignment {
    /// Roles in order.
    pub(super) roles: Vec<ColumnRole>,
    /// Form of identifiers.
    pub(super) id: IdentifierForm,
    /// Form of times.
    pub(super) time: Option<TimeForm>,
    /// Whether the bytes are decimal.
    pub(super) is_decimal_data: bool,
    /// Evidence.
    pub(super) score: i32,
    /// Reason why the layout must not be used.
    pub(super) defect: Option<&'static str>,
    /// Ignored parts of the lines.
    pub(super) remarks: Vec<&'static str>,
}

/// Assigns roles; `None` if no column can be the identifier.
pub(super) fn assign_roles(
    sample: &Sample,
    columns: &[ColumnFacts],
    data: &DataPlaces,
    payload: &ColumnFacts,
    length: Option<usize>,
) -> Option<RoleAssignment> {
    let mut found =
        RoleAssignment { roles: vec![ColumnRole::Skip; columns.len()], ..RoleAssignment::default() };
    if let Some(length) = length {
        found.set_role(length, ColumnRole::Length);
        found.score += length_evidence(columns.get(length)?, data, sample);
    }
    // Lines of another layout have other separators.
    if !data.has_cells {
        usual_gap(payload)?;
    }
    let is_record = sample.record_start.is_some();
    let id = found.find_identifier(sample, columns, data, length)?;
    let facts = columns.get(id)?;
    if is_record
        && (facts.named_role() != Some(ColumnRole::Id) || payload.named_role() != Some(ColumnRole::Data))
    {
        return None;
    }
    found.find_base(sample, facts, data, payload);
    found.find_time(sample, columns);
    found.find_others(sample, columns, id);
    Some(found)
}

/// Evidence that a column of small numbers is the length.
fn length_evidence(facts: &ColumnFacts, data: &DataPlaces, sample: &Sample) -> i32 {
    if facts.named_role() == Some(ColumnRole::Length) {
        return 3;
    }
    let all = |test: fn(&Token) -> bool| facts.tokens.iter().all(|(_, token)| test(token));
    if all(|token| matches!(token.gap, b'[' | b'(' | b'{' | b'<')) {
        return 2;
    }
    // A length in the form of a byte may be the first byte: ISO-TP starts with the number of bytes that follow.
    let is_adjacent = |(line, token): &(usize, Token)| {
        let tokens = sample.lines.get(*line).map(|line| line.tokens.list()).unwrap_or_default();
        let at = tokens.iter().position(|other| other == token);
        let next = at.and_then(|at| tokens.get(at + 1));
        let after = at.and_then(|at| tokens.get(at + 2));
        let (Some(next), Some(after)) = (next, after) else { return true };
        next.gap == after.gap && next.gap_width == after.gap_width
    };
    let looks_like_byte = !data.is_packed
        && all(|token| token.width() == 2 && !token.has_prefix)
        && facts.tokens.iter().all(is_adjacent);
    if looks_like_byte { -4 } else { 0 }
}

impl RoleAssignment {
    fn set_role(&mut self, column: usize, role: ColumnRole) {
        if let Some(slot) = self.roles.get_mut(column) {
            *slot = role;
        }
    }

    fn is_free(&self, column: usize) -> bool {
        self.roles.get(column) == Some(&ColumnRole::Skip)
    }

    /// Selects the identifier.
    fn find_identifier(
        &mut self,
        sample: &Sample,
        columns: &[ColumnFacts],
        data: &DataPlaces,
        length: Option<usize>,
    ) -> Option<usize> {
        let score = |(column, facts): (usize, &ColumnFacts)| {
            let score = facts.identifier_score(sample, facts.is_decimal_identifier())?;
            // Identifiers are next to the length or to the data.
            let is_next = column + 1 == length.unwrap_or(data.start);
            (Some(column) != length).then_some((score + i32::from(is_next), column))
        };
        let mut scores: Vec<(i32, usize)> = columns.iter().enumerate().filter_map(score).collect();
        scores.sort_by_key(|(score, column)| (std::cmp::Reverse(*score), *column));
        let (best, id) = scores.first().copied()?;
        if scores.get(1).is_some_and(|(second, _)| best - second < 2 && *second > 0) {
            self.defect = Some("two columns may be the identifier");
        }
        let facts = columns.get(id)?;
        let all = |test: fn(&Token) -> bool| facts.tokens.iter().all(|(_, token)| test(token));
        let is_named = facts.named_role() == Some(ColumnRole::Id);
        let has_mark = all(|token| token.has_prefix || token.suffix != 0);
        let wide = facts.tokens.iter().filter(|(_, token)| token.width() >= 3).count();
        let is_wide = wide * 10 >= facts.tokens.len() * 9;
        let has_other_mark = has_mark && data.bytes.iter().any(|(_, byte)| !byte.has_prefix);
        let is_unlike_data = is_wide || (has_other_mark && wide * 2 >= facts.tokens.len()) || data.is_packed;
        if !is_named && length.is_none() && !is_unlike_data {
            return None;
        }
        if !is_named && !has_mark && all(|token| token.width() == 1) && length.is_none() {
            return None;
        }
        // After the data, an identifier without a name is any number.
        if id >= data.start
            && !is_named
            && length.is_none()
            && !data.has_cells
            && !(has_other_mark && is_wide)
        {
            return None;
        }
        self.score += if is_named { 3 } else { 0 };
        self.score += if has_mark { 2 } else { 0 };
        self.score += i32::from(!all(|token| token.is_decimal));
        self.score += i32::from(all(|token| matches!(token.width(), 3 | 8)));
        if best < 0 {
            return None;
        }
        self.set_role(id, ColumnRole::Id);
        self.id = identifier_form(facts, is_named);
        self.id.least_width = if is_wide && !is_named && length.is_none() { 3 } else { 1 };
        self.id.gap = if data.has_cells { None } else { Some(usual_gap(facts)?) };
        if !self.id.is_decimal && facts.has_unknown_base(sample) {
            self.defect = Some("the identifiers may be decimal or hexadecimal: state id:hex or id:dec");
        }
        Some(id)
    }

    /// Determines whether bytes are hexadecimal.
    fn find_base(&mut self, sample: &Sample, id: &ColumnFacts, data: &DataPlaces, payload: &ColumnFacts) {
        let heading = sample.heading.iter().flatten().find(|name| name.role == ColumnRole::Data);
        let stated = payload.name.and_then(|name| name.is_decimal);
        let stated = stated.or_else(|| heading.and_then(|name| name.is_decimal));
        self.is_decimal_data = stated == Some(true);
        let bytes = &data.bytes;
        let has_letter = bytes.iter().any(|(_, byte)| !byte.is_decimal);
        let has_prefix = bytes.iter().any(|(_, byte)| byte.has_prefix);
        let text = |(line, byte): &(usize, Token)| {
            sample.lines.get(*line).map(|line| byte.text(&line.text)).unwrap_or_default()
        };
        let is_padded = bytes.iter().all(|(_, byte)| byte.width() == 2 || data.is_packed)
            && bytes.iter().any(|byte| text(byte).first() == Some(&b'0'));
        let is_hex = has_letter || has_prefix || is_padded || stated == Some(false);
        self.score += i32::from(has_letter || has_prefix);
        let defect = if self.is_decimal_data {
            let plain = |token: &Token| token.is_decimal && !token.has_prefix && token.suffix == 0;
            let is_open = id.name.is_none_or(|name| name.is_decimal.is_none())
                && !self.id.is_decimal
                && id.tokens.iter().all(|(_, token)| plain(token));
            is_open.then_some("the identifiers may be decimal or hexadecimal: state id:hex or id:dec")
        } else {
            (!is_hex).then_some("the bytes may be decimal or hexadecimal: state data:hex or data:dec")
        };
        self.defect = self.defect.or(defect);
    }

    /// Selects the time.
    fn find_time(&mut self, sample: &Sample, columns: &[ColumnFacts]) {
        let mut rated: Vec<(i32, usize)> = columns
            .iter()
            .enumerate()
            .filter(|(column, _)| self.is_free(*column))
            .filter_map(|(column, facts)| Some((time_rating(facts)?, column)))
            .collect();
        rated.sort_by_key(|(rating, column)| (std::cmp::Reverse(*rating), *column));
        let mut has_time = false;
        for (_, column) in rated {
            let Some(facts) = columns.get(column) else { continue };
            if has_time {
                if self.time.is_some_and(|time| time.unit.is_none()) && facts.is_all(TokenKind::Date) {
                    self.use_date(sample, facts, column);
                }
                continue;
            }
            has_time = self.use_time(sample, facts, column);
        }
        self.join_date(columns, sample);
    }

    /// Uses a column as the time; `false` if it is not one.
    fn use_time(&mut self, sample: &Sample, facts: &ColumnFacts, column: usize) -> bool {
        if facts.is_all(TokenKind::Clock) || facts.is_all(TokenKind::Date) {
            if facts.is_all(TokenKind::Date) && !has_time_of_day(sample, facts) {
                return false;
            }
            let has_date = facts.is_all(TokenKind::Date) && is_clear_date(sample, facts);
            self.time = Some(TimeForm { unit: None, is_delta: false, has_date });
            self.set_role(column, ColumnRole::Time);
            self.score += 2;
            return true;
        }
        let Some(values) = facts.time_values(sample) else { return false };
        let is_delta = facts.named_role() == Some(ColumnRole::Delta);
        let is_named = is_delta || facts.named_role() == Some(ColumnRole::Time);
        if !is_delta && runs_backwards(&values) {
            if is_named {
                self.defect = Some("the times run backwards");
            }
            return false;
        }
        let unit = stated_unit(sample, facts, is_named)
            .or_else(|| (!is_delta).then(|| infer_unit(&values, facts.fraction_digits(sample))).flatten());
        let Some(unit) = unit else {
            self.remarks.push("times ignored, unit unknown: state it as in time:ms");
            return is_named;
        };
        self.time = Some(TimeForm { unit: Some(unit), is_delta, has_date: false });
        self.set_role(column, if is_delta { ColumnRole::Delta } else { ColumnRole::Time });
        self.score += if facts.is_all(TokenKind::Hex) { 1 } else { 2 };
        true
    }

    /// Uses a date in a column of its own.
    fn use_date(&mut self, sample: &Sample, facts: &ColumnFacts, column: usize) {
        if is_clear_date(sample, facts)
            && let Some(time) = &mut self.time
        {
            time.has_date = true;
            self.set_role(column, ColumnRole::Date);
        }
    }

    /// A date in front of a time of day that has no role yet.
    fn join_date(&mut self, columns: &[ColumnFacts], sample: &Sample) {
        let is_of_day = self.time.is_some_and(|time| time.unit.is_none() && !time.has_date);
        let date = columns.iter().position(|facts| facts.is_all(TokenKind::Date));
        if let Some(column) = date.filter(|column| is_of_day && self.is_free(*column))
            && let Some(facts) = columns.get(column)
        {
            self.use_date(sample, facts, column);
        }
    }

    /// Roles of the other columns.
    fn find_others(&mut self, sample: &Sample, columns: &[ColumnFacts], id: usize) {
        let mut ignored = false;
        for (column, facts) in columns.iter().enumerate() {
            if !self.is_free(column) || facts.tokens.is_empty() {
                continue;
            }
            match facts.named_role() {
                Some(role @ (ColumnRole::Bus | ColumnRole::Extended | ColumnRole::Remote)) => {
                    self.set_role(column, role);
                }
                Some(role @ ColumnRole::Length) if column > id => self.set_role(column, role),
                Some(_) => {}
                None if facts.is_counter(sample) => {}
                None if is_bus_number(sample, facts) && column < id => self.set_role(column, ColumnRole::Bus),
                None => ignored = true,
            }
        }
        if ignored {
            self.remarks.push("a column of other numbers ignored");
        } else {
            self.score += 1;
        }
    }
}

fn identifier_form(facts: &ColumnFacts, is_named: bool) -> IdentifierForm {
    let mut widths = facts.tokens.iter().map(|(_, token)| token.width());
    let first = widths.next();
    let is_decimal = facts.is_decimal_identifier();
    IdentifierForm {
        is_decimal,
        least_width: 1,
        gap: None,
        is_wide_extended: !is_decimal && widths.any(|width| Some(width) != first),
        label: if is_named { facts.label.clone() } else { None },
    }
}

/// Separator before nearly all numbers of a column; `None` if they differ.
fn usual_gap(facts: &ColumnFacts) -> Option<u8> {
    let count = |gap: u8| facts.tokens.iter().filter(|(_, token)| token.gap == gap).count();
    let mut gaps = facts.tokens.iter().map(|(_, token)| token.gap).take(8);
    gaps.find(|gap| agree(count(*gap), facts.tokens.len()))
}

/// Evidence that a column contains times; `None` if it cannot.
fn time_rating(facts: &ColumnFacts) -> Option<i32> {
    let is_of_day = facts.is_all(TokenKind::Clock);
    let is_number = facts.tokens.iter().all(|(_, token)| {
        matches!(token.kind, TokenKind::Fraction | TokenKind::Quantity)
            || (token.kind == TokenKind::Hex && token.is_decimal && !token.has_prefix)
    });
    let is_whole = facts.tokens.iter().all(|(_, token)| token.kind == TokenKind::Hex);
    match facts.named_role() {
        _ if facts.tokens.is_empty() => None,
        Some(ColumnRole::Time) => (is_of_day || is_number || facts.is_all(TokenKind::Date)).then_some(6),
        Some(ColumnRole::Delta) => is_number.then_some(1),
        Some(ColumnRole::Date) => facts.is_all(TokenKind::Date).then_some(3),
        Some(_) => None,
        None if is_of_day => Some(5),
        None if facts.is_all(TokenKind::Date) => Some(3),
        None => (is_number && !is_whole).then_some(4),
    }
}

/// Unit that the name or the numbers state.
fn stated_unit(sample: &Sample, facts: &ColumnFacts, is_named: bool) -> Option<ColumnUnit> {
    let heading = sample.heading.iter().flatten();
    let of_heading = || {
        let times = heading.filter(|name| matches!(name.role, ColumnRole::Time | ColumnRole::Delta));
        let mut times = times.filter_map(|name| name.unit);
        let first = times.next();
        first.filter(|_| times.next().is_none())
    };
    let own = facts.name.and_then(|name| name.unit);
    // Each number with a unit states its own.
    let of_numbers = facts.is_all(TokenKind::Quantity).then_some(ColumnUnit::Seconds);
    own.or(of_numbers).or_else(|| if is_named || sample.heading_line.is_some() { of_heading() } else { None })
}

fn has_time_of_day(sample: &Sample, facts: &ColumnFacts) -> bool {
    facts.tokens.iter().all(|(line, token)| {
        sample.lines.get(*line).is_some_and(|line| !split_date(token.text(&line.text)).1.is_empty())
    })
}

/// Whether the order of day and month is known: `2024-05-01` and `01.05.2024`, not `01/05/2024`.
fn is_clear_date(sample: &Sample, facts: &ColumnFacts) -> bool {
    facts.tokens.iter().all(|(line, token)| {
        let text = sample.lines.get(*line).map(|line| token.text(&line.text)).unwrap_or_default();
        let (day, ..) = split_date(text);
        let width = day.iter().take_while(|byte| byte.is_ascii_digit()).count();
        width == 4 || day.contains(&b'.')
    })
}

/// Whether a column without name contains bus numbers: two to four different digits.
fn is_bus_number(sample: &Sample, facts: &ColumnFacts) -> bool {
    let Some(mut values) = facts.decimal_values(sample) else { return false };
    values.sort_unstable();
    values.dedup();
    (2..=4).contains(&values.len()) && values.iter().all(|value| *value <= 9)
}
