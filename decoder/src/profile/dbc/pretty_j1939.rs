//! The JSON format of pretty_j1939: parameter groups and suspect parameters that a user converted from their
//! own copy of the J1939 digital annex.
//!
//! ```text
//! {"J1939PGNdb": {"61444": {"Label": "EEC1", "Name": "…", "PGNLength": "64", "SPNs": [190], "SPNStartBits": [24]}},
//!  "J1939SPNdb": {"190": {"Name": "…", "Offset": 0, "Resolution": 0.125, "SPNLength": 16, "Units": "rpm",
//!                         "OperationalLow": 0, "OperationalHigh": 8031.875}},
//!  "J1939BitDecodings": {"899": {"0": "…"}}}
//! ```
//!
//! Start bits are counted from the least significant bit of the first byte. A start bit can be a list with
//! the positions of the parts of a parameter; adjacent parts after the first start at a byte. -1 means
//! unknown. Lengths are in bits, also that of the group. Files from before 2021 have `StartBit` in the
//! parameter.

use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;

use serde::Deserialize;
use serde_json::Value;

use super::file::KnownMessage;
use super::group::as_group;
use super::problem::{DbcProblem, DbcProblems};
use super::read::valid_spn;
use super::signal::DbcSignal;
use super::{DatabaseFile, DatabaseMessage, LONGEST_MESSAGE, MOST_MESSAGES, MOST_SIGNALS, SuspectParameter};
use crate::profile::layout::{BitOrder, LayoutOrigin, PayloadLayout, SignalField};
use crate::profile::names::ValueNames;
use crate::profile::quoted::quote_start;
use crate::wire::j1939::Pgn;

/// Origin of the layouts.
const ORIGIN: LayoutOrigin = LayoutOrigin::Json;

#[derive(Debug, Deserialize)]
struct PrettyJ1939File {
    #[serde(rename = "J1939PGNdb")]
    groups: BTreeMap<String, GroupEntry>,
    #[serde(rename = "J1939SPNdb", default)]
    parameters: BTreeMap<String, SuspectEntry>,
    #[serde(rename = "J1939BitDecodings", default)]
    decodings: BTreeMap<String, BTreeMap<String, String>>,
}

#[derive(Debug, Deserialize)]
struct GroupEntry {
    #[serde(rename = "Label", default)]
    label: String,
    #[serde(rename = "Name", default)]
    name: String,
    /// Length in bits as text, or `Variable`.
    #[serde(rename = "PGNLength", default)]
    length: Value,
    #[serde(rename = "SPNs", default)]
    spns: Vec<u64>,
    /// Start bit, or list of start bits, of each parameter.
    #[serde(rename = "SPNStartBits", default)]
    starts: Vec<Value>,
}

#[derive(Debug, Deserialize)]
struct SuspectEntry {
    #[serde(rename = "Name", default)]
    name: String,
    #[serde(rename = "Offset", default)]
    offset: Value,
    #[serde(rename = "Resolution", default)]
    resolution: Value,
    /// Length in bits, or `Variable`.
    #[serde(rename = "SPNLength", default)]
    length: Value,
    #[serde(rename = "Units", default)]
    unit: String,
    #[serde(rename = "OperationalLow", default)]
    low: Value,
    #[serde(rename = "OperationalHigh", default)]
    high: Value,
    #[serde(rename = "StartBit", default)]
    start: Value,
}

/// Parses the JSON text.
pub(super) fn parse_json(text: &str) -> Result<DatabaseFile, DbcProblem> {
    let file: PrettyJ1939File = serde_json::from_str(text).map_err(|error| {
        // serde_json appends the position to its message.
        let words = error.to_string();
        let words = words.rsplit_once(" at line ").map_or(words.as_str(), |(words, _)| words);
        DbcProblem::new(error.line(), error.column(), &format!("not valid pretty_j1939 JSON: {words}"))
    })?;
    let mut problems = DbcProblems::problems_in("");
    let mut database = file.to_database(&mut problems);
    database.problems = problems.finish();
    Ok(database)
}

impl PrettyJ1939File {
    fn to_database(&self, problems: &mut DbcProblems<'_>) -> DatabaseFile {
        let mut file = DatabaseFile::default();
        let mut known = BTreeSet::new();
        for (number, suspect) in &self.parameters {
            match number.parse().ok().and_then(valid_spn) {
                Some(spn) => {
                    known.insert(number.as_str());
                    file.parameters.push((spn, suspect.to_parameter()));
                }
                None => {
                    problems.add_of_file(&format!(
                        "parameter skipped: {} is not a valid SPN",
                        quote_start(number)
                    ));
                }
            }
        }
        for (number, group) in &self.groups {
            // Extended data page, data page, PF and PS (SAE J1939-21 §5.2): 18 bits.
            let Some(pgn) = number.parse().ok().filter(|pgn| *pgn < 1_u32 << 18) else {
                problems.add_of_file(&format!("group skipped: {} is not a valid PGN", quote_start(number)));
                continue;
            };
            if file.messages.len() >= MOST_MESSAGES {
                problems.add_of_file(&format!("groups from PGN {pgn} on skipped (max {MOST_MESSAGES})"));
                break;
            }
            let message = Arc::new(self.convert_message(pgn, group, problems));
            let pgn = Pgn::new(pgn);
            file.messages.push(KnownMessage {
                id: None,
                group: Some((pgn, as_group(pgn, &message))),
                message,
            });
        }
        file
    }

    fn convert_message(
        &self,
        pgn: u32,
        group: &GroupEntry,
        problems: &mut DbcProblems<'_>,
    ) -> DatabaseMessage {
        let length = parse_number(&group.length)
            .and_then(|bits| parse_whole(bits / 8.0))
            .filter(|it| *it <= LONGEST_MESSAGE);
        let mut fields = Vec::new();
        for (place, number) in group.spns.iter().enumerate() {
            if place >= MOST_SIGNALS {
                problems.add_of_file(&format!(
                    "PGN {pgn}: further parameters skipped (max {MOST_SIGNALS} per group)"
                ));
                break;
            }
            let start = group.starts.get(place).unwrap_or(&Value::Null);
            match self.convert_field(*number, start, length) {
                Ok(field) => fields.push(field),
                Err(reason) => problems.add_of_file(&format!("PGN {pgn}: SPN {number} skipped: {reason}")),
            }
        }
        fields.sort_by_key(|field| field.bit);
        let bits = fields.iter().filter_map(SignalField::end).max().unwrap_or(0);
        let name = if group.label.is_empty() { &group.name } else { &group.label };
        let layout = PayloadLayout { fields, bits, origin: ORIGIN, ..PayloadLayout::default() };
        DatabaseMessage { name: name.clone(), length, layout: Arc::new(layout) }
    }

    fn convert_field(&self, number: u64, start: &Value, length: Option<u16>) -> Result<SignalField, String> {
        let key = number.to_string();
        let (Some(spn), Some(suspect)) = (valid_spn(number), self.parameters.get(&key)) else {
            return Err("not defined in J1939SPNdb".to_owned());
        };
        let signal = suspect.to_signal(spn, start, self.convert_names(&key))?;
        let field = signal.into_field();
        let most = length.map_or(u32::from(u16::MAX), |length| u32::from(length) * 8);
        match field.end() {
            Some(end) if u32::from(end) <= most => Ok(field),
            _ => Err("it exceeds the length of its group".to_owned()),
        }
    }

    fn convert_names(&self, spn: &str) -> Option<Arc<ValueNames>> {
        let decodings = self.decodings.get(spn)?;
        let names = decodings.iter().filter_map(|(code, text)| Some((code.parse().ok()?, text.clone())));
        Some(Arc::new(ValueNames(names.collect())))
    }
}

impl SuspectEntry {
    fn to_parameter(&self) -> SuspectParameter {
        SuspectParameter { name: self.name.clone(), unit: self.plain_unit().to_owned() }
    }

    /// Unit; empty for `bit` and `binary`, which are number formats.
    fn plain_unit(&self) -> &str {
        if matches!(self.unit.as_str(), "bit" | "binary") { "" } else { &self.unit }
    }

    fn to_signal(
        &self,
        spn: u32,
        start: &Value,
        values: Option<Arc<ValueNames>>,
    ) -> Result<DbcSignal, String> {
        let bits = match parse_number(&self.length).and_then(parse_whole) {
            Some(bits @ 1..=64) if self.unit != "ASCII" => bits,
            Some(_) if self.unit == "ASCII" => return Err("text is not supported".to_owned()),
            Some(bits) => return Err(format!("{bits} bits; expected 1 to 64")),
            None => return Err("variable length is not supported".to_owned()),
        };
        let bit = self.start_bit(start, bits)?;
        // A resolution of 0 means that none is stated.
        let factor = parse_number(&self.resolution).filter(|factor| *factor > 0.0).unwrap_or(1.0);
        let offset = parse_number(&self.offset).unwrap_or(0.0);
        #[expect(clippy::cast_precision_loss, reason = "compared with limits that have few digits")]
        let holds = (u64::MAX >> (64 - bits)) as f64 * factor + offset;
        let limits = match (parse_number(&self.low), parse_number(&self.high)) {
            // Limits that no code reaches, such as -1e12 and 1e12, are ignored.
            (Some(low), Some(high)) if low < high && high <= holds + factor / 2.0 => Some([low, high]),
            _ => None,
        };
        Ok(DbcSignal {
            name: self.name.clone(),
            spn: Some(spn),
            bit,
            bits,
            order: BitOrder::LittleEndian,
            is_signed: false,
            is_float: false,
            factor,
            offset,
            limits,
            unit: self.plain_unit().to_owned(),
            values,
        })
    }

    /// Start bit. Parts are adjacent if each one after the first starts at a byte within the length.
    fn start_bit(&self, start: &Value, bits: u16) -> Result<u16, String> {
        let start = if start.is_null() { &self.start } else { start };
        let parts: Vec<_> = match start {
            Value::Array(parts) => {
                parts.iter().map(|part| parse_number(part).and_then(parse_whole)).collect()
            }
            one => vec![parse_number(one).and_then(parse_whole)],
        };
        let [Some(first), others @ ..] = parts.as_slice() else {
            return Err("start bit missing".to_owned());
        };
        let touches = |part: &Option<u16>| {
            part.is_some_and(|part| part % 8 == 0 && part > *first && part - *first < bits)
        };
        if others.iter().all(touches) { Ok(*first) } else { Err("its parts are not adjacent".to_owned()) }
    }
}

/// A number, also if written as text.
fn parse_number(value: &Value) -> Option<f64> {
    match value {
        Value::Number(number) => number.as_f64(),
        Value::String(text) => text.trim().parse().ok().filter(|number: &f64| number.is_finite()),
        _ => None,
    }
}

/// A whole number of bits or bytes, max 65535.
fn parse_whole(number: f64) -> Option<u16> {
    let is_whole = (0.0..=f64::from(u16::MAX)).contains(&number) && number.fract() == 0.0;
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "checked")]
    is_whole.then_some(number as u16)
}
