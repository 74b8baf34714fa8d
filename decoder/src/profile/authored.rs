//! TOML form of object dictionary entries, and its conversion.

use std::collections::BTreeMap;
use std::ops::Range;
use std::sync::Arc;

use serde::Deserialize;
use serde::de::{Deserializer, SeqAccess, Visitor};
use toml::Spanned;

use super::data_type::DataType;
use super::entry::{ObjectEntry, SubEntry};
use super::names::{BitNames, SharedDefinition, ValueNames};
use super::object::{
    DefaultValue, EntryRepetition, NumberFormat, ONCE, ObjectCondition, ObjectRole, RawScale, SdoAccess,
    ValueInterpretation, ValueStorage, VariantFilter, WriteEffect,
};
use super::reference::{ObjectRange, ObjectReference};

/// Position in the text, in bytes, and the message.
pub(crate) type TextProblem = (Range<usize>, String);

/// All keys of an object, a sub-entry or a mode.
#[derive(Debug, Clone, Default, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub(super) struct AuthoredEntry {
    index: Option<u16>,
    repeat: Option<EntryRepetition>,
    sub: SubKey,
    to: Option<u8>,
    when: Option<ObjectCondition>,
    name: Option<String>,
    #[serde(rename = "type")]
    data_type: Option<DataType>,
    access: Option<SdoAccess>,
    format: Option<NumberFormat>,
    unit: Option<Spanned<String>>,
    scale: Option<RawScale>,
    offset: Option<f64>,
    decimals: Option<u8>,
    range: Option<[i64; 2]>,
    limits: Option<[f64; 2]>,
    default: Option<DefaultValue>,
    values: Option<Spanned<SharedDefinition<ValueNames>>>,
    special: Option<Spanned<SharedDefinition<ValueNames>>>,
    bits: Option<Spanned<SharedDefinition<Vec<super::names::BitName>>>>,
    role: Option<ObjectRole>,
    of: Option<ObjectReference>,
    short: Option<String>,
    storage: Option<ValueStorage>,
    save: Option<ObjectReference>,
    effect: Option<WriteEffect>,
    invalidates: Vec<ObjectRange>,
    channel: Option<u8>,
    open_loop: Vec<i64>,
    modes: Vec<Spanned<AuthoredEntry>>,
    only: VariantFilter,
    source: Option<String>,
    note: Option<String>,
}

/// Key `sub`: a number in a sub-entry, the list of sub-entries in an object.
#[derive(Debug, Clone, Default)]
enum SubKey {
    #[default]
    None,
    Number(u8),
    List(Vec<Spanned<AuthoredEntry>>),
}

impl<'de> Deserialize<'de> for SubKey {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        struct NumberOrList;
        impl<'de> Visitor<'de> for NumberOrList {
            type Value = SubKey;

            fn expecting(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
                f.write_str("a sub-index or a list of sub-entries")
            }

            fn visit_i64<E: serde::de::Error>(self, number: i64) -> Result<SubKey, E> {
                u8::try_from(number)
                    .map(SubKey::Number)
                    .map_err(|_| E::custom("sub-index out of range; expected 0 to 255"))
            }

            fn visit_seq<A: SeqAccess<'de>>(self, mut list: A) -> Result<SubKey, A::Error> {
                let mut all = Vec::new();
                while let Some(entry) = list.next_element()? {
                    all.push(entry);
                }
                Ok(SubKey::List(all))
            }
        }
        deserializer.deserialize_any(NumberOrList)
    }
}

/// Shared tables that entries refer to by name.
#[derive(Debug, Default)]
pub(super) struct SharedTables {
    pub(super) values: BTreeMap<String, Arc<ValueNames>>,
    pub(super) bits: BTreeMap<String, Arc<BitNames>>,
}

impl SharedTables {
    fn resolve_values(
        &self,
        shared: &Spanned<SharedDefinition<ValueNames>>,
    ) -> Result<Arc<ValueNames>, TextProblem> {
        match shared.get_ref() {
            SharedDefinition::Here(names) => Ok(Arc::new(names.clone())),
            SharedDefinition::Named(name) => self.values.get(name).cloned().ok_or_else(|| {
                (
                    shared.span(),
                    format!("unknown table [values.{name}]{}", expected_names(self.values.keys())),
                )
            }),
        }
    }

    fn resolve_bits(
        &self,
        shared: &Spanned<SharedDefinition<Vec<super::names::BitName>>>,
    ) -> Result<Arc<BitNames>, TextProblem> {
        match shared.get_ref() {
            SharedDefinition::Here(list) => Ok(Arc::new(BitNames { list: list.clone() })),
            SharedDefinition::Named(name) => self.bits.get(name).cloned().ok_or_else(|| {
                (shared.span(), format!("unknown table [bits.{name}]{}", expected_names(self.bits.keys())))
            }),
        }
    }
}

/// Suffix of an error message: `; expected a, b`.
fn expected_names<'a>(names: impl Iterator<Item = &'a String>) -> String {
    let names: Vec<_> = names.map(String::as_str).collect();
    if names.is_empty() { String::new() } else { format!("; expected {}", names.join(", ")) }
}

/// Converts all objects of a file; adds problems to `wrong`.
pub(super) fn convert_objects(
    list: Vec<Spanned<AuthoredEntry>>,
    tables: &SharedTables,
    wrong: &mut Vec<TextProblem>,
) -> Vec<ObjectEntry> {
    let mut objects = Vec::with_capacity(list.len());
    for authored in list {
        match convert_object(authored, tables) {
            Ok(object) => objects.push(object),
            Err(error) => wrong.push(error),
        }
    }
    objects
}

/// Converts one object.
pub(super) fn convert_object(
    authored: Spanned<AuthoredEntry>,
    tables: &SharedTables,
) -> Result<ObjectEntry, TextProblem> {
    let span = authored.span();
    let mut authored = authored.into_inner();
    let here = |message: &str| (span.clone(), message.to_owned());
    let index = authored.index.take().ok_or_else(|| here("index is missing; every object requires one"))?;
    let repeat = authored.repeat.take().unwrap_or(ONCE);
    let name = authored.name.clone().ok_or_else(|| here("name is missing; every object requires one"))?;
    let last = u32::from(index) + u32::from(repeat.count.saturating_sub(1)) * u32::from(repeat.stride);
    if repeat.count == 0 || repeat.count > 1 && repeat.stride == 0 || last > 0xFFFF {
        return Err(here("invalid repeat; expected count > 0, stride > 0 and indexes up to 0xFFFF"));
    }
    let only = authored.only.clone();
    let source = authored.source.clone().unwrap_or_default();
    let entries = match std::mem::take(&mut authored.sub) {
        SubKey::Number(_) => {
            return Err(here("sub of an object is a number; expected a list of sub-entries"));
        }
        SubKey::None => vec![convert_entry(authored, span.clone(), 0, &source, tables)?],
        SubKey::List(entries) => {
            let strange = authored.stray_key();
            if let Some(key) = strange {
                return Err(here(&format!(
                    "{key} at an object with sub-entries; move it to the sub-entries"
                )));
            }
            sub_entries(entries, &source, authored.note.as_deref(), tables)?
        }
    };
    let is_record = entries.len() > 1 || entries.first().is_some_and(|entry| entry.sub != 0 || entry.to != 0);
    Ok(ObjectEntry { index, repeat, name, entries, is_record, only, source, span })
}

fn sub_entries(
    list: Vec<Spanned<AuthoredEntry>>,
    source: &str,
    note: Option<&str>,
    tables: &SharedTables,
) -> Result<Vec<SubEntry>, TextProblem> {
    let mut entries = Vec::with_capacity(list.len());
    for authored in list {
        let span = authored.span();
        let mut authored = authored.into_inner();
        let SubKey::Number(sub) = authored.sub else {
            return Err((span, "sub is missing; expected a sub-index such as sub = 1".into()));
        };
        if authored.index.is_some() || authored.repeat.is_some() {
            return Err((span, "index or repeat in a sub-entry; move it to the object".into()));
        }
        authored.note = authored.note.or_else(|| note.map(str::to_owned));
        entries.push(convert_entry(authored, span, sub, source, tables)?);
    }
    Ok(entries)
}

fn convert_entry(
    mut authored: AuthoredEntry,
    span: Range<usize>,
    sub: u8,
    source: &str,
    tables: &SharedTables,
) -> Result<SubEntry, TextProblem> {
    let mut modes = Vec::new();
    for mode in std::mem::take(&mut authored.modes) {
        let span = mode.span();
        let mut mode = mode.into_inner();
        let when = mode.when.take().ok_or_else(|| {
            (span.clone(), "when is missing; expected when = { object = …, equals = … }".to_owned())
        })?;
        if mode.data_type.is_some() || mode.access.is_some() || mode.default.is_some() {
            return Err((span, "type, access and default cannot depend on the mode".into()));
        }
        modes.push((when, mode.convert_interpretation(tables)?));
    }
    let to = authored.to.unwrap_or(sub);
    if to < sub {
        return Err((span, format!("sub-indexes {sub} to {to}; expected the lower one first")));
    }
    Ok(SubEntry {
        sub,
        to,
        data_type: authored.data_type,
        access: authored.access,
        format: authored.format.unwrap_or_default(),
        look: authored.convert_interpretation(tables)?,
        modes,
        default: authored.default.clone(),
        storage: authored.storage.unwrap_or_default(),
        save: authored.save,
        effect: authored.effect.unwrap_or_default(),
        invalidates: authored.invalidates.clone(),
        channel: authored.channel,
        open_loop: authored.open_loop.clone(),
        only: authored.only.clone(),
        source: authored.source.clone().unwrap_or_else(|| source.to_owned()),
        note: authored.note.clone().unwrap_or_default(),
        span,
    })
}

impl AuthoredEntry {
    /// Converts the keys that can depend on the mode.
    fn convert_interpretation(&self, tables: &SharedTables) -> Result<ValueInterpretation, TextProblem> {
        if let Some(unit) = &self.unit
            && !super::lookup::unit_names().contains(unit.get_ref())
        {
            let message = format!(
                "unknown unit '{}'; expected one of {}",
                unit.get_ref(),
                super::lookup::unit_names().join(" ")
            );
            return Err((unit.span(), message));
        }
        Ok(ValueInterpretation {
            name: self.name.clone(),
            short: self.short.clone(),
            unit: self.unit.as_ref().map(|unit| unit.get_ref().clone()),
            scale: self.scale,
            offset: self.offset,
            decimals: self.decimals,
            range: self.range,
            limits: self.limits,
            values: self.values.as_ref().map(|values| tables.resolve_values(values)).transpose()?,
            special: self.special.as_ref().map(|values| tables.resolve_values(values)).transpose()?,
            bits: self.bits.as_ref().map(|bits| tables.resolve_bits(bits)).transpose()?,
            role: self.role,
            of: self.of,
        })
    }

    /// First key that an object with sub-entries must not have.
    fn stray_key(&self) -> Option<&'static str> {
        let keys = [
            ("type", self.data_type.is_some()),
            ("access", self.access.is_some()),
            ("unit", self.unit.is_some()),
            ("scale", self.scale.is_some()),
            ("range", self.range.is_some()),
            ("limits", self.limits.is_some()),
            ("default", self.default.is_some()),
            ("values", self.values.is_some()),
            ("bits", self.bits.is_some()),
            ("storage", self.storage.is_some()),
            ("effect", self.effect.is_some()),
            ("open_loop", !self.open_loop.is_empty()),
            ("modes", !self.modes.is_empty()),
        ];
        keys.iter().find(|(_, there)| *there).map(|(key, _)| *key)
    }
}
