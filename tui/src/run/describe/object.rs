//! Text on objects in a profile: names, formulas, ranges, enumerations, bits.

use std::fmt::Write as _;

use cobscope_decoder::bus_file::encode_number;
use cobscope_decoder::profile::object::{
    DefaultValue, NumberList, ObjectCondition, RawScale, ValueInterpretation, ValueStorage, WriteEffect,
};
use cobscope_decoder::profile::{BitName, ValueNames};
use cobscope_decoder::profile::{
    DataType, DecodedValue, DeviceProfile, EntryResolver, KnownValues, NoValues, ObjectEntry, ObjectMeaning,
    ResolvedObject, SubEntry,
};
use cobscope_decoder::wire::canopen::ObjectAddress;

use super::{section_text, unbroken_text};

/// Maximum number of names and characters of an enumeration within a line.
const FEW_NAMES: (usize, usize) = (4, 60);

/// Maximum number of values listed with their names.
const FEW_NUMBERS: usize = 2;

/// Assumed values of objects.
struct AssumedValues(Vec<(ObjectAddress, Vec<u8>)>);

impl KnownValues for AssumedValues {
    fn object_bytes(&self, object: ObjectAddress) -> Option<(&[u8], bool)> {
        let found = self.0.iter().find(|(address, _)| *address == object);
        found.map(|(_, bytes)| (bytes.as_slice(), false))
    }

    fn object_unit(&self, _: ObjectAddress) -> Option<&str> {
        None
    }
}

/// Interpretation of an entry, depending on the value of another object.
pub struct EntryReading {
    /// Condition on another object; `None` for the default interpretation.
    pub when: Option<ObjectCondition>,
    /// Keys of the interpretation, completed by those of the entry.
    pub look: ValueInterpretation,
    /// Meaning with all other objects at their default values.
    pub meaning: ObjectMeaning,
}

/// `5208:02 Command values, Nominal pressure`.
pub fn object_title(device: &DeviceProfile, address: ObjectAddress) -> String {
    let found = device.dictionary.find_object(address);
    found.map_or_else(|| address.to_string(), |found| format!("{address} {}", found.name()))
}

/// Interpretations of an entry, the default one first.
pub fn entry_readings(
    device: &DeviceProfile,
    found: &ResolvedObject<'_>,
    entry: &SubEntry,
) -> Vec<EntryReading> {
    let meaning = |known: &dyn KnownValues| {
        EntryResolver::new(&device.dictionary, known).resolve_meaning(found.address).unwrap_or_default()
    };
    let base = if entry.modes.is_empty() {
        meaning(&NoValues)
    } else {
        meaning(&AssumedValues(
            entry.modes.iter().filter_map(|(when, _)| unused_value(device, found, entry, when)).collect(),
        ))
    };
    let mut all = vec![EntryReading { when: None, look: entry.look.clone(), meaning: base }];
    for (when, look) in &entry.modes {
        let number = match &when.equals {
            NumberList::One(one) => *one,
            NumberList::Any(any) => any.first().copied().unwrap_or_default(),
        };
        let supposed = supposed_value(device, found.shift_reference(when.object), number);
        let meaning = meaning(&AssumedValues(supposed.into_iter().collect()));
        all.push(EntryReading { when: Some(when.clone()), look: complete_mode(look, &entry.look), meaning });
    }
    all
}

/// A value of the object in `when` that no mode uses.
fn unused_value(
    device: &DeviceProfile,
    found: &ResolvedObject<'_>,
    entry: &SubEntry,
    when: &ObjectCondition,
) -> Option<(ObjectAddress, Vec<u8>)> {
    let free = (0..=127).find(|number| !entry.modes.iter().any(|(when, _)| when.equals.contains(*number)))?;
    supposed_value(device, found.shift_reference(when.object), free)
}

fn supposed_value(
    device: &DeviceProfile,
    object: ObjectAddress,
    number: i64,
) -> Option<(ObjectAddress, Vec<u8>)> {
    let bytes = encode_number(number, device.dictionary.data_type(object)).ok()?;
    Some((object, bytes))
}

/// Keys of a mode, completed by those of the entry.
fn complete_mode(mode: &ValueInterpretation, own: &ValueInterpretation) -> ValueInterpretation {
    ValueInterpretation {
        name: mode.name.clone().or_else(|| own.name.clone()),
        unit: mode.unit.clone().or_else(|| own.unit.clone()),
        scale: mode.scale.or(own.scale),
        offset: mode.offset.or(own.offset),
        ..mode.clone()
    }
}

/// `bar = raw × 5208:02 / 16383`, `µs = raw × 100`, `ms`; empty for plain numbers.
pub fn formula_text(reading: &EntryReading, found: &ResolvedObject<'_>) -> String {
    let unit = reading.look.unit.as_deref().unwrap_or_default();
    let mut right = match reading.look.scale {
        None => String::new(),
        Some(RawScale::Factor(factor)) => format!("raw × {factor}"),
        Some(RawScale::Reciprocal { reciprocal }) => format!("{reciprocal} / raw"),
        Some(RawScale::Anchor { raw, value: 1.0 }) => format!("raw / {raw}"),
        Some(RawScale::Anchor { raw, value }) => format!("raw × {value} / {raw}"),
        Some(RawScale::ByObject { raw, object }) => {
            format!("raw × {} / {raw}", found.shift_reference(object))
        }
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
pub fn formula_needs(
    device: &DeviceProfile,
    reading: &EntryReading,
    found: &ResolvedObject<'_>,
) -> Option<String> {
    let Some(RawScale::ByObject { object, .. }) = reading.look.scale else { return None };
    let address = found.shift_reference(object);
    let held = EntryResolver::new(&device.dictionary, &NoValues).resolve_meaning(address);
    let default = device.dictionary.find_object(address).and_then(|by| default_text(by.entry?, &held?));
    let as_delivered = default.map_or(String::new(), |default| format!(", {default} as delivered"));
    Some(format!("{}{as_delivered}", object_title(device, address)))
}

fn raw_value(raw: i64, data_type: Option<DataType>) -> DecodedValue {
    match u64::try_from(raw) {
        Ok(number) if !data_type.is_some_and(DataType::is_signed) => DecodedValue::Unsigned(number),
        _ => DecodedValue::Integer(raw),
    }
}

/// Default value: `500 ms`, `CAN bus (0)`.
pub fn default_text(entry: &SubEntry, meaning: &ObjectMeaning) -> Option<String> {
    Some(match entry.default.as_ref()? {
        DefaultValue::Number(raw) => meaning.format_value(&raw_value(*raw, entry.data_type)),
        DefaultValue::Real(real) => meaning.format_value(&DecodedValue::Real(*real)),
        DefaultValue::Text(text) => text.clone(),
    })
}

/// Permitted range in the manual: `-100.0 to 100.0 %`; empty if only the type limits it.
pub fn permitted_text(meaning: &ObjectMeaning) -> String {
    let unit = if meaning.unit.is_empty() { String::new() } else { format!(" {}", meaning.unit) };
    if let Some([least, most]) = meaning.limits {
        return format!("{least} to {most}{unit}");
    }
    let Some([least, most]) = meaning.range else { return String::new() };
    let plain =
        ObjectMeaning { unit: String::new(), special: None, values: None, bits: None, ..meaning.clone() };
    let show = |raw| plain.format_value(&raw_value(raw, meaning.data_type));
    if least == most {
        format!("{}{unit}", show(least))
    } else {
        format!("{} to {}{unit}", show(least), show(most))
    }
}

/// Permitted raw range; empty without a scale.
pub fn permitted_raw(meaning: &ObjectMeaning) -> String {
    match meaning.range.filter(|_| meaning.scale.is_some()) {
        Some([least, most]) => format!("raw {least} to {most}"),
        None => String::new(),
    }
}

/// A value of an enumeration: decimal, or hexadecimal for a bit pattern.
fn enum_key(value: i64, names: &ValueNames, data_type: Option<DataType>) -> String {
    let is_pattern = names.0.keys().any(|key| *key > 0xFF) && !names.0.keys().any(|key| *key < 0);
    let digits = usize::from(data_type.and_then(DataType::bits).unwrap_or(16).div_ceil(4));
    if is_pattern { format!("{value:0digits$X}h") } else { value.to_string() }
}

/// One line per name: `0  CAN bus`.
pub fn name_lines(names: &ValueNames, data_type: Option<DataType>) -> Vec<String> {
    let keys: Vec<_> = names.0.keys().map(|value| enum_key(*value, names, data_type)).collect();
    let width = keys.iter().map(String::len).max().unwrap_or(0);
    keys.iter().zip(names.0.values()).map(|(key, name)| format!("{key:<width$}  {name}")).collect()
}

/// `0 = CAN bus, 1 = service tool`, or the number of names.
fn names_in_short(names: &ValueNames, data_type: Option<DataType>, word: &str) -> String {
    let list: Vec<_> = names
        .0
        .iter()
        .map(|(value, name)| format!("{} = {name}", enum_key(*value, names, data_type)))
        .collect();
    let text = list.join(", ");
    let few = list.len() <= FEW_NAMES.0 && text.chars().count() <= FEW_NAMES.1;
    if few { text } else { format!("{} {word}", list.len()) }
}

/// `3  pressure control, else angle control`.
pub fn bit_line(bit: &BitName) -> String {
    let last = bit.bit.saturating_add(bit.width.saturating_sub(1));
    let place = if last == bit.bit { last.to_string() } else { format!("{}-{last}", bit.bit) };
    let mut words = bit.text.clone().unwrap_or_else(|| super::spaced_name(&bit.name));
    if let Some(off) = &bit.off {
        let _ = write!(words, ", else {off}");
    }
    if let Some(values) = &bit.values {
        let names: Vec<_> =
            values.0.iter().map(|(value, name)| unbroken_text(&format!("{value} = {name}"))).collect();
        let _ = write!(words, ": {}", names.join(", "));
    }
    format!("{place:<5}  {words}")
}

/// Storage of a value.
pub fn storage_text(entry: &SubEntry, found: &ResolvedObject<'_>) -> String {
    match (entry.storage, entry.save) {
        (ValueStorage::Volatile, _) => "lost at reset".into(),
        (ValueStorage::EachWrite, _) => "stored in non-volatile memory at each write".into(),
        (ValueStorage::Save, Some(save)) => format!("kept after a save by {}", found.shift_reference(save)),
        (ValueStorage::Save, None) => "kept after a save".into(),
        (ValueStorage::Fixed, _) => "never changes".into(),
        (ValueStorage::Unknown, _) => String::new(),
    }
}

/// Time at which a write becomes effective.
pub const fn effect_text(effect: WriteEffect) -> &'static str {
    match effect {
        WriteEffect::AtOnce => "at once",
        WriteEffect::AtSync => "at the next SYNC with the node's own identifier",
        WriteEffect::ResetCommunication => "after reset communication or a stronger reset",
        WriteEffect::ResetNode => "after reset node or power-on",
        WriteEffect::PowerOn => "after power-on",
        WriteEffect::Never => "accepted without effect",
        WriteEffect::Unknown => "",
    }
}

/// `6043:00 = -3 (pQ, Q closed loop)`.
pub fn condition_text(device: &DeviceProfile, when: &ObjectCondition, object: ObjectAddress) -> String {
    equality_text(device, object, &when.equals, "=")
}

/// `5208:01 = 0 (CAN bus)`.
pub fn equality_text(
    device: &DeviceProfile,
    object: ObjectAddress,
    numbers: &NumberList,
    sign: &str,
) -> String {
    let meaning = EntryResolver::new(&device.dictionary, &NoValues).resolve_meaning(object);
    let names = meaning.as_ref().and_then(|meaning| meaning.values.as_deref());
    let one = |raw: i64| {
        let name = names.and_then(|names| names.get(raw));
        name.map_or_else(|| plain_number(raw), |name| format!("{} ({name})", plain_number(raw)))
    };
    let list = match numbers {
        NumberList::One(number) => one(*number),
        NumberList::Any(any) if any.len() <= FEW_NUMBERS => {
            any.iter().map(|number| one(*number)).collect::<Vec<_>>().join(" or ")
        }
        NumberList::Any(any) => any.iter().map(|number| plain_number(*number)).collect::<Vec<_>>().join(", "),
    };
    unbroken_text(&format!("{object} {sign} {list}"))
}

/// A number; hexadecimal above 0xFF, because it is likely a signature or a pattern.
pub fn plain_number(number: i64) -> String {
    if number > 0xFF { format!("{number:X}h") } else { number.to_string() }
}

/// `5208:02`, `1003:01…FE`.
fn sub_range(address: ObjectAddress, entry: &SubEntry) -> String {
    if entry.to == entry.sub { address.to_string() } else { format!("{address}…{:02X}", entry.to) }
}

/// `5208:02`, `1003:01…FE`, `5400:00…540F:00`.
pub fn address_text(object: &ObjectEntry, entry: &SubEntry) -> String {
    let mut text = sub_range(ObjectAddress::new(object.index, entry.sub), entry);
    if let Some(further) = object.repeat.count.checked_sub(1).filter(|further| *further > 0) {
        let last = object.index.wrapping_add(further.wrapping_mul(object.repeat.stride));
        let _ = write!(text, "…{}", ObjectAddress::new(last, entry.to));
    }
    text
}

/// `×16`, `×8, +800h each`.
fn repeat_text(object: &ObjectEntry) -> String {
    match (object.repeat.count, object.repeat.stride) {
        (..=1, _) => String::new(),
        (count, 1) => format!("×{count}"),
        (count, stride) => format!("×{count}, +{stride:X}h each"),
    }
}

/// Name of an entry with the range of its repeats: `Parameter set 0…15, P gain`.
pub fn entry_title(object: &ObjectEntry, found: &ResolvedObject<'_>) -> String {
    let first = object.repeat_number(0);
    let last = object.repeat_number(object.repeat.count.saturating_sub(1));
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
fn entry_facts(entry: &SubEntry, reading: &EntryReading, found: &ResolvedObject<'_>) -> Vec<String> {
    let mut facts = Vec::new();
    let access = entry.access.map_or("", |access| access.name());
    let data_type = entry.data_type.map_or(String::new(), DataType::name);
    if reading.when.is_none() {
        facts.push(format!("{data_type} {access}").trim().to_owned());
    }
    facts.push(formula_text(reading, found));
    let meaning = &reading.meaning;
    if meaning.values.is_none() && meaning.bits.is_none() {
        facts.push(permitted_text(meaning));
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
    if let Some(default) = default_text(entry, meaning).filter(|_| reading.when.is_none()) {
        facts.push(format!("default {default}"));
    }
    facts.retain(|fact| !fact.is_empty());
    facts.iter().map(|fact| unbroken_text(fact)).collect()
}

/// Name and properties of an entry in one line.
pub fn entry_line(device: &DeviceProfile, found: &ResolvedObject<'_>, entry: &SubEntry) -> String {
    let own = entry_readings(device, found, entry).into_iter().next();
    let facts = own.map_or_else(Vec::new, |own| entry_facts(entry, &own, found));
    std::iter::once(found.name()).chain(facts).collect::<Vec<_>>().join(", ")
}

/// `6043:00 = -3 (pQ): Flow set point, l/min = raw × 0.1`; `None` for the default interpretation.
pub fn mode_line(
    device: &DeviceProfile,
    found: &ResolvedObject<'_>,
    entry: &SubEntry,
    reading: &EntryReading,
) -> Option<String> {
    let condition = reading.when.as_ref()?;
    let condition = condition_text(device, condition, found.shift_reference(condition.object));
    let name = Some(reading.meaning.name.clone()).filter(|name| *name != found.name());
    let what: Vec<_> = name.into_iter().chain(entry_facts(entry, reading, found)).collect();
    Some(format!("{condition}: {}", what.join(", ")))
}

/// One line per entry, and one per mode below it; for all repeats or for one.
pub fn entry_lines(
    device: &DeviceProfile,
    object: &ObjectEntry,
    entry: &SubEntry,
    nth: Option<u16>,
) -> Vec<String> {
    let index = object.index.wrapping_add(nth.unwrap_or(0).wrapping_mul(object.repeat.stride));
    let address = ObjectAddress::new(index, entry.sub);
    let found = ResolvedObject { address, object, entry: Some(entry), nth: nth.unwrap_or(0) };
    let (place, name, count) = match nth {
        Some(_) => (sub_range(address, entry), found.name(), String::new()),
        None => (address_text(object, entry), entry_title(object, &found), repeat_text(object)),
    };
    let mut lines = Vec::new();
    for reading in entry_readings(device, &found, entry) {
        if let Some(line) = mode_line(device, &found, entry, &reading) {
            lines.push(format!("{:9}{line}", ""));
            continue;
        }
        let mut what = vec![name.clone()];
        what.extend(entry_facts(entry, &reading, &found));
        what.extend(Some(count.clone()).filter(|count| !count.is_empty()));
        lines.push(format!("{place}  {}  {}", what.join(", "), section_text(&entry.source)));
    }
    lines
}
