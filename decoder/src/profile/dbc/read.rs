//! Statements of a DBC to what they say: messages with their signals, and what stands elsewhere about them.

use std::collections::BTreeMap;
use std::ops::{Range, RangeInclusive};
use std::sync::Arc;

use can_dbc::{AttributeValue, Dbc, DbcError, SignalExtendedValueType, ValDescription, ValueDescription};
use pest::error::InputLocation;

use super::problem::Problems;
use super::statement::{Kind, Statements};
use crate::frame::CanId;
use crate::profile::names::Names;
use crate::profile::quoted::quote;

/// A signal alone is no DBC; a message around it makes it one.
const AROUND_SIGNAL: &str = "BO_ 0 M: 8 N\n";

/// Forms of statements, for whoever wrote another one.
const SIGNAL: &str = "SG_ name : start|width@1+ (factor,offset) [least|largest] \"unit\" receivers";
const VALUE_TABLE: &str = "VAL_TABLE_ name 0 \"text\" ;";
const VALUES: &str = "VAL_ identifier signal 0 \"text\" ;";
const FLOAT_TYPE: &str = "SIG_VALTYPE_ identifier signal : 1;";
const MULTIPLEXED: &str = "SG_MUL_VAL_ identifier signal multiplexor 0-3, 5-5;";
const ATTRIBUTE: &str = "BA_ \"name\" SG_ identifier signal value;";

/// `BO_` of signals without a message.
const NO_MESSAGE: &str = "VECTOR__INDEPENDENT_SIG_MSG";

/// A message as its `BO_` tells it.
#[derive(Debug)]
pub(super) struct RawMessage {
    pub(super) id: CanId,
    /// Place in the file.
    pub(super) at: usize,
    pub(super) name: String,
    /// Bytes.
    pub(super) length: u64,
    /// Signals with their places in the file.
    pub(super) signals: Vec<(usize, can_dbc::Signal)>,
}

/// What other statements say about a signal.
#[derive(Debug, Clone, Default)]
pub(super) struct About {
    /// Place of the first statement.
    pub(super) at: usize,
    pub(super) values: Option<Arc<Names>>,
    pub(super) is_float: bool,
    pub(super) spn: Option<u32>,
    pub(super) long_name: Option<String>,
    /// Name of the multiplexor, and its values that select the signal.
    pub(super) selected: Option<(String, Vec<RangeInclusive<u64>>)>,
}

/// All a DBC says.
#[derive(Debug, Default)]
pub(super) struct Raw {
    pub(super) messages: Vec<RawMessage>,
    pub(super) about: BTreeMap<CanId, BTreeMap<String, About>>,
    pub(super) long_names: BTreeMap<CanId, String>,
    tables: BTreeMap<String, Arc<Names>>,
    /// Statements that were understood, those that are passed over included.
    pub(super) statements: usize,
}

impl Raw {
    /// Reads all of a text; what is not understood goes to `problems`.
    pub(super) fn of<'a>(text: &'a str, problems: &mut Problems<'a>) -> Self {
        let mut raw = Self::default();
        let mut values = Vec::new();
        for statement in Statements::of(text) {
            let statement = match statement {
                Ok(statement) => statement,
                Err(broken) => {
                    problems.add(broken.at, broken.reason);
                    continue;
                }
            };
            raw.statements += 1;
            let mut part = Part { text, at: statement.at, problems: &mut *problems };
            match statement.kind {
                Kind::Message => raw.messages.extend(part.message()),
                Kind::ValueTable => raw.value_table(&mut part),
                // A table may be defined behind its use.
                Kind::Values => values.push(part.at),
                Kind::FloatType => raw.float_type(&mut part),
                Kind::Multiplexed => raw.multiplexed(&mut part),
                Kind::Attribute => raw.attribute(&mut part),
                Kind::Other | Kind::Line | Kind::Symbols => {}
            }
        }
        for at in values {
            raw.values(&mut Part { text, at, problems: &mut *problems });
        }
        raw
    }

    fn about(&mut self, id: CanId, signal: String, at: usize) -> &mut About {
        self.about.entry(id).or_default().entry(signal).or_insert_with(|| About { at, ..About::default() })
    }

    /// `VAL_TABLE_ name 0 "off" 1 "on" ;`
    fn value_table(&mut self, part: &mut Part<'_, '_>) {
        for table in part.parse(VALUE_TABLE).map(|dbc| dbc.value_tables).unwrap_or_default() {
            self.tables.insert(table.name, names(table.descriptions));
        }
    }

    /// `VAL_ id signal 0 "off" 1 "on" ;`, or `VAL_ id signal table ;` as some editors write it.
    fn values(&mut self, part: &mut Part<'_, '_>) {
        let words: Vec<_> = part.source().trim_end_matches(';').split_whitespace().take(5).collect();
        // Without identifier it is about an environment variable.
        let Some(id) = part.identifier(words.get(1).copied()) else { return };
        if let [_, _, signal, table] = *words.as_slice()
            && let Some(names) = self.tables.get(table).cloned()
        {
            self.about(id, signal.to_owned(), part.at.start).values = Some(names);
            return;
        }
        for values in part.parse(VALUES).map(|dbc| dbc.value_descriptions).unwrap_or_default() {
            if let ValueDescription::Signal { name, value_descriptions, .. } = values {
                self.about(id, name, part.at.start).values = Some(names(value_descriptions));
            }
        }
    }

    /// `SIG_VALTYPE_ id signal : 1;`
    fn float_type(&mut self, part: &mut Part<'_, '_>) {
        let Some(id) = part.identifier(part.source().split_whitespace().nth(1)) else { return };
        for said in part.parse(FLOAT_TYPE).map(|dbc| dbc.signal_extended_value_type_list).unwrap_or_default()
        {
            let is_float =
                said.signal_extended_value_type != SignalExtendedValueType::SignedOrUnsignedInteger;
            self.about(id, said.signal_name, part.at.start).is_float = is_float;
        }
    }

    /// `SG_MUL_VAL_ id signal multiplexor 0-3, 8-8;`
    fn multiplexed(&mut self, part: &mut Part<'_, '_>) {
        let Some(id) = part.identifier(part.source().split_whitespace().nth(1)) else { return };
        for said in part.parse(MULTIPLEXED).map(|dbc| dbc.extended_multiplex).unwrap_or_default() {
            let ranges = said.mappings.iter().map(|it| it.min_value..=it.max_value).collect();
            let selected = Some((said.multiplexor_signal_name, ranges));
            self.about(id, said.signal_name, part.at.start).selected = selected;
        }
    }

    /// `BA_ "SPN" SG_ id signal 190;` and the long names of Vector's editor, whose own are cut to 32 letters.
    fn attribute(&mut self, part: &mut Part<'_, '_>) {
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
        let Some(id) = part.identifier(id) else { return };
        for said in dbc.attribute_values_message {
            if let ("SystemMessageLongSymbol", AttributeValue::String(long)) = (name, said.value) {
                self.long_names.insert(id, long);
            }
        }
        for said in dbc.attribute_values_signal {
            let about = self.about(id, said.signal_name, part.at.start);
            match (name, said.value) {
                ("SPN", AttributeValue::Uint(spn)) => about.spn = self::spn(spn),
                ("SystemSignalLongSymbol", AttributeValue::String(long)) => about.long_name = Some(long),
                _ => {}
            }
        }
    }
}

/// A statement, or a line of it, and where it stands.
struct Part<'a, 'b> {
    text: &'a str,
    at: Range<usize>,
    problems: &'b mut Problems<'a>,
}

impl<'a> Part<'a, '_> {
    fn source(&self) -> &'a str {
        self.text.get(self.at.clone()).unwrap_or_default()
    }

    /// What can-dbc makes of a statement; told with the form it should have if that is nothing.
    fn parse(&mut self, form: &str) -> Option<Dbc> {
        let result = Dbc::try_from(self.source());
        result.map_err(|error| self.tell(&error, 0, form)).ok()
    }

    /// The place is the last one at which can-dbc looked for a part with a name; what is wrong may be a few
    /// characters behind it, and its words about what it expected there lead astray.
    fn tell(&mut self, error: &DbcError, before: usize, form: &str) {
        let offset = match error {
            DbcError::Pest(error) => match error.location {
                InputLocation::Pos(at) | InputLocation::Span((at, _)) => at,
            },
            _ => 0,
        };
        let at = self.at.start + offset.saturating_sub(before).min(self.at.len());
        self.problems.add(at, &format!("left out: from about here on it is not like {form}"));
    }

    /// The identifier a statement is about: bit 31 marks one of 29 bits. Other text than a number is none.
    fn identifier(&mut self, word: Option<&str>) -> Option<CanId> {
        let word = word.filter(|word| word.starts_with(|first: char| first.is_ascii_digit()))?;
        let id = word.parse().ok().and_then(can_id);
        if id.is_none() {
            self.problems.add(self.at.start, &format!("left out: {} is no CAN identifier", quote(word)));
        }
        id.map(|(id, _)| id)
    }

    /// A message: `BO_ id name: length sender`, then its signals, a line each.
    fn message(&mut self) -> Option<RawMessage> {
        let (head, signals) = self.source().split_once('\n').unwrap_or((self.source(), ""));
        let mut message = self.head(head)?;
        let mut at = self.at.start + head.len() + 1;
        for line in signals.split('\n') {
            let start = at + (line.len() - line.trim_start().len());
            at += line.len() + 1;
            if line.trim_start().starts_with("SG_") {
                let mut part = Part { text: self.text, at: start..at - 1, problems: &mut *self.problems };
                message.signals.extend(part.signal().map(|signal| (start, signal)));
            }
        }
        Some(message)
    }

    fn head(&mut self, head: &str) -> Option<RawMessage> {
        let parts = head.split_once(':').map(|(front, back)| {
            let mut front = front.split_whitespace().skip(1);
            (front.next(), front.next(), front.next(), back.split_whitespace().next().map(str::parse))
        });
        let Some((Some(id), Some(name), None, Some(Ok(length)))) = parts else {
            let reason = "message left out: expected BO_, identifier, name, colon, length and sender";
            self.problems.add(self.at.start, reason);
            return None;
        };
        if name == NO_MESSAGE {
            return None;
        }
        let Some((can_id, is_guess)) = id.parse().ok().and_then(can_id) else {
            let reason = format!("message {} left out: {} is no CAN identifier", quote(name), quote(id));
            self.problems.add(self.at.start, &reason);
            return None;
        };
        if is_guess {
            let reason =
                format!("{} taken for an identifier of 29 bits: bit 31, which says so, is clear", quote(id));
            self.problems.add(self.at.start, &reason);
        }
        let name = name.to_owned();
        Some(RawMessage { id: can_id, at: self.at.start, name, length, signals: Vec::new() })
    }

    /// `SG_ name m0 : 0|8@1+ (1,0) [0|255] "unit" receivers`. The receivers are not needed, and what is
    /// wrong with them costs no signal.
    fn signal(&mut self) -> Option<can_dbc::Signal> {
        let source = self.source();
        let unit = source.match_indices('"').nth(1).map_or(source.len(), |(at, _)| at + 1);
        let source = source.get(..unit).unwrap_or(source);
        match Dbc::try_from(format!("{AROUND_SIGNAL}{source} N\n").as_str()) {
            Ok(dbc) => dbc.messages.into_iter().next()?.signals.into_iter().next(),
            Err(error) => {
                self.tell(&error, AROUND_SIGNAL.len(), SIGNAL);
                None
            }
        }
    }
}

/// A number as identifier, and whether bit 31 had to be guessed: more than 11 bits cannot be a base one.
fn can_id(number: u64) -> Option<(CanId, bool)> {
    const MARK: u32 = 1 << 31;
    let number = u32::try_from(number).ok()?;
    match number & !MARK {
        id @ 0..=0x7FF if number & MARK == 0 => Some((CanId::standard(u16::try_from(id).ok()?), false)),
        id @ 0..=0x1FFF_FFFF => Some((CanId::extended(id), number & MARK == 0)),
        _ => None,
    }
}

fn names(descriptions: Vec<ValDescription>) -> Arc<Names> {
    Arc::new(Names(descriptions.into_iter().map(|it| (it.id, it.description)).collect()))
}

/// A suspect parameter number: 19 bits (SAE J1939-73 §5.7.1.7); 0 stands for none.
pub(super) fn spn(number: u64) -> Option<u32> {
    u32::try_from(number).ok().filter(|spn| (1..1 << 19).contains(spn))
}
