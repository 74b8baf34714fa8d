//! Parses the statements of a DBC: messages with their signals, and the attributes of both.

use std::collections::BTreeMap;
use std::ops::{Range, RangeInclusive};
use std::sync::Arc;

use can_dbc::{AttributeValue, Dbc, DbcError, SignalExtendedValueType, ValDescription, ValueDescription};
use pest::error::InputLocation;

use super::problem::DbcProblems;
use super::statement::{DbcStatements, StatementKind};
use crate::frame::CanId;
use crate::profile::names::ValueNames;
use crate::profile::quoted::quote_start;

/// Prefix that makes a DBC of a single signal, as can-dbc requires a message.
const AROUND_SIGNAL: &str = "BO_ 0 M: 8 N\n";

/// Forms of the statements, for error messages.
const SIGNAL: &str = "SG_ name : start|width@1+ (factor,offset) [min|max] \"unit\" receivers";
const VALUE_TABLE: &str = "VAL_TABLE_ name 0 \"text\" ;";
const VALUES: &str = "VAL_ identifier signal 0 \"text\" ;";
const FLOAT_TYPE: &str = "SIG_VALTYPE_ identifier signal : 1;";
const MULTIPLEXED: &str = "SG_MUL_VAL_ identifier signal multiplexor 0-3, 5-5;";
const ATTRIBUTE: &str = "BA_ \"name\" SG_ identifier signal value;";

/// Pseudo message that lists signals without a message.
const NO_MESSAGE: &str = "VECTOR__INDEPENDENT_SIG_MSG";

/// A message as defined by its `BO_` statement.
#[derive(Debug)]
pub(super) struct RawMessage {
    pub(super) id: CanId,
    /// Position in the file, in bytes.
    pub(super) at: usize,
    pub(super) name: String,
    /// Length of the payload, in bytes.
    pub(super) length: u64,
    /// Signals with their positions in the file.
    pub(super) signals: Vec<(usize, can_dbc::Signal)>,
}

/// Properties of a signal from statements other than `SG_`.
#[derive(Debug, Clone, Default)]
pub(super) struct SignalProperties {
    /// Position of the first statement.
    pub(super) at: usize,
    pub(super) values: Option<Arc<ValueNames>>,
    pub(super) is_float: bool,
    pub(super) spn: Option<u32>,
    pub(super) long_name: Option<String>,
    /// Name of the multiplexor, and the values that select the signal.
    pub(super) selected: Option<(String, Vec<RangeInclusive<u64>>)>,
}

/// Parsed contents of a DBC.
#[derive(Debug, Default)]
pub(super) struct RawDbc {
    pub(super) messages: Vec<RawMessage>,
    pub(super) about: BTreeMap<CanId, BTreeMap<String, SignalProperties>>,
    pub(super) long_names: BTreeMap<CanId, String>,
    tables: BTreeMap<String, Arc<ValueNames>>,
    /// Number of recognised statements, including ignored ones.
    pub(super) statements: usize,
}

impl RawDbc {
    /// Parses the text; adds unrecognised parts to `problems`.
    pub(super) fn parse_dbc<'a>(text: &'a str, problems: &mut DbcProblems<'a>) -> Self {
        let mut raw = Self::default();
        let mut values = Vec::new();
        for statement in DbcStatements::statements_in(text) {
            let statement = match statement {
                Ok(statement) => statement,
                Err(broken) => {
                    problems.add_problem(broken.at, broken.reason);
                    continue;
                }
            };
            raw.statements += 1;
            let mut part = StatementPart { text, at: statement.at, problems: &mut *problems };
            match statement.kind {
                StatementKind::Message => raw.messages.extend(part.parse_message()),
                StatementKind::ValueTable => raw.value_table(&mut part),
                // A table may be defined after its use.
                StatementKind::Values => values.push(part.at),
                StatementKind::FloatType => raw.float_type(&mut part),
                StatementKind::Multiplexed => raw.parse_multiplexed(&mut part),
                StatementKind::Attribute => raw.parse_attribute(&mut part),
                StatementKind::Other | StatementKind::Line | StatementKind::Symbols => {}
            }
        }
        for at in values {
            raw.parse_values(&mut StatementPart { text, at, problems: &mut *problems });
        }
        raw
    }

    fn properties_of(&mut self, id: CanId, signal: String, at: usize) -> &mut SignalProperties {
        self.about
            .entry(id)
            .or_default()
            .entry(signal)
            .or_insert_with(|| SignalProperties { at, ..SignalProperties::default() })
    }

    /// Parses `VAL_TABLE_ name 0 "off" 1 "on" ;`
    fn value_table(&mut self, part: &mut StatementPart<'_, '_>) {
        for table in part.parse(VALUE_TABLE).map(|dbc| dbc.value_tables).unwrap_or_default() {
            self.tables.insert(table.name, value_names(table.descriptions));
        }
    }

    /// Parses `VAL_ id signal 0 "off" 1 "on" ;`, or `VAL_ id signal table ;` as some editors write it.
    fn parse_values(&mut self, part: &mut StatementPart<'_, '_>) {
        let words: Vec<_> = part.source().trim_end_matches(';').split_whitespace().take(5).collect();
        // Without an identifier, it describes an environment variable.
        let Some(id) = part.parse_identifier(words.get(1).copied()) else { return };
        if let [_, _, signal, table] = *words.as_slice()
            && let Some(names) = self.tables.get(table).cloned()
        {
            self.properties_of(id, signal.to_owned(), part.at.start).values = Some(names);
            return;
        }
        for values in part.parse(VALUES).map(|dbc| dbc.value_descriptions).unwrap_or_default() {
            if let ValueDescription::Signal { name, value_descriptions, .. } = values {
                self.properties_of(id, name, part.at.start).values = Some(value_names(value_descriptions));
            }
        }
    }

    /// Parses `SIG_VALTYPE_ id signal : 1;`
    fn float_type(&mut self, part: &mut StatementPart<'_, '_>) {
        let Some(id) = part.parse_identifier(part.source().split_whitespace().nth(1)) else { return };
        for entry in part.parse(FLOAT_TYPE).map(|dbc| dbc.signal_extended_value_type_list).unwrap_or_default()
        {
            let is_float =
                entry.signal_extended_value_type != SignalExtendedValueType::SignedOrUnsignedInteger;
            self.properties_of(id, entry.signal_name, part.at.start).is_float = is_float;
        }
    }

    /// Parses `SG_MUL_VAL_ id signal multiplexor 0-3, 8-8;`
    fn parse_multiplexed(&mut self, part: &mut StatementPart<'_, '_>) {
        let Some(id) = part.parse_identifier(part.source().split_whitespace().nth(1)) else { return };
        for entry in part.parse(MULTIPLEXED).map(|dbc| dbc.extended_multiplex).unwrap_or_default() {
            let ranges = entry.mappings.iter().map(|it| it.min_value..=it.max_value).collect();
            let selected = Some((entry.multiplexor_signal_name, ranges));
            self.properties_of(id, entry.signal_name, part.at.start).selected = selected;
        }
    }

    /// Parses `BA_ "SPN" SG_ id signal 190;` and the long names of Vector's editor, which limits names to 32
    /// letters.
    fn parse_attribute(&mut self, part: &mut StatementPart<'_, '_>) {
        const READ: [&str; 3] = ["SPN", "SystemSignalLongSymbol", "SystemMessageLongSymbol"];
        let mut quoted = part.source().splitn(3, '"').skip(1);
        let (Some(name), Some(rest)) = (quoted.next(), quoted.next()) else { return };
        if !READ.contains(&name) {
            return;
        }
        let id = rest.split_whitespace().nth(1);
        let Some(dbc) = part.parse(ATTRIBUTE) else { return };
        if dbc.attribute_values_message.is_empty() && dbc.attribute_values_signal.is_empty() {
            return;
        }
        let Some(id) = part.parse_identifier(id) else { return };
        for entry in dbc.attribute_values_message {
            if let ("SystemMessageLongSymbol", AttributeValue::String(long)) = (name, entry.value) {
                self.long_names.insert(id, long);
            }
        }
        for entry in dbc.attribute_values_signal {
            let about = self.properties_of(id, entry.signal_name, part.at.start);
            match (name, entry.value) {
                ("SPN", AttributeValue::Uint(spn)) => about.spn = valid_spn(spn),
                ("SystemSignalLongSymbol", AttributeValue::String(long)) => about.long_name = Some(long),
                _ => {}
            }
        }
    }
}

/// A statement, or one line of it, with its position.
struct StatementPart<'a, 'b> {
    text: &'a str,
    at: Range<usize>,
    problems: &'b mut DbcProblems<'a>,
}

impl<'a> StatementPart<'a, '_> {
    fn source(&self) -> &'a str {
        self.text.get(self.at.clone()).unwrap_or_default()
    }

    /// Parses a statement with can-dbc; reports the expected `form` on an error.
    fn parse(&mut self, form: &str) -> Option<Dbc> {
        let result = Dbc::try_from(self.source());
        result.map_err(|error| self.report_error(&error, 0, form)).ok()
    }

    /// Reports the last position at which can-dbc tried a named rule. The error can be a few characters
    /// later, and can-dbc's own list of expected rules is misleading.
    fn report_error(&mut self, error: &DbcError, before: usize, form: &str) {
        let offset = match error {
            DbcError::Pest(error) => match error.location {
                InputLocation::Pos(at) | InputLocation::Span((at, _)) => at,
            },
            _ => 0,
        };
        let at = self.at.start + offset.saturating_sub(before).min(self.at.len());
        self.problems.add_problem(at, &format!("skipped: syntax error near here; expected {form}"));
    }

    /// Identifier of a statement; bit 31 marks a 29-bit one. `None` for text other than a number.
    fn parse_identifier(&mut self, word: Option<&str>) -> Option<CanId> {
        let word = word.filter(|word| word.starts_with(|first: char| first.is_ascii_digit()))?;
        let id = word.parse().ok().and_then(can_id);
        if id.is_none() {
            self.problems.add_problem(
                self.at.start,
                &format!("skipped: {} is not a valid CAN identifier", quote_start(word)),
            );
        }
        id.map(|(id, _)| id)
    }

    /// Parses a message: `BO_ id name: length sender`, then one line per signal.
    fn parse_message(&mut self) -> Option<RawMessage> {
        let (head, signals) = self.source().split_once('\n').unwrap_or((self.source(), ""));
        let mut message = self.parse_head(head)?;
        let mut at = self.at.start + head.len() + 1;
        for line in signals.split('\n') {
            let start = at + (line.len() - line.trim_start().len());
            at += line.len() + 1;
            if line.trim_start().starts_with("SG_") {
                let mut part =
                    StatementPart { text: self.text, at: start..at - 1, problems: &mut *self.problems };
                message.signals.extend(part.parse_signal().map(|signal| (start, signal)));
            }
        }
        Some(message)
    }

    fn parse_head(&mut self, head: &str) -> Option<RawMessage> {
        let parts = head.split_once(':').map(|(front, back)| {
            let mut front = front.split_whitespace().skip(1);
            (front.next(), front.next(), front.next(), back.split_whitespace().next().map(str::parse))
        });
        let Some((Some(id), Some(name), None, Some(Ok(length)))) = parts else {
            let reason = "message skipped: expected BO_, identifier, name, colon, length and sender";
            self.problems.add_problem(self.at.start, reason);
            return None;
        };
        if name == NO_MESSAGE {
            return None;
        }
        let Some((can_id, is_guess)) = id.parse().ok().and_then(can_id) else {
            let reason = format!(
                "message {} skipped: {} is not a valid CAN identifier",
                quote_start(name),
                quote_start(id)
            );
            self.problems.add_problem(self.at.start, &reason);
            return None;
        };
        if is_guess {
            let reason =
                format!("{} treated as a 29-bit identifier, although bit 31 is clear", quote_start(id));
            self.problems.add_problem(self.at.start, &reason);
        }
        let name = name.to_owned();
        Some(RawMessage { id: can_id, at: self.at.start, name, length, signals: Vec::new() })
    }

    /// Checks that all values of a signal are finite; reports the number that overflows.
    fn check_scale(&mut self, signal: &can_dbc::Signal, source: &str) -> bool {
        let Some((at, what, number)) = find_overflow(signal, source) else { return true };
        let reason = format!(
            "signal {} skipped: {what} {} exceeds the range of 64-bit floats",
            quote_start(&signal.name),
            quote_start(number)
        );
        self.problems.add_problem(self.at.start + at, &reason);
        false
    }

    /// Parses `SG_ name m0 : 0|8@1+ (1,0) [0|255] "unit" receivers`. The receivers are ignored, so errors in
    /// them do not lose the signal.
    fn parse_signal(&mut self) -> Option<can_dbc::Signal> {
        let source = self.source();
        let unit = source.match_indices('"').nth(1).map_or(source.len(), |(at, _)| at + 1);
        let source = source.get(..unit).unwrap_or(source);
        match Dbc::try_from(format!("{AROUND_SIGNAL}{source} N\n").as_str()) {
            Ok(dbc) => {
                let signal = dbc.messages.into_iter().next()?.signals.into_iter().next()?;
                self.check_scale(&signal, source).then_some(signal)
            }
            Err(error) => {
                self.report_error(&error, AROUND_SIGNAL.len(), SIGNAL);
                None
            }
        }
    }
}

/// Part of the text that overflows: the factor or the offset. `None` if every raw number has a value.
fn find_overflow<'a>(signal: &can_dbc::Signal, source: &'a str) -> Option<(usize, &'static str, &'a str)> {
    let open = source.find('(')? + 1;
    let scale = source.get(open..)?.split(')').next()?;
    let (factor, offset) = scale.split_once(',')?;
    if !signal.offset.is_finite() {
        return Some((open + factor.len() + 1, "offset", offset.trim()));
    }
    let bits = i32::try_from(signal.size.min(64)).unwrap_or(64);
    let largest = 2_f64.powi(bits) * signal.factor + signal.offset;
    (!largest.is_finite()).then_some((open, "factor", factor.trim()))
}

/// CAN identifier of a number, and whether bit 31 is missing: more than 11 bits need a 29-bit identifier.
fn can_id(number: u64) -> Option<(CanId, bool)> {
    const MARK: u32 = 1 << 31;
    let number = u32::try_from(number).ok()?;
    match number & !MARK {
        id @ 0..=0x7FF if number & MARK == 0 => Some((CanId::from_standard(u16::try_from(id).ok()?), false)),
        id @ 0..=0x1FFF_FFFF => Some((CanId::from_extended(id), number & MARK == 0)),
        _ => None,
    }
}

fn value_names(descriptions: Vec<ValDescription>) -> Arc<ValueNames> {
    Arc::new(ValueNames(descriptions.into_iter().map(|it| (it.id, it.description)).collect()))
}

/// Suspect parameter number: 19 bits (SAE J1939-73 §5.7.1.7); `None` for 0.
pub(super) fn valid_spn(number: u64) -> Option<u32> {
    u32::try_from(number).ok().filter(|spn| (1..1 << 19).contains(spn))
}
