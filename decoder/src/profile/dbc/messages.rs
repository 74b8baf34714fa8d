//! Messages of a DBC to layouts: signals that do not fit are left out, multiplexed ones find what selects them.

use std::collections::{BTreeMap, BTreeSet};
use std::ops::RangeInclusive;
use std::sync::Arc;

use can_dbc::{ByteOrder, MultiplexIndicator, NumericValue, ValueType};

use super::file::Known;
use super::problem::Problems;
use super::read::{About, Raw, RawMessage};
use super::signal::Signal;
use super::{
    DatabaseFile, DatabaseMessage, LONGEST_MESSAGE, MOST_MESSAGES, MOST_RANGES, MOST_SIGNALS, Parameter,
};
use crate::frame::CanId;
use crate::profile::layout::{BitOrder, DEEPEST_SELECTION, Field, Layout, Selector, SignalId};
use crate::profile::quoted::quote;
use crate::wire::j1939::{J1939Id, Pgn};
use crate::words::plural;

/// Where a layout comes from.
const ORIGIN: &str = "dbc";

/// A field before what selects it has a place.
struct Placed {
    /// Name within the DBC, cut as it may be.
    key: String,
    at: usize,
    field: Field,
    /// What selects it: name and values.
    selected: Option<(String, Vec<RangeInclusive<u64>>)>,
}

/// Everything a DBC says as database.
pub(super) fn file(mut raw: Raw, problems: &mut Problems<'_>) -> DatabaseFile {
    let mut file = DatabaseFile::default();
    let mut ids = BTreeMap::new();
    let mut groups = Groups::default();
    let mut parameters = BTreeSet::new();
    for message in std::mem::take(&mut raw.messages) {
        if let Some(other) = ids.get(&message.id) {
            let reason =
                format!("message {} left out: its identifier is that of {other}", quote(&message.name));
            problems.add(message.at, &reason);
            continue;
        }
        if file.messages.len() >= MOST_MESSAGES {
            problems.add(message.at, &format!("not read from here on: more than {MOST_MESSAGES} messages"));
            break;
        }
        ids.insert(message.id, quote(&message.name));
        let (id, at) = (message.id, message.at);
        let about = raw.about.remove(&id).unwrap_or_default();
        let long_name = raw.long_names.remove(&id);
        let Some(message) = layout(message, about, long_name, problems) else { continue };
        for field in &message.layout.fields {
            parameter(field, &mut parameters, &mut file);
        }
        let message = Arc::new(message);
        let pgn = groups.of(id, &message, at);
        file.messages.push(Known { id: Some(id), pgn, message });
    }
    groups.tell(problems);
    let unknown = raw.about.values().flat_map(BTreeMap::iter);
    for (name, about) in unknown.filter(|_| !ids.is_empty()) {
        problems
            .add(about.at, &format!("left out: it is about signal {} of an unknown message", quote(name)));
    }
    file
}

/// Parameter groups and the first message of each.
#[derive(Default)]
struct Groups {
    first: BTreeMap<Pgn, Arc<DatabaseMessage>>,
    /// Messages that say something else of a group than its first one, and where the first of them is.
    others: usize,
    at: usize,
}

impl Groups {
    /// The parameter group a message of 29 bits stands for, unless one before it does already.
    fn of(&mut self, id: CanId, message: &Arc<DatabaseMessage>, at: usize) -> Option<Pgn> {
        let CanId::Extended(id) = id else { return None };
        let pgn = J1939Id::of(id)?.pgn;
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

    /// A file of identifiers that are no J1939 has many, so they are one problem.
    fn tell(&self, problems: &mut Problems<'_>) {
        if self.others > 0 {
            let reason = format!(
                "messages that count by their identifier only, because another one has their PGN, from here on: {}",
                self.others
            );
            problems.add(self.at, &reason);
        }
    }
}

/// Notes the parameter of a field, if it is the first of its number.
fn parameter(field: &Field, known: &mut BTreeSet<u32>, file: &mut DatabaseFile) {
    if let (SignalId::Spn(spn), Some(meaning)) = (field.id, &field.meaning)
        && known.insert(spn)
    {
        let parameter = Parameter { name: meaning.name.clone(), unit: meaning.unit.clone() };
        file.parameters.push((spn, parameter));
    }
}

fn layout(
    raw: RawMessage,
    about: BTreeMap<String, About>,
    long_name: Option<String>,
    problems: &mut Problems<'_>,
) -> Option<DatabaseMessage> {
    let Some(length) = u16::try_from(raw.length).ok().filter(|length| *length <= LONGEST_MESSAGE) else {
        let reason = format!(
            "message {} left out: {} bytes are more than {LONGEST_MESSAGE}",
            quote(&raw.name),
            raw.length
        );
        problems.add(raw.at, &reason);
        return None;
    };
    let root = root(&raw);
    let mut names = BTreeSet::new();
    let mut placed = Vec::new();
    for (at, signal) in raw.signals {
        if placed.len() >= MOST_SIGNALS {
            problems.add(at, &format!("signals left out from here on: more than {MOST_SIGNALS}"));
            break;
        }
        let key = signal.name.clone();
        if !names.insert(key.clone()) {
            let reason = format!("a second signal {}: what is told of one counts for both", quote(&key));
            problems.add(at, &reason);
        }
        let mut about = about.get(&key).cloned().unwrap_or_default();
        let selected = selected(&signal, about.selected.take(), root.as_deref());
        match field(signal, about, length) {
            Ok(field) => placed.push(Placed { key, at, field, selected }),
            Err(reason) => problems.add(at, &format!("signal {} left out: {reason}", quote(&key))),
        }
    }
    for (name, about) in about.into_iter().filter(|(name, _)| !names.contains(name)) {
        problems.add(about.at, &format!("left out: its message has no signal {}", quote(&name)));
    }
    placed.sort_by_key(|it| start(&it.field));
    let fields = select(&placed, problems);
    let bits = fields.iter().filter_map(Field::end).max().unwrap_or(0);
    let layout = Layout { fields, bits, origin: ORIGIN, ..Layout::default() };
    let name = long_name.unwrap_or(raw.name);
    Some(DatabaseMessage { name, length: Some(length), layout: Arc::new(layout) })
}

/// Where a field begins, bits in the order they are sent.
fn start(field: &Field) -> u16 {
    field.end().map_or(u16::MAX, |end| end - field.bits)
}

/// The one multiplexor of a message that is not selected itself.
fn root(raw: &RawMessage) -> Option<String> {
    let mut roots = raw
        .signals
        .iter()
        .filter(|(_, signal)| signal.multiplexer_indicator == MultiplexIndicator::Multiplexor);
    let (_, root) = roots.next()?;
    roots.next().is_none().then(|| root.name.clone())
}

/// What selects a signal: what `SG_MUL_VAL_` says, else the number behind its `m` and the one multiplexor. Of one
/// that finds none the name is empty.
fn selected(
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
    Some((name, joined(ranges)))
}

/// Ranges in ascending order, those that touch as one.
fn joined(mut ranges: Vec<RangeInclusive<u64>>) -> Vec<RangeInclusive<u64>> {
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

/// A signal where its place is within the message; otherwise the reason.
fn field(signal: can_dbc::Signal, about: About, length: u16) -> Result<Field, String> {
    let Ok(bits @ 1..=64) = u16::try_from(signal.size) else {
        return Err(format!("{} bits, of which 1 to 64 are read", signal.size));
    };
    if about.is_float && !matches!(bits, 32 | 64) {
        return Err(format!("no floating point number has {bits} bits"));
    }
    let number = |value: NumericValue| value.to_string().parse::<f64>().unwrap_or(f64::NAN);
    let (least, most) = (number(signal.min), number(signal.max));
    let order = match signal.byte_order {
        ByteOrder::LittleEndian => BitOrder::LittleEndian,
        ByteOrder::BigEndian => BitOrder::BigEndian,
    };
    let spec = Signal {
        name: about.long_name.unwrap_or(signal.name),
        spn: about.spn,
        bit: u16::try_from(signal.start_bit).map_err(|_| format!("it begins at bit {}", signal.start_bit))?,
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
    let field = spec.field();
    match field.end() {
        Some(end) if end <= length * 8 => Ok(field),
        _ => Err(format!("it ends behind its message of {}", plural(length, "byte"))),
    }
}

/// Fields with the places of those that select them. A field whose multiplexor is not there cannot be told from
/// another one in the same bits, and is left out; so is one of a circle.
fn select(placed: &[Placed], problems: &mut Problems<'_>) -> Vec<Field> {
    let reached = reached(placed);
    let (there, lost): (Vec<_>, Vec<_>) = placed.iter().partition(|it| it.is_there(&reached));
    for it in lost {
        let by = it.selected.as_ref().map_or("", |(by, _)| by);
        let reason = match by {
            "" => "no multiplexor, or several, of which none is named".to_owned(),
            by => format!(
                "its multiplexor {} is not there, or selects it in too many steps or ranges",
                quote(by)
            ),
        };
        problems.add(it.at, &format!("signal {} left out: {reason}", quote(&it.key)));
    }
    // Of two of one name the first one selects.
    let order: BTreeMap<_, _> =
        there.iter().enumerate().rev().map(|(at, it)| (it.key.as_str(), at)).collect();
    let field = |it: &&Placed| {
        let mut field = it.field.clone();
        field.present = it.selected.as_ref().and_then(|(by, values)| {
            Some(Selector { field: *order.get(by.as_str())?, values: values.clone() })
        });
        field
    };
    there.iter().map(field).collect()
}

/// Names of fields that are always there, or that a field selects which is reached in fewer steps.
fn reached(placed: &[Placed]) -> BTreeSet<&str> {
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

impl Placed {
    /// Whether nothing selects it, or something that is reached itself.
    fn is_there(&self, reached: &BTreeSet<&str>) -> bool {
        let Some((by, ranges)) = &self.selected else { return true };
        reached.contains(by.as_str()) && ranges.len() <= MOST_RANGES
    }
}
