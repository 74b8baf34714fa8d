//! Text on objects in a profile: names, formulas, ranges, enumerations, bits.

use std::fmt::Write as _;

use cobscope_decoder::bus_file::encode;
use cobscope_decoder::profile::object::{
    DefaultValue, Effect, Interpretation, Numbers, ObjectCondition, Scale, Storage,
};
use cobscope_decoder::profile::{BitName, Names};
use cobscope_decoder::profile::{
    DataType, Device, Entry, KnownValues, Meaning, NoValues, Object, ResolvedObject, Resolver, Value,
};
use cobscope_decoder::wire::canopen::ObjectAddress;

use super::{firm, section};

/// Maximum number of names and characters of an enumeration within a line.
const FEW_NAMES: (usize, usize) = (4, 60);

/// Maximum number of values listed with their names.
const FEW_NUMBERS: usize = 2;

/// Assumed values of objects.
struct AssumedValues(Vec<(ObjectAddress, Vec<u8>)>);

impl KnownValues for AssumedValues {
    fn bytes(&self, object: ObjectAddress) -> Option<(&[u8], bool)> {
        let found = self.0.iter().find(|(address, _)| *address == object);
        found.map(|(_, bytes)| (bytes.as_slice(), false))
    }

    fn unit(&self, _: ObjectAddress) -> Option<&str> {
        None
    }
}

/// Interpretation of an entry, depending on the value of another object.
pub(in crate::cmd) struct Reading {
    /// Condition on another object; `None` for the default interpretation.
    pub when: Option<ObjectCondition>,
    /// Keys of the interpretation, completed by those of the entry.
    pub look: Interpretation,
    /// Meaning with all other objects at their default values.
    pub meaning: Meaning,
}

/// `5208:02 Command values, Nominal pressure`.
pub(in crate::cmd) fn named(device: &Device, address: ObjectAddress) -> String {
    let found = device.dictionary.find(address);
    found.map_or_else(|| address.to_string(), |found| format!("{address} {}", found.name()))
}

/// Interpretations of an entry, the default one first.
pub(in crate::cmd) fn readings(device: &Device, found: &ResolvedObject<'_>, entry: &Entry) -> Vec<Reading> {
    let meaning = |known: &dyn KnownValues| {
        Resolver::new(&device.dictionary, known).meaning(found.address).unwrap_or_default()
    };
    let base = if entry.modes.is_empty() {
        meaning(&NoValues)
    } else {
        meaning(&AssumedValues(
            entry.modes.iter().filter_map(|(when, _)| otherwise(device, found, entry, when)).collect(),
        ))
    };
    let mut all = vec![Reading { when: None, look: entry.look.clone(), meaning: base }];
    for (when, look) in &entry.modes {
        let number = match &when.equals {
            Numbers::One(one) => *one,
            Numbers::Any(any) => any.first().copied().unwrap_or_default(),
        };
        let supposed = supposed(device, found.shifted(when.object), number);
        let meaning = meaning(&AssumedValues(supposed.into_iter().collect()));
        all.push(Reading { when: Some(when.clone()), look: completed(look, &entry.look), meaning });
    }
    all
}

/// A value of the object in `when` that no mode uses.
fn otherwise(
    device: &Device,
    found: &ResolvedObject<'_>,
    entry: &Entry,
    when: &ObjectCondition,
) -> Option<(ObjectAddress, Vec<u8>)> {
    let free = (0..=127).find(|number| !entry.modes.iter().any(|(when, _)| when.equals.contains(*number)))?;
    supposed(device, found.shifted(when.object), free)
}

fn supposed(device: &Device, object: ObjectAddress, number: i64) -> Option<(ObjectAddress, Vec<u8>)> {
    let bytes = encode(number, device.dictionary.data_type(object)).ok()?;
    Some((object, bytes))
}

/// Keys of a mode, completed by those of the entry.
fn completed(mode: &Interpretation, own: &Interpretation) -> Interpretation {
    Interpretation {
        name: mode.name.clone().or_else(|| own.name.clone()),
        unit: mode.unit.clone().or_else(|| own.unit.clone()),
        scale: mode.scale.or(own.scale),
        offset: mode.offset.or(own.offset),
        ..mode.clone()
    }
}

/// `bar = raw × 5208:02 / 16383`, `µs = raw × 100`, `ms`; empty for plain numbers.
pub(in crate::cmd) fn formula(reading: &Reading, found: &ResolvedObject<'_>) -> String {
    let unit = reading.look.unit.as_deref().unwrap_or_default();
    let mut right = match reading.look.scale {
        None => String::new(),
        Some(Scale::Factor(factor)) => format!("raw × {factor}"),
        Some(Scale::Reciprocal { reciprocal }) => format!("{reciprocal} / raw"),
        Some(Scale::Anchor { raw, value: 1.0 }) => format!("raw / {raw}"),
        Some(Scale::Anchor { raw, value }) => format!("raw × {value} / {raw}"),
        Some(Scale::ByObject { raw, object }) => format!("raw × {} / {raw}", found.shifted(object)),
    };
    if let Some(offset) = reading.look.offset.filter(|offset| *offset != 0.0) {
        let sign = if offset < 0.0 { '-' } else { '+' };
        let raw = if right.is_empty() { "raw" } else { &right };
        right = format!("{raw} {sign} {}", offset.abs());
    }
    match (unit, right.as_str()) {
        (unit, "") => unit.to_owned(),
        ("", right) => format!("value = {right}"),
        (unit, right) => format!("{unit} = {right}"),
    }
}

/// Object in a formula: `5208:02 Nominal pressure, 315 bar as delivered`.
pub(in crate::cmd) fn formula_needs(
    device: &Device,
    reading: &Reading,
    found: &ResolvedObject<'_>,
) -> Option<String> {
    let Some(Scale::ByObject { object, .. }) = reading.look.scale else { return None };
    let address = found.shifted(object);
    let held = Resolver::new(&device.dictionary, &NoValues).meaning(address);
    let default = device.dictionary.find(address).and_then(|by| delivered(by.entry?, &held?));
    let as_delivered = default.map_or(String::new(), |default| format!(", {default} as delivered"));
    Some(format!("{}{as_delivered}", named(device, address)))
}

fn number(raw: i64, data_type: Option<DataType>) -> Value {
    match u64::try_from(raw) {
        Ok(number) if !data_type.is_some_and(DataType::is_signed) => Value::Unsigned(number),
        _ => Value::Integer(raw),
    }
}

/// Default value: `500 ms`, `CAN bus (0)`.
pub(in crate::cmd) fn delivered(entry: &Entry, meaning: &Meaning) -> Option<String> {
    Some(match entry.default.as_ref()? {
        DefaultValue::Number(raw) => meaning.show(&number(*raw, entry.data_type)),
        DefaultValue::Real(real) => meaning.show(&Value::Real(*real)),
        DefaultValue::Text(text) => text.clone(),
    })
}

/// Permitted range in the manual: `-100.0 to 100.0 %`; empty if only the type limits it.
pub(in crate::cmd) fn permitted(meaning: &Meaning) -> String {
    let unit = if meaning.unit.is_empty() { String::new() } else { format!(" {}", meaning.unit) };
    if let Some([least, most]) = meaning.limits {
        return format!("{least} to {most}{unit}");
    }
    let Some([least, most]) = meaning.range else { return String::new() };
    let plain = Meaning { unit: String::new(), special: None, values: None, bits: None, ..meaning.clone() };
    let show = |raw| plain.show(&number(raw, meaning.data_type));
    if least == most {
        format!("{}{unit}", show(least))
    } else {
        format!("{} to {}{unit}", show(least), show(most))
    }
}

/// Permitted raw range; empty without a scale.
pub(in crate::cmd) fn permitted_raw(meaning: &Meaning) -> String {
    match meaning.range.filter(|_| meaning.scale.is_some()) {
        Some([least, most]) => format!("raw {least} to {most}"),
        None => String::new(),
    }
}

/// A value of an enumeration: decimal, or hexadecimal for a bit pattern.
fn key(value: i64, names: &Names, data_type: Option<DataType>) -> String {
    let is_pattern = names.0.keys().any(|key| *key > 0xFF) && !names.0.keys().any(|key| *key < 0);
    let digits = usize::from(data_type.and_then(DataType::bits).unwrap_or(16).div_ceil(4));
    if is_pattern { format!("{value:0digits$X}h") } else { value.to_string() }
}

/// One line per name: `0  CAN bus`.
pub(in crate::cmd) fn name_lines(names: &Names, data_type: Option<DataType>) -> Vec<String> {
    let keys: Vec<_> = names.0.keys().map(|value| key(*value, names, data_type)).collect();
    let width = keys.iter().map(String::len).max().unwrap_or(0);
    keys.iter().zip(names.0.values()).map(|(key, name)| format!("{key:<width$}  {name}")).collect()
}

/// `0 = CAN bus, 1 = service tool`, or the number of names.
fn names_in_short(names: &Names, data_type: Option<DataType>, word: &str) -> String {
    let list: Vec<_> =
        names.0.iter().map(|(value, name)| format!("{} = {name}", key(*value, names, data_type))).collect();
    let text = list.join(", ");
    let few = list.len() <= FEW_NAMES.0 && text.chars().count() <= FEW_NAMES.1;
    if few { text } else { format!("{} {word}", list.len()) }
}

/// `3  pressure control, else angle control`.
pub(in crate::cmd) fn bit_line(bit: &BitName) -> String {
    let last = bit.bit.saturating_add(bit.width.saturating_sub(1));
    let place = if last == bit.bit { last.to_string() } else { format!("{}-{last}", bit.bit) };
    let mut words = bit.text.clone().unwrap_or_else(|| super::spaced(&bit.name));
    if let Some(off) = &bit.off {
        let _ = write!(words, ", else {off}");
    }
    if let Some(values) = &bit.values {
        let names: Vec<_> = values.0.iter().map(|(value, name)| firm(&format!("{value} = {name}"))).collect();
        let _ = write!(words, ": {}", names.join(", "));
    }
    format!("{place:<5}  {words}")
}

/// Storage of a value.
pub(in crate::cmd) fn storage(entry: &Entry, found: &ResolvedObject<'_>) -> String {
    match (entry.storage, entry.save) {
        (Storage::Volatile, _) => "lost at reset".into(),
        (Storage::EachWrite, _) => "stored in non-volatile memory at each write".into(),
        (Storage::Save, Some(save)) => format!("kept after a save by {}", found.shifted(save)),
        (Storage::Save, None) => "kept after a save".into(),
        (Storage::Fixed, _) => "never changes".into(),
        (Storage::Unknown, _) => String::new(),
    }
}

/// Time at which a write becomes effective.
pub(in crate::cmd) const fn effect(effect: Effect) -> &'static str {
    match effect {
        Effect::AtOnce => "at once",
        Effect::AtSync => "at the next SYNC with the node's own identifier",
        Effect::ResetCommunication => "after reset communication or a stronger reset",
        Effect::ResetNode => "after reset node or power-on",
        Effect::PowerOn => "after power-on",
        Effect::Never => "accepted without effect",
        Effect::Unknown => "",
    }
}

/// `6043:00 = -3 (pQ, Q closed loop)`.
pub(in crate::cmd) fn when(device: &Device, when: &ObjectCondition, object: ObjectAddress) -> String {
    equals(device, object, &when.equals, "=")
}

/// `5208:01 = 0 (CAN bus)`.
pub(in crate::cmd) fn equals(
    device: &Device,
    object: ObjectAddress,
    numbers: &Numbers,
    sign: &str,
) -> String {
    let meaning = Resolver::new(&device.dictionary, &NoValues).meaning(object);
    let names = meaning.as_ref().and_then(|meaning| meaning.values.as_deref());
    let one = |raw: i64| {
        let name = names.and_then(|names| names.get(raw));
        name.map_or_else(|| plain(raw), |name| format!("{} ({name})", plain(raw)))
    };
    let list = match numbers {
        Numbers::One(number) => one(*number),
        Numbers::Any(any) if any.len() <= FEW_NUMBERS => {
            any.iter().map(|number| one(*number)).collect::<Vec<_>>().join(" or ")
        }
        Numbers::Any(any) => any.iter().map(|number| plain(*number)).collect::<Vec<_>>().join(", "),
    };
    firm(&format!("{object} {sign} {list}"))
}

/// A number; hexadecimal above 0xFF, because it is likely a signature or a pattern.
pub(in crate::cmd) fn plain(number: i64) -> String {
    if number > 0xFF { format!("{number:X}h") } else { number.to_string() }
}

/// `5208:02`, `1003:01…FE`.
fn sub_range(address: ObjectAddress, entry: &Entry) -> String {
    if entry.to == entry.sub { address.to_string() } else { format!("{address}…{:02X}", entry.to) }
}

/// `5208:02`, `1003:01…FE`, `5400:00…540F:00`.
pub(in crate::cmd) fn addresses(object: &Object, entry: &Entry) -> String {
    let mut text = sub_range(ObjectAddress::new(object.index, entry.sub), entry);
    if let Some(further) = object.repeat.count.checked_sub(1).filter(|further| *further > 0) {
        let last = object.index.wrapping_add(further.wrapping_mul(object.repeat.stride));
        let _ = write!(text, "…{}", ObjectAddress::new(last, entry.to));
    }
    text
}

/// `×16`, `×8, +800h each`.
fn count(object: &Object) -> String {
    match (object.repeat.count, object.repeat.stride) {
        (..=1, _) => String::new(),
        (count, 1) => format!("×{count}"),
        (count, stride) => format!("×{count}, +{stride:X}h each"),
    }
}

/// Name of an entry with the range of its repeats: `Parameter set 0…15, P gain`.
pub(in crate::cmd) fn title(object: &Object, found: &ResolvedObject<'_>) -> String {
    let first = object.number(0);
    let last = object.number(object.repeat.count.saturating_sub(1));
    if first == last {
        return found.name();
    }
    let entry = found.entry.filter(|_| object.is_record).and_then(|entry| entry.look.name.as_deref());
    let name = match entry {
        Some(entry) if entry != object.name => format!("{}, {entry}", object.name),
        _ => object.name.clone(),
    };
    name.replace("{n}", &format!("{first}…{last}"))
}

/// Type, access, unit and formula, range, default and names, in short form.
fn facts(entry: &Entry, reading: &Reading, found: &ResolvedObject<'_>) -> Vec<String> {
    let mut facts = Vec::new();
    let access = entry.access.map_or("", |access| access.name());
    let data_type = entry.data_type.map_or(String::new(), DataType::name);
    if reading.when.is_none() {
        facts.push(format!("{data_type} {access}").trim().to_owned());
    }
    facts.push(formula(reading, found));
    let meaning = &reading.meaning;
    if meaning.values.is_none() && meaning.bits.is_none() {
        facts.push(permitted(meaning));
    }
    if let Some(names) = meaning.values.as_deref() {
        facts.push(names_in_short(names, entry.data_type, "values"));
    }
    if let Some(names) = meaning.special.as_deref() {
        facts.push(names_in_short(names, entry.data_type, "special values"));
    }
    if let Some(bits) = meaning.bits.as_deref() {
        let named = bits.list.iter().filter(|bit| !bit.reserved).count();
        facts.push(format!("{named} bit fields"));
    }
    if let Some(default) = delivered(entry, meaning).filter(|_| reading.when.is_none()) {
        facts.push(format!("default {default}"));
    }
    facts.retain(|fact| !fact.is_empty());
    facts.iter().map(|fact| firm(fact)).collect()
}

/// Name and properties of an entry in one line.
pub(in crate::cmd) fn one(device: &Device, found: &ResolvedObject<'_>, entry: &Entry) -> String {
    let own = readings(device, found, entry).into_iter().next();
    let facts = own.map_or_else(Vec::new, |own| facts(entry, &own, found));
    std::iter::once(found.name()).chain(facts).collect::<Vec<_>>().join(", ")
}

/// `6043:00 = -3 (pQ): Flow set point, l/min = raw × 0.1`; `None` for the default interpretation.
pub(in crate::cmd) fn mode_line(
    device: &Device,
    found: &ResolvedObject<'_>,
    entry: &Entry,
    reading: &Reading,
) -> Option<String> {
    let condition = reading.when.as_ref()?;
    let condition = when(device, condition, found.shifted(condition.object));
    let name = Some(reading.meaning.name.clone()).filter(|name| *name != found.name());
    let what: Vec<_> = name.into_iter().chain(facts(entry, reading, found)).collect();
    Some(format!("{condition}: {}", what.join(", ")))
}

/// One line per entry, and one per mode below it; for all repeats or for one.
pub(in crate::cmd) fn lines(
    device: &Device,
    object: &Object,
    entry: &Entry,
    nth: Option<u16>,
) -> Vec<String> {
    let index = object.index.wrapping_add(nth.unwrap_or(0).wrapping_mul(object.repeat.stride));
    let address = ObjectAddress::new(index, entry.sub);
    let found = ResolvedObject { address, object, entry: Some(entry), nth: nth.unwrap_or(0) };
    let (place, name, count) = match nth {
        Some(_) => (sub_range(address, entry), found.name(), String::new()),
        None => (addresses(object, entry), title(object, &found), count(object)),
    };
    let mut lines = Vec::new();
    for reading in readings(device, &found, entry) {
        if let Some(line) = mode_line(device, &found, entry, &reading) {
            lines.push(format!("{:9}{line}", ""));
            continue;
        }
        let mut what = vec![name.clone()];
        what.extend(facts(entry, &reading, &found));
        what.extend(Some(count.clone()).filter(|count| !count.is_empty()));
        lines.push(format!("{place}  {}  {}", what.join(", "), section(&entry.source)));
    }
    lines
}
