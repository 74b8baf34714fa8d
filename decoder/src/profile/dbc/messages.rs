//! Converts messages of a DBC to layouts: skips signals that do not fit and resolves multiplexors.

use std::collections::{BTreeMap, BTreeSet};
use std::ops::RangeInclusive;
use std::sync::Arc;

use can_dbc::{ByteOrder, MultiplexIndicator, NumericValue, ValueType};

use super::file::KnownMessage;
use super::group::as_group;
use super::problem::DbcProblems;
use super::read::{RawDbc, RawMessage, SignalProperties};
use super::signal::DbcSignal;
use super::{
    DatabaseFile, DatabaseMessage, LONGEST_MESSAGE, MOST_MESSAGES, MOST_RANGES, MOST_SIGNALS,
    SuspectParameter,
};
use crate::frame::CanId;
use crate::profile::layout::{
    BitOrder, DEEPEST_SELECTION, FieldSelector, LayoutOrigin, PayloadLayout, SignalField, SignalId,
};
use crate::profile::quoted::quote_start;
use crate::wire::j1939::{J1939Id, Pgn};
use crate::words::count_noun;

/// Origin of the layouts.
const ORIGIN: LayoutOrigin = LayoutOrigin::Dbc;

/// A field whose multiplexor is not yet resolved.
struct PendingField {
    /// Name in the DBC, possibly shortened.
    key: String,
    at: usize,
    field: SignalField,
    /// Name and values of the multiplexor that selects the field.
    selected: Option<(String, Vec<RangeInclusive<u64>>)>,
}

/// Converts the contents of a DBC to a database file.
pub(super) fn convert_file(mut raw: RawDbc, problems: &mut DbcProblems<'_>) -> DatabaseFile {
    let mut file = DatabaseFile::default();
    let mut ids = BTreeMap::new();
    let mut groups = GroupMessages::default();
    let mut parameters = BTreeSet::new();
    for message in std::mem::take(&mut raw.messages) {
        if let Some(other) = ids.get(&message.id) {
            let reason =
                format!("message {} skipped: same identifier as {other}", quote_start(&message.name));
            problems.add_problem(message.at, &reason);
            continue;
        }
        if file.messages.len() >= MOST_MESSAGES {
            problems.add_problem(message.at, &format!("messages from here on skipped (max {MOST_MESSAGES})"));
            break;
        }
        ids.insert(message.id, quote_start(&message.name));
        let (id, at) = (message.id, message.at);
        let about = raw.about.remove(&id).unwrap_or_default();
        let long_name = raw.long_names.remove(&id);
        let Some(message) = build_layout(message, about, long_name, problems) else { continue };
        for field in &message.layout.fields {
            add_parameter(field, &mut parameters, &mut file);
        }
        let message = Arc::new(message);
        let group = groups.group_of(id, &message, at).map(|pgn| (pgn, as_group(pgn, &message)));
        file.messages.push(KnownMessage { id: Some(id), group, message });
    }
    groups.report_others(problems);
    let unknown = raw.about.values().flat_map(BTreeMap::iter);
    for (name, about) in unknown.filter(|_| !ids.is_empty()) {
        problems.add_problem(
            about.at,
            &format!("skipped: signal {} belongs to an unknown message", quote_start(name)),
        );
    }
    file
}

/// First message of each parameter group.
#[derive(Default)]
struct GroupMessages {
    first: BTreeMap<Pgn, Arc<DatabaseMessage>>,
    /// Number of messages that differ from the first one of their group; `at` is the position of the first.
    others: usize,
    at: usize,
}

impl GroupMessages {
    /// Parameter group of a 29-bit message; `None` if an earlier message defines it.
    fn group_of(&mut self, id: CanId, message: &Arc<DatabaseMessage>, at: usize) -> Option<Pgn> {
        let CanId::Extended(id) = id else { return None };
        let pgn = J1939Id::from_identifier(id)?.pgn;
        let Some(first) = self.first.get(&pgn) else {
            self.first.insert(pgn, Arc::clone(message));
            return Some(pgn);
        };
        if (&first.layout, first.length) != (&message.layout, message.length) {
            self.at = if self.others == 0 { at } else { self.at };
            self.others += 1;
        }
        None
    }

    /// Reports one problem in total: a file with 29-bit identifiers other than J1939 can contain many.
    fn report_others(&self, problems: &mut DbcProblems<'_>) {
        if self.others > 0 {
            let reason = format!(
                "messages that differ from an earlier one with the same PGN, matched by identifier only: {}",
                self.others
            );
            problems.add_problem(self.at, &reason);
        }
    }
}

/// Adds the parameter of a field, unless its number is already present.
fn add_parameter(field: &SignalField, known: &mut BTreeSet<u32>, file: &mut DatabaseFile) {
    if let (SignalId::Spn(spn), Some(meaning)) = (field.id, &field.meaning)
        && known.insert(spn)
    {
        let parameter = SuspectParameter { name: meaning.name.clone(), unit: meaning.unit.clone() };
        file.parameters.push((spn, parameter));
    }
}

fn build_layout(
    raw: RawMessage,
    about: BTreeMap<String, SignalProperties>,
    long_name: Option<String>,
    problems: &mut DbcProblems<'_>,
) -> Option<DatabaseMessage> {
    let Some(length) = u16::try_from(raw.length).ok().filter(|length| *length <= LONGEST_MESSAGE) else {
        let reason = format!(
            "message {} skipped: {} bytes (max {LONGEST_MESSAGE})",
            quote_start(&raw.name),
            raw.length
        );
        problems.add_problem(raw.at, &reason);
        return None;
    };
    let root = root_multiplexor(&raw);
    let mut names = BTreeSet::new();
    let mut placed = Vec::new();
    for (at, signal) in raw.signals {
        if placed.len() >= MOST_SIGNALS {
            problems
                .add_problem(at, &format!("signals from here on skipped (max {MOST_SIGNALS} per message)"));
            break;
        }
        let key = signal.name.clone();
        if !names.insert(key.clone()) {
            let reason = format!("duplicate signal {}: its attributes apply to both", quote_start(&key));
            problems.add_problem(at, &reason);
        }
        let mut about = about.get(&key).cloned().unwrap_or_default();
        let selected = selecting_values(&signal, about.selected.take(), root.as_deref());
        match convert_signal(signal, about, length) {
            Ok(field) => placed.push(PendingField { key, at, field, selected }),
            Err(reason) => {
                problems.add_problem(at, &format!("signal {} skipped: {reason}", quote_start(&key)));
            }
        }
    }
    for (name, about) in about.into_iter().filter(|(name, _)| !names.contains(name)) {
        problems.add_problem(about.at, &format!("skipped: the message has no signal {}", quote_start(&name)));
    }
    placed.sort_by_key(|it| first_bit(&it.field));
    let fields = select_fields(&placed, problems);
    let bits = fields.iter().filter_map(SignalField::end).max().unwrap_or(0);
    let layout = PayloadLayout { fields, bits, origin: ORIGIN, ..PayloadLayout::default() };
    let name = long_name.unwrap_or(raw.name);
    Some(DatabaseMessage { name, length: Some(length), layout: Arc::new(layout) })
}

/// First bit of a field, in transmission order.
fn first_bit(field: &SignalField) -> u16 {
    field.end().map_or(u16::MAX, |end| end - field.bits)
}

/// The only multiplexor of a message without a multiplexor of its own.
fn root_multiplexor(raw: &RawMessage) -> Option<String> {
    let mut roots = raw
        .signals
        .iter()
        .filter(|(_, signal)| signal.multiplexer_indicator == MultiplexIndicator::Multiplexor);
    let (_, root) = roots.next()?;
    roots.next().is_none().then(|| root.name.clone())
}

/// Multiplexor name and values that select a signal: from `SG_MUL_VAL_`, otherwise the number after its `m`
/// and the only multiplexor. The name is empty if there is none.
fn selecting_values(
    signal: &can_dbc::Signal,
    extended: Option<(String, Vec<RangeInclusive<u64>>)>,
    root: Option<&str>,
) -> Option<(String, Vec<RangeInclusive<u64>>)> {
    let plain = |value| (root.unwrap_or_default().to_owned(), vec![value..=value]);
    let (name, ranges) = match signal.multiplexer_indicator {
        MultiplexIndicator::Plain => return None,
        MultiplexIndicator::Multiplexor => extended?,
        MultiplexIndicator::MultiplexedSignal(value)
        | MultiplexIndicator::MultiplexorAndMultiplexedSignal(value) => {
            extended.unwrap_or_else(|| plain(value))
        }
    };
    Some((name, join_ranges(ranges)))
}

/// Ranges in ascending order; adjacent and overlapping ones are joined.
fn join_ranges(mut ranges: Vec<RangeInclusive<u64>>) -> Vec<RangeInclusive<u64>> {
    ranges.retain(|range| !range.is_empty());
    ranges.sort_by_key(|range| *range.start());
    let mut joined: Vec<RangeInclusive<u64>> = Vec::new();
    for range in ranges {
        match joined.last_mut() {
            Some(last) if *range.start() <= last.end().saturating_add(1) => {
                *last = *last.start()..=*last.end().max(range.end());
            }
            _ => joined.push(range),
        }
    }
    joined
}

/// Converts a signal to a field.
///
/// # Errors
/// Reason why the signal is skipped, for example that it exceeds the message.
fn convert_signal(
    signal: can_dbc::Signal,
    about: SignalProperties,
    length: u16,
) -> Result<SignalField, String> {
    let Ok(bits @ 1..=64) = u16::try_from(signal.size) else {
        return Err(format!("{} bits; expected 1 to 64", signal.size));
    };
    if about.is_float && !matches!(bits, 32 | 64) {
        return Err(format!("float of {bits} bits; expected 32 or 64"));
    }
    let number = |value: NumericValue| value.to_string().parse::<f64>().unwrap_or(f64::NAN);
    let (least, most) = (number(signal.min), number(signal.max));
    let order = match signal.byte_order {
        ByteOrder::LittleEndian => BitOrder::LittleEndian,
        ByteOrder::BigEndian => BitOrder::BigEndian,
    };
    let spec = DbcSignal {
        name: about.long_name.unwrap_or(signal.name),
        spn: about.spn,
        bit: u16::try_from(signal.start_bit)
            .map_err(|_| format!("start bit {}; expected max 65535", signal.start_bit))?,
        bits,
        order,
        is_signed: signal.value_type == ValueType::Signed,
        is_float: about.is_float,
        factor: signal.factor,
        offset: signal.offset,
        limits: (least < most).then_some([least, most]),
        unit: signal.unit,
        values: about.values,
    };
    let field = spec.into_field();
    match field.end() {
        Some(end) if end <= length * 8 => Ok(field),
        _ => Err(format!("it exceeds the message length of {}", count_noun(length, "byte"))),
    }
}

/// Fields with resolved multiplexors. A field is skipped if its multiplexor is missing or part of a cycle: it
/// could not be distinguished from another one in the same bits.
fn select_fields(placed: &[PendingField], problems: &mut DbcProblems<'_>) -> Vec<SignalField> {
    let reached = reached_names(placed);
    let (there, lost): (Vec<_>, Vec<_>) = placed.iter().partition(|it| it.is_there(&reached));
    for it in lost {
        let by = it.selected.as_ref().map_or("", |(by, _)| by);
        let reason = match by {
            "" => "no unique multiplexor; expected one, or SG_MUL_VAL_".to_owned(),
            by => format!(
                "multiplexor {} missing, cyclic, over {DEEPEST_SELECTION} levels or {MOST_RANGES} ranges",
                quote_start(by)
            ),
        };
        problems.add_problem(it.at, &format!("signal {} skipped: {reason}", quote_start(&it.key)));
    }
    // If two multiplexors have the same name, the first one selects.
    let order: BTreeMap<_, _> =
        there.iter().enumerate().rev().map(|(at, it)| (it.key.as_str(), at)).collect();
    let field = |it: &&PendingField| {
        let mut field = it.field.clone();
        field.present = it.selected.as_ref().and_then(|(by, values)| {
            Some(FieldSelector { field: *order.get(by.as_str())?, values: values.clone() })
        });
        field
    };
    there.iter().map(field).collect()
}

/// Names of fields without a multiplexor, or whose multiplexor is reached within the nesting limit.
fn reached_names(placed: &[PendingField]) -> BTreeSet<&str> {
    let mut reached = BTreeSet::new();
    for _ in 0..DEEPEST_SELECTION {
        let found: BTreeSet<_> =
            placed.iter().filter(|it| it.is_there(&reached)).map(|it| it.key.as_str()).collect();
        if found.len() == reached.len() {
            break;
        }
        reached = found;
    }
    reached
}

impl PendingField {
    /// Whether the field has no multiplexor, or a reached one.
    fn is_there(&self, reached: &BTreeSet<&str>) -> bool {
        let Some((by, ranges)) = &self.selected else { return true };
        reached.contains(by.as_str()) && ranges.len() <= MOST_RANGES
    }
}
