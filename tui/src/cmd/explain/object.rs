//! Explains objects, from CiA 301 and from device profiles.

use cobscope_decoder::profile::{
    self, DataType, Device, Entry, Meaning, NoValues, Object, ResolvedObject, Resolver,
};
use cobscope_decoder::wire::canopen::ObjectAddress;

use super::asked::LookupScope;
use super::code::section_of;
use crate::cmd::describe::object::{self as words, Reading};
use crate::cmd::describe::{Block, section as cite, spaced};

/// Area of the object dictionary (CiA 301 table 43).
fn range(index: u16) -> &'static str {
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
pub(super) fn entry(asked: &LookupScope, address: ObjectAddress) -> String {
    let Some(device) = &asked.device else { return of_every_device(asked, address, false) };
    let Some(found) = device.dictionary.find(address) else { return unknown(device, address) };
    if let Some(entry) = found.entry {
        return entry_block(asked, device, &found, entry);
    }
    let what = format!("object of {}: {}, without this sub-index", device.title, found.object_name());
    let mut block = Block::new(&address.to_string(), &what);
    entries(&mut block, device, address.index);
    block.finish()
}

/// Explains an object without a sub-index.
pub(super) fn index(asked: &LookupScope, index: u16) -> String {
    let address = ObjectAddress::new(index, 0);
    let Some(device) = &asked.device else { return of_every_device(asked, address, true) };
    let all = objects(device, index);
    match all.first() {
        Some(object) if object.is_record || all.len() > 1 => {
            let found = ResolvedObject { address, object, entry: None, nth: object.nth(index).unwrap_or(0) };
            let what = format!("object of {}: {}", device.title, found.object_name());
            let mut block = Block::new(&format!("{index:04X}"), &what);
            entries(&mut block, device, index);
            block.finish()
        }
        _ => entry(asked, address),
    }
}

fn unknown(device: &Device, address: ObjectAddress) -> String {
    let what = format!("object: not in the manual of {}; {}", device.title, range(address.index));
    Block::new(&address.to_string(), &what).finish()
}

/// Entries of an index in the device profile, else in its standards.
fn objects(device: &Device, index: u16) -> Vec<&Object> {
    let own: Vec<_> = device.dictionary.own().iter().filter(|object| object.nth(index).is_some()).collect();
    if own.is_empty() {
        return device
            .dictionary
            .find(ObjectAddress::new(index, 0))
            .map(|found| found.object)
            .into_iter()
            .collect();
    }
    own
}

fn entries(block: &mut Block, device: &Device, index: u16) {
    for object in objects(device, index) {
        for entry in &object.entries {
            for line in words::lines(device, object, entry, object.nth(index)) {
                block.line(&line);
            }
        }
    }
}

/// Explanation from CiA 301, else from all device profiles.
fn of_every_device(asked: &LookupScope, address: ObjectAddress, whole: bool) -> String {
    let meaning = Resolver::new(&profile::plain_device().dictionary, &NoValues).meaning(address);
    let what = meaning.as_ref().map_or(range(address.index).to_owned(), plain);
    let mut block = Block::new(&address.to_string(), &format!("object: {what}"));
    if meaning.is_none() {
        let found = asked.every_device(|device| in_short(device, address, whole));
        block.list(&found, "(details: --device NAME)");
    }
    block.finish()
}

/// `Producer heartbeat time, UNSIGNED16, in ms`.
fn plain(meaning: &Meaning) -> String {
    let data_type = meaning.data_type.map(DataType::name);
    let unit = Some(&meaning.unit).filter(|unit| !unit.is_empty()).map(|unit| format!("in {unit}"));
    [Some(meaning.name.clone()), data_type, unit].into_iter().flatten().collect::<Vec<_>>().join(", ")
}

/// Short description of an object in a device profile.
fn in_short(device: &Device, address: ObjectAddress, whole: bool) -> Option<String> {
    let all = device.dictionary.own().iter().filter_map(|object| Some((object, object.nth(address.index)?)));
    for (object, nth) in all {
        let entry = object.entry(address.sub);
        let found = ResolvedObject { address, object, entry, nth };
        match entry {
            _ if whole && object.is_record => {
                return Some(format!("{}  {}", found.object_name(), cite(&object.source)));
            }
            Some(entry) => {
                return Some(format!("{}  {}", words::one(device, &found, entry), cite(&entry.source)));
            }
            None => {}
        }
    }
    None
}

fn entry_block(asked: &LookupScope, device: &Device, found: &ResolvedObject<'_>, entry: &Entry) -> String {
    // Standards define the first channel only.
    let first = ObjectAddress { index: found.object.index, ..found.address };
    let standard = standard(asked, device, found.address).or_else(|| standard(asked, device, first));
    let is_own = device.dictionary.is_own(found.address);
    let whose = match &standard {
        Some((source, _)) if !is_own => {
            let source = source.split(" v").next().unwrap_or_default();
            format!("object of {source}, not in the manual of {}", device.title)
        }
        _ => format!("object of {}", device.title),
    };
    let readings = words::readings(device, found, entry);
    let mut block = Block::new(&found.address.to_string(), &format!("{whose}: {}", found.name()));
    if let Some(own) = readings.first() {
        quantity(&mut block, device, found, entry, own);
    }
    by_mode(&mut block, device, found, entry, &readings);
    let of_repeat = found.object.repeat.channel;
    block.row(if of_repeat { "channel" } else { "repeat" }, &repeat(found, entry));
    let channel = found.channel().filter(|_| !of_repeat);
    block.row("channel", &channel.map_or(String::new(), |channel| channel.to_string()));
    block.row("storage", &words::storage(entry, found));
    block.row("effect", words::effect(entry.effect));
    let voids: Vec<_> = entry.invalidates.iter().map(ToString::to_string).collect();
    block.row("invalidates", &voids.join(", "));
    block.row("note", &entry.note);
    if is_own {
        if let Some((source, text)) = &standard {
            block.row("standard", &format!("{text} ({source})"));
        }
        block.row("section", &section_of(device, &entry.source));
    } else {
        let of = standard.map_or(String::new(), |(source, _)| format!(" of {source}"));
        block.row("section", &format!("{}{of}", entry.source));
    }
    block.finish()
}

/// Adds the rows type, role, unit, range, default and names.
fn quantity(block: &mut Block, device: &Device, found: &ResolvedObject<'_>, entry: &Entry, own: &Reading) {
    let access = entry.access.map_or("", |access| access.name());
    let data_type = entry.data_type.map_or(String::new(), DataType::name);
    block.row("type", format!("{data_type} {access}").trim());
    let meaning = &own.meaning;
    let role = meaning.role.map_or(String::new(), |role| spaced(role.name()));
    let of = meaning.of.map_or(String::new(), |of| format!(", follows {}", words::named(device, of)));
    block.row("role", &format!("{role}{of}"));
    block.row("unit", &words::formula(own, found));
    block.row("", &words::formula_needs(device, own, found).unwrap_or_default());
    let (permitted, raw) = (words::permitted(meaning), words::permitted_raw(meaning));
    let both = if raw.is_empty() { permitted } else { format!("{permitted}, {raw}") };
    block.row("range", &both);
    block.row("default", &words::delivered(entry, meaning).unwrap_or_default());
    names(block, entry, meaning);
}

fn names(block: &mut Block, entry: &Entry, meaning: &Meaning) {
    if let Some(names) = meaning.values.as_deref() {
        block.rows("values", &words::name_lines(names, entry.data_type));
    }
    if let Some(names) = meaning.special.as_deref() {
        block.rows("special", &words::name_lines(names, entry.data_type));
    }
    if let Some(bits) = meaning.bits.as_deref() {
        let lines: Vec<_> = bits.list.iter().filter(|bit| !bit.reserved).map(words::bit_line).collect();
        block.rows("bits", &lines);
    }
}

fn by_mode(
    block: &mut Block,
    device: &Device,
    found: &ResolvedObject<'_>,
    entry: &Entry,
    readings: &[Reading],
) {
    let own = readings.first().map(|own| &own.meaning);
    for (place, reading) in readings.iter().enumerate() {
        let Some(line) = words::mode_line(device, found, entry, reading) else { continue };
        block.row(if place == 1 { "by mode" } else { "" }, &line);
        let meaning = &reading.meaning;
        let same = own.is_some_and(|own| own.values == meaning.values && own.bits == meaning.bits);
        if !same {
            names(block, entry, meaning);
        }
    }
}

/// `4, one of 16: 5400:03…540F:03`.
fn repeat(found: &ResolvedObject<'_>, entry: &Entry) -> String {
    let count = found.object.repeat.count;
    if count < 2 {
        return String::new();
    }
    format!("{}, one of {count}: {}", found.object.number(found.nth), words::addresses(found.object, entry))
}

/// Source and description of an object in the standards of the device.
fn standard(asked: &LookupScope, device: &Device, address: ObjectAddress) -> Option<(String, String)> {
    // The last standard in the list takes precedence.
    device.extends.iter().rev().find_map(|id| {
        let standard = asked.catalogue.device(id).ok()?;
        let found = standard.dictionary.find(address).filter(|_| standard.dictionary.is_own(address))?;
        // The document without its clause; the entry has its own section.
        let source = standard.source.split(',').next().unwrap_or_default();
        Some((source.to_owned(), words::one(&standard, &found, found.entry?)))
    })
}
