//! Explains objects, from CiA 301 and from device profiles.

use cobscope_decoder::profile::{
    self, DataType, DeviceProfile, EntryResolver, NoValues, ObjectEntry, ObjectMeaning, ResolvedObject,
    SubEntry,
};
use cobscope_decoder::wire::canopen::ObjectAddress;

use super::asked::LookupScope;
use super::code::section_of;
use crate::run::describe::object::{self as words, EntryReading};
use crate::run::describe::{TextBlock, section_text as cite, spaced_name};

/// Area of the object dictionary (CiA 301 table 43).
fn dictionary_area(index: u16) -> &'static str {
    match index {
        0x0000..=0x0FFF => "data types",
        0x1000..=0x1FFF => "communication object, not defined by CiA 301",
        0x2000..=0x5FFF => "manufacturer specific: see the device's EDS or manual",
        0x6000..=0x9FFF => "device profile (CiA 4xx): see the device's EDS or manual",
        0xA000..=0xAFFF => "network variables",
        0xB000..=0xBFFF => "system variables",
        0xC000..=0xFFFF => "reserved",
    }
}

/// Explains an object with its sub-index.
pub(super) fn explain_entry(asked: &LookupScope, address: ObjectAddress) -> String {
    let Some(device) = &asked.device else { return of_every_device(asked, address, false) };
    let Some(found) = device.dictionary.find_object(address) else { return unknown_object(device, address) };
    if let Some(entry) = found.entry {
        return entry_block(asked, device, &found, entry);
    }
    let what = format!("object of {}: {}, without this sub-index", device.title, found.object_name());
    let mut block = TextBlock::new(&address.to_string(), &what);
    push_entries(&mut block, device, address.index);
    block.finish()
}

/// Explains an object without a sub-index.
pub(super) fn explain_index(asked: &LookupScope, index: u16) -> String {
    let address = ObjectAddress::new(index, 0);
    let Some(device) = &asked.device else { return of_every_device(asked, address, true) };
    let all = index_objects(device, index);
    match all.first() {
        Some(object) if object.is_record || all.len() > 1 => {
            let found =
                ResolvedObject { address, object, entry: None, nth: object.repeat_of(index).unwrap_or(0) };
            let what = format!("object of {}: {}", device.title, found.object_name());
            let mut block = TextBlock::new(&format!("{index:04X}"), &what);
            push_entries(&mut block, device, index);
            block.finish()
        }
        _ => explain_entry(asked, address),
    }
}

fn unknown_object(device: &DeviceProfile, address: ObjectAddress) -> String {
    let what = format!("object: not in the manual of {}; {}", device.title, dictionary_area(address.index));
    TextBlock::new(&address.to_string(), &what).finish()
}

/// Entries of an index in the device profile, else in its standards.
fn index_objects(device: &DeviceProfile, index: u16) -> Vec<&ObjectEntry> {
    let own: Vec<_> =
        device.dictionary.own_objects().iter().filter(|object| object.repeat_of(index).is_some()).collect();
    if own.is_empty() {
        return device
            .dictionary
            .find_object(ObjectAddress::new(index, 0))
            .map(|found| found.object)
            .into_iter()
            .collect();
    }
    own
}

fn push_entries(block: &mut TextBlock, device: &DeviceProfile, index: u16) {
    for object in index_objects(device, index) {
        for entry in &object.entries {
            for line in words::entry_lines(device, object, entry, object.repeat_of(index)) {
                block.push_line(&line);
            }
        }
    }
}

/// Explanation from CiA 301, else from all device profiles.
fn of_every_device(asked: &LookupScope, address: ObjectAddress, whole: bool) -> String {
    let meaning = EntryResolver::new(&profile::plain_device().dictionary, &NoValues).resolve_meaning(address);
    let what = meaning.as_ref().map_or(dictionary_area(address.index).to_owned(), plain_meaning);
    let mut block = TextBlock::new(&address.to_string(), &format!("object: {what}"));
    if meaning.is_none() {
        let found = asked.every_device(|device| in_short(device, address, whole));
        block.push_list(&found, "(details: --device NAME)");
    }
    block.finish()
}

/// `Producer heartbeat time, UNSIGNED16, in ms`.
fn plain_meaning(meaning: &ObjectMeaning) -> String {
    let data_type = meaning.data_type.map(DataType::name);
    let unit = Some(&meaning.unit).filter(|unit| !unit.is_empty()).map(|unit| format!("in {unit}"));
    [Some(meaning.name.clone()), data_type, unit].into_iter().flatten().collect::<Vec<_>>().join(", ")
}

/// Short description of an object in a device profile.
fn in_short(device: &DeviceProfile, address: ObjectAddress, whole: bool) -> Option<String> {
    let all = device
        .dictionary
        .own_objects()
        .iter()
        .filter_map(|object| Some((object, object.repeat_of(address.index)?)));
    for (object, nth) in all {
        let entry = object.entry(address.sub);
        let found = ResolvedObject { address, object, entry, nth };
        match entry {
            _ if whole && object.is_record => {
                return Some(format!("{}  {}", found.object_name(), cite(&object.source)));
            }
            Some(entry) => {
                return Some(format!(
                    "{}  {}",
                    words::entry_line(device, &found, entry),
                    cite(&entry.source)
                ));
            }
            None => {}
        }
    }
    None
}

fn entry_block(
    asked: &LookupScope,
    device: &DeviceProfile,
    found: &ResolvedObject<'_>,
    entry: &SubEntry,
) -> String {
    // Standards define the first channel only.
    let first = ObjectAddress { index: found.object.index, ..found.address };
    let standard =
        standard_text(asked, device, found.address).or_else(|| standard_text(asked, device, first));
    let is_own = device.dictionary.is_own(found.address);
    let whose = match &standard {
        Some((source, _)) if !is_own => {
            let source = source.split(" v").next().unwrap_or_default();
            format!("object of {source}, not in the manual of {}", device.title)
        }
        _ => format!("object of {}", device.title),
    };
    let readings = words::entry_readings(device, found, entry);
    let mut block = TextBlock::new(&found.address.to_string(), &format!("{whose}: {}", found.name()));
    if let Some(own) = readings.first() {
        push_quantity(&mut block, device, found, entry, own);
    }
    by_mode(&mut block, device, found, entry, &readings);
    let of_repeat = found.object.repeat.channel;
    block.push_row(if of_repeat { "channel" } else { "repeat" }, &repeat_text(found, entry));
    let channel = found.channel().filter(|_| !of_repeat);
    block.push_row("channel", &channel.map_or(String::new(), |channel| channel.to_string()));
    block.push_row("storage", &words::storage_text(entry, found));
    block.push_row("effect", words::effect_text(entry.effect));
    let voids: Vec<_> = entry.invalidates.iter().map(ToString::to_string).collect();
    block.push_row("invalidates", &voids.join(", "));
    block.push_row("note", &entry.note);
    if is_own {
        if let Some((source, text)) = &standard {
            block.push_row("standard", &format!("{text} ({source})"));
        }
        block.push_row("section", &section_of(device, &entry.source));
    } else {
        let of = standard.map_or(String::new(), |(source, _)| format!(" of {source}"));
        block.push_row("section", &format!("{}{of}", entry.source));
    }
    block.finish()
}

/// Adds the rows type, role, unit, range, default and names.
fn push_quantity(
    block: &mut TextBlock,
    device: &DeviceProfile,
    found: &ResolvedObject<'_>,
    entry: &SubEntry,
    own: &EntryReading,
) {
    let access = entry.access.map_or("", |access| access.name());
    let data_type = entry.data_type.map_or(String::new(), DataType::name);
    block.push_row("type", format!("{data_type} {access}").trim());
    let meaning = &own.meaning;
    let role = meaning.role.map_or(String::new(), |role| spaced_name(role.name()));
    let of = meaning.of.map_or(String::new(), |of| format!(", follows {}", words::object_title(device, of)));
    block.push_row("role", &format!("{role}{of}"));
    block.push_row("unit", &words::formula_text(own, found));
    block.push_row("", &words::formula_needs(device, own, found).unwrap_or_default());
    let (permitted, raw) = (words::permitted_text(meaning), words::permitted_raw(meaning));
    let both = if raw.is_empty() { permitted } else { format!("{permitted}, {raw}") };
    block.push_row("range", &both);
    block.push_row("default", &words::default_text(entry, meaning).unwrap_or_default());
    push_names(block, entry, meaning);
}

fn push_names(block: &mut TextBlock, entry: &SubEntry, meaning: &ObjectMeaning) {
    if let Some(names) = meaning.values.as_deref() {
        block.push_rows("values", &words::name_lines(names, entry.data_type));
    }
    if let Some(names) = meaning.special.as_deref() {
        block.push_rows("special", &words::name_lines(names, entry.data_type));
    }
    if let Some(bits) = meaning.bits.as_deref() {
        let lines: Vec<_> = bits.list.iter().filter(|bit| !bit.reserved).map(words::bit_line).collect();
        block.push_rows("bits", &lines);
    }
}

fn by_mode(
    block: &mut TextBlock,
    device: &DeviceProfile,
    found: &ResolvedObject<'_>,
    entry: &SubEntry,
    readings: &[EntryReading],
) {
    let own = readings.first().map(|own| &own.meaning);
    for (place, reading) in readings.iter().enumerate() {
        let Some(line) = words::mode_line(device, found, entry, reading) else { continue };
        block.push_row(if place == 1 { "by mode" } else { "" }, &line);
        let meaning = &reading.meaning;
        let same = own.is_some_and(|own| own.values == meaning.values && own.bits == meaning.bits);
        if !same {
            push_names(block, entry, meaning);
        }
    }
}

/// `4, one of 16: 5400:03…540F:03`.
fn repeat_text(found: &ResolvedObject<'_>, entry: &SubEntry) -> String {
    let count = found.object.repeat.count;
    if count < 2 {
        return String::new();
    }
    format!(
        "{}, one of {count}: {}",
        found.object.repeat_number(found.nth),
        words::address_text(found.object, entry)
    )
}

/// Source and description of an object in the standards of the device.
fn standard_text(
    asked: &LookupScope,
    device: &DeviceProfile,
    address: ObjectAddress,
) -> Option<(String, String)> {
    // The last standard in the list takes precedence.
    device.extends.iter().rev().find_map(|id| {
        let standard = asked.catalogue.device(id).ok()?;
        let found =
            standard.dictionary.find_object(address).filter(|_| standard.dictionary.is_own(address))?;
        // The document without its clause; the entry has its own section.
        let source = standard.source.split(',').next().unwrap_or_default();
        Some((source.to_owned(), words::entry_line(&standard, &found, found.entry?)))
    })
}
