//! The conversion of a raw value, and the objects it depends on.
//!
//! ```text
//! raw 6144 × 100 / 16384 = 37.5 %
//! full scale 5208:02 Nominal pressure = 315 bar, read {88} 1.234 s
//! ```

use cobscope_decoder::profile::object::RawScale;
use cobscope_decoder::profile::{
    BitOrder, DataType, DecodedSignal, DecodedValue, ObjectMeaning, RawConversion, ResolvedObject,
    SignalField, as_word, letter_legend, word_letters,
};
use cobscope_decoder::session::{Node, StoredObject};
use cobscope_decoder::wire::canopen::ObjectAddress;

use crate::state::UiState;

/// Position of a field in the payload, and its byte order.
pub(super) fn field_place(field: &SignalField) -> Vec<String> {
    let (first, bit) = (field.bit / 8, field.bit % 8);
    let order = match field.order {
        _ if field.bits <= 8 && field.bits + bit <= 8 => "",
        BitOrder::LittleEndian => ", least significant byte first",
        BitOrder::BigEndian => ", most significant bit first",
    };
    let kind = if field.is_typed { format!(", {}", field.data_type.name()) } else { String::new() };
    let bits = if field.bits == 1 { "1 bit".into() } else { format!("{} bits", field.bits) };
    vec![format!("{bits} from bit {bit} of byte {first} on{order}{kind}")]
}

/// Conversion of the value of a field.
pub(super) fn field_notes(
    core: &UiState,
    node: Option<&Node>,
    field: &SignalField,
    signal: &DecodedSignal<'_>,
) -> Vec<String> {
    let mut all = Vec::new();
    match field.meaning.as_deref() {
        Some(meaning) => of_value(core, node, meaning, &signal.value, &mut all),
        None => all.push(format!("raw {} = {:X}h; meaning unknown", signal.raw, signal.raw)),
    }
    all
}

/// Conversion of the value of an object.
pub(super) fn of_value(
    core: &UiState,
    node: Option<&Node>,
    meaning: &ObjectMeaning,
    value: &DecodedValue,
    all: &mut Vec<String>,
) {
    if let Some(text) = formula_text(node, meaning, value) {
        all.push(text);
    }
    if let Some((object, _)) = meaning.scale.and_then(|scale| scale.full_scale) {
        all.push(source_text(core, node, "full scale", object));
    }
    if let Some(bits) = meaning.bits.as_deref()
        && let Some(word) = as_word(value)
    {
        if let Some(letters) = word_letters(bits, word) {
            all.push(format!("in event rows {letters}: {}", letter_legend(bits).join(", ")));
        }
        for bit in bits.list.iter().filter(|bit| !bit.reserved) {
            let number = bit.bits_of(word);
            let last = u16::from(bit.bit) + u16::from(bit.width.saturating_sub(1));
            let place = if bit.width <= 1 { bit.bit.to_string() } else { format!("{last}..{}", bit.bit) };
            let title = bit.bit_title();
            let words = bit.bit_word(number).filter(|words| words != title);
            let words = words.map_or(String::new(), |words| format!(": {words}"));
            all.push(format!("bit {place} = {number} {title}{words}"));
        }
    }
    if let Some(permitted) = permitted_text(meaning) {
        let is_outside = if meaning.is_outside(value) { "OUT OF RANGE" } else { "in range" };
        all.push(format!("{is_outside} {permitted}"));
    }
    if let Some(values) = meaning.values.as_deref() {
        let names: Vec<_> =
            values.0.iter().take(MOST_NAMES).map(|(key, name)| format!("{key} {name}")).collect();
        let more = if values.0.len() > MOST_NAMES { ", …" } else { "" };
        all.push(format!("values: {}{more}", names.join(", ")));
    }
    for object in deciding_objects(node, meaning.object) {
        all.push(source_text(core, node, "interpreted by", object));
    }
    if meaning.assumed {
        all.push("presumed: based on a default, or on a value that may have changed since".into());
    }
}

/// Maximum number of names of an enumeration.
const MOST_NAMES: usize = 16;

/// Objects whose values select the meaning of an object.
fn deciding_objects(node: Option<&Node>, object: ObjectAddress) -> Vec<ObjectAddress> {
    let found = node.and_then(|node| node.device().dictionary.find_object(object));
    let Some((found, entry)) = found.and_then(|found| Some((found, found.entry?))) else { return Vec::new() };
    let mut all: Vec<_> = entry.modes.iter().map(|(when, _)| found.shift_reference(when.object)).collect();
    all.dedup();
    all
}

/// `raw 6144 × 100 / 16384 = 37.5 %`.
fn formula_text(node: Option<&Node>, meaning: &ObjectMeaning, value: &DecodedValue) -> Option<String> {
    let raw = match value {
        DecodedValue::Unsigned(raw) => raw.to_string(),
        DecodedValue::Integer(raw) => raw.to_string(),
        DecodedValue::Real(raw) => raw.to_string(),
        DecodedValue::Text(_) | DecodedValue::Bytes(_) => return None,
    };
    let Some(scale) = meaning.scale else {
        let hex =
            as_word(value).map_or(String::new(), |word| format!(" = {}", hexadecimal_text(word, meaning)));
        return Some(format!("raw {raw}{hex}"));
    };
    if let Some(label) = meaning.value_label(value) {
        return Some(format!("raw {raw} = {label}, not a quantity"));
    }
    let found = node.and_then(|node| node.device().dictionary.find_object(meaning.object));
    let mut right = found.and_then(|found| as_written(&found, scale)).unwrap_or_else(|| match scale.factor {
        factor if scale.is_reciprocal => format!(": {factor} / raw"),
        1.0 => String::new(),
        factor => format!(" × {factor}"),
    });
    if scale.offset != 0.0 {
        let sign = if scale.offset < 0.0 { '-' } else { '+' };
        right = format!("{right} {sign} {}", scale.offset.abs());
    }
    let shown =
        ObjectMeaning { values: None, special: None, bits: None, ..meaning.clone() }.format_value(value);
    Some(format!("raw {raw}{right} = {shown}"))
}

fn hexadecimal_text(word: u64, meaning: &ObjectMeaning) -> String {
    let width = meaning.data_type.and_then(DataType::bits).unwrap_or(64).clamp(1, 64);
    let digits = usize::from(width.div_ceil(4));
    format!("{:0digits$X}h", word & (u64::MAX >> (64 - width)))
}

/// The scale in the numbers of the manual: the form that gives the same factor.
fn as_written(found: &ResolvedObject<'_>, scale: RawConversion) -> Option<String> {
    let entry = found.entry?;
    let looks = entry.modes.iter().map(|(_, look)| look).chain([&entry.look]);
    let mut forms = looks.filter_map(|look| match look.scale? {
        RawScale::Reciprocal { reciprocal } => Some((reciprocal, format!(": {reciprocal} / raw"))),
        RawScale::Factor(factor) => Some((factor, format!(" × {factor}"))),
        RawScale::Anchor { raw, value: 1.0 } => Some((1.0 / raw, format!(" / {raw}"))),
        RawScale::Anchor { raw, value } => Some((value / raw, format!(" × {value} / {raw}"))),
        RawScale::ByObject { raw, .. } => {
            let (_, value) = scale.full_scale?;
            Some((value / raw, format!(" × {value} / {raw}")))
        }
    });
    forms
        .find(|(factor, _)| (factor - scale.factor).abs() <= scale.factor.abs() * 1e-12)
        .map(|(_, text)| text)
}

/// `full scale 5208:02 Nominal pressure = 315 bar, read {88} 1.234 s`.
fn source_text(core: &UiState, node: Option<&Node>, what: &str, object: ObjectAddress) -> String {
    let meaning = node.and_then(|node| node.meaning(object));
    let name = meaning.as_ref().map_or(String::new(), |meaning| format!(" {}", meaning.name));
    if let Some(entry) = node.and_then(|node| node.store().get(object)) {
        let stale = if entry.stale { ", presumed: may have changed since" } else { "" };
        let value = value_text(meaning.as_ref(), &entry.value);
        return format!("{what} {object}{name} = {value}, {}{stale}", origin_text(core, entry));
    }
    let found = node.and_then(|node| Some((node.device().dictionary.find_object(object)?.entry?, node)));
    let raw = found.and_then(|(entry, node)| entry.default_number(Some(node.id().number())));
    match raw.zip(meaning).map(|(raw, meaning)| meaning.format_value(&meaning.convert_raw(raw))) {
        Some(value) => format!("{what} {object}{name} = {value}, presumed: default value"),
        None => format!("{what} {object}{name}: unknown"),
    }
}

/// `read {88} 1.234 s`.
pub(super) fn origin_text(core: &UiState, entry: &StoredObject) -> String {
    let place = entry.origin.origin_place();
    let time = core.time_words(entry.origin.time, 3).map_or(String::new(), |time| format!(" {time}"));
    format!("{}{place}{time}", entry.origin.kind.origin_text())
}

/// `-100 to 100 %`, or the raw limits.
fn permitted_text(meaning: &ObjectMeaning) -> Option<String> {
    let unit = if meaning.unit.is_empty() { String::new() } else { format!(" {}", meaning.unit) };
    match (meaning.limits, meaning.range) {
        (Some([least, most]), _) => Some(format!("{least} to {most}{unit}")),
        (None, Some([least, most])) => Some(format!("raw {least} to {most}")),
        (None, None) => None,
    }
}

/// `05 83 21`.
pub(super) fn hex_bytes(bytes: &[u8]) -> String {
    bytes.iter().map(|byte| format!("{byte:02X}")).collect::<Vec<_>>().join(" ")
}

/// A value with its unit; bytes if the meaning is unknown.
pub(super) fn value_text(meaning: Option<&ObjectMeaning>, bytes: &[u8]) -> String {
    match meaning.map(|meaning| (meaning, meaning.decode(bytes))) {
        Some((meaning, value)) if !matches!(value, DecodedValue::Bytes(_)) => meaning.format_value(&value),
        _ => hex_bytes(bytes),
    }
}
