//! Writes a device file as the text of a profile that a user can extend.

use std::fmt::Write as _;
use std::sync::Arc;

use super::printable::is_terminal_control;
use super::{pdos, repeat};
use crate::profile::DeviceProfile;
use crate::profile::device_file::{DescriptionProblem, DeviceFile};
use crate::profile::entry::{ObjectEntry, SubEntry};
use crate::profile::object::{DefaultValue, NumberFormat, ONCE, RawScale, WriteEffect};
use crate::profile::plain_device;

/// Profile of a file; `name` is the file name without its folder. Comments at the top list the problems and
/// the parts that a profile cannot express.
pub fn write_profile(file: &Arc<DeviceFile>, name: &str) -> String {
    let device = super::describe_device(file, name);
    let standard = &plain_device().dictionary;
    let mut problems = file.problems.clone();
    problems.extend(super::objects::import_objects(file, standard, |_| true).problems);
    problems.sort_by_key(|problem| problem.line);
    let objects = device.dictionary.own_objects();
    let (pdos, left_out) = pdos::import_pdos(objects, &device.dictionary);
    let values = file.objects.iter().filter(|object| object.value.is_some()).count();
    let values =
        (values > 0).then(|| format!("{values} configured values omitted: they belong to one device"));
    problems.extend(left_out.into_iter().chain(values).map(|reason| DescriptionProblem { line: 0, reason }));
    let mut text = write_head(&device, name, &problems);
    for object in repeat::combine_objects(objects, object_properties) {
        push_object(&object, &mut text);
    }
    for pdos::ImportedPdo { name, fields } in pdos {
        let _ = writeln!(text, "\n[[pdo]]\npdo = \"{name}\"\nmapping = \"default\"\nfields = [");
        for (object, bits) in fields {
            let object = object.map_or(String::new(), |object| format!("object = \"{object}\", "));
            let _ = writeln!(text, "  {{ {object}bits = {bits} }},");
        }
        text.push_str("]\n");
    }
    text
}

fn write_head(device: &DeviceProfile, name: &str, problems: &[DescriptionProblem]) -> String {
    let mut text = format!("# Generated from {}.", escape_toml(name));
    match problems.len() {
        0 => text.push('\n'),
        count => _ = writeln!(text, " Omitted or uncertain ({count}):"),
    }
    for problem in problems {
        let _ = writeln!(text, "# {}", escape_toml(&problem.to_string()));
    }
    let _ = writeln!(text, "\nid = {}\ntitle = {}", quote_toml(&device.id), quote_toml(&device.title));
    if !device.vendor.is_empty() {
        let _ = writeln!(text, "vendor = {}", quote_toml(&device.vendor));
    }
    let _ = writeln!(text, "source = {}\nextends = [\"cia301\"]", quote_toml(name));
    for identity in &device.identities {
        text.push_str("\n[[identity]]\n");
        for (key, number) in [("vendor_id", identity.vendor_id), ("product_code", identity.product_code)] {
            if let Some(number) = number {
                let _ = writeln!(text, "{key} = {number:#010X}");
            }
        }
    }
    text
}

fn push_object(object: &ObjectEntry, text: &mut String) {
    let _ = writeln!(text, "\n[[object]]\nindex = {:#06X}", object.index);
    if object.repeat != ONCE {
        let repeat = object.repeat;
        let first =
            if repeat.first == ONCE.first { String::new() } else { format!(", first = {}", repeat.first) };
        let _ = writeln!(text, "repeat = {{ count = {}, stride = {}{first} }}", repeat.count, repeat.stride);
    }
    text.push_str(&object_properties(object));
}

/// Properties of an object other than its index.
fn object_properties(object: &ObjectEntry) -> String {
    let mut text = format!("name = {}\n", quote_toml(&object.name));
    if let ([entry], false) = (&object.entries[..], object.is_record) {
        for (key, value) in entry_keys(entry) {
            let _ = writeln!(text, "{key} = {value}");
        }
        return text;
    }
    text.push_str("sub = [\n");
    let mut entries = object.entries.iter().map(|entry| (entry, inline_keys(entry))).peekable();
    while let Some((entry, keys)) = entries.next() {
        let mut last = entry.to;
        while let Some((next, _)) =
            entries.next_if(|(next, same)| last.checked_add(1) == Some(next.sub) && *same == keys)
        {
            last = next.to;
        }
        let to = if last > entry.sub { format!(", to = {last}") } else { String::new() };
        let _ = writeln!(text, "  {{ sub = {}{to}{keys} }},", entry.sub);
    }
    text + "]\n"
}

/// Keys of an entry in the form `, name = "…", type = "…"`.
fn inline_keys(entry: &SubEntry) -> String {
    let name = entry.look.name.iter().map(|name| ("name", quote_toml(name)));
    let all = name.chain(entry_keys(entry)).map(|(key, value)| format!(", {key} = {value}"));
    all.collect()
}

/// Keys of an entry other than its name; units and similar properties originate from CiA 301.
fn entry_keys(entry: &SubEntry) -> Vec<(&'static str, String)> {
    let look = &entry.look;
    let format = match entry.format {
        NumberFormat::Decimal
        | NumberFormat::DecimalPairs
        | NumberFormat::Date
        | NumberFormat::TimeOfDay
        | NumberFormat::ParameterGroup => None,
        NumberFormat::Hex => Some("hex"),
        NumberFormat::Mapping => Some("mapping"),
        NumberFormat::Ascii => Some("ascii"),
        NumberFormat::Emcy => Some("emcy"),
        NumberFormat::HeartbeatConsumer => Some("heartbeat-consumer"),
    };
    let scale = match look.scale {
        Some(RawScale::Factor(factor)) => Some(format!("{factor}")),
        Some(RawScale::Reciprocal { reciprocal }) => Some(format!("{{ reciprocal = {reciprocal} }}")),
        _ => None,
    };
    let effect = Some(entry.effect).filter(|effect| *effect != WriteEffect::Unknown);
    let all = [
        ("type", entry.data_type.map(|data_type| quote_toml(&data_type.name()))),
        ("access", entry.access.map(|access| quote_toml(access.name()))),
        ("format", format.map(quote_toml)),
        ("unit", look.unit.as_deref().map(quote_toml)),
        ("scale", scale),
        ("range", look.range.map(|[least, most]| format!("[{least}, {most}]"))),
        ("default", entry.default.as_ref().map(|default| default_text(default, entry.format))),
        ("effect", effect.map(|effect| quote_toml(effect.name()))),
        ("note", Some(quote_toml(&entry.note)).filter(|_| !entry.note.is_empty())),
    ];
    all.into_iter().filter_map(|(key, value)| Some((key, value?))).collect()
}

fn default_text(given: &DefaultValue, format: NumberFormat) -> String {
    match given {
        DefaultValue::Number(number @ 0..)
            if !matches!(format, NumberFormat::Decimal | NumberFormat::Ascii) =>
        {
            format!("{number:#X}")
        }
        DefaultValue::Number(number) => number.to_string(),
        DefaultValue::Real(number) => format!("{number:?}"),
        DefaultValue::Text(text) => quote_toml(text),
    }
}

/// Quotes text for TOML.
fn quote_toml(text: &str) -> String {
    let quotes = text.replace('\\', "\\\\").replace('"', "\\\"");
    format!("\"{}\"", escape_toml(&quotes))
}

/// Escapes control characters and characters that reorder text as `\u001B`.
fn escape_toml(text: &str) -> String {
    let mut escaped = String::with_capacity(text.len());
    for c in text.chars() {
        if is_terminal_control(c) {
            let _ = write!(escaped, "\\u{:04X}", u32::from(c));
        } else {
            escaped.push(c);
        }
    }
    escaped
}
