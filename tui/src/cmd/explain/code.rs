//! Explains EMCY error codes and SDO abort codes, from CiA 301 and from device profiles.

use cobscope_decoder::profile::device::{AbortText, DeviceErrorCode, ErrorCodeOrder, OrderName};
use cobscope_decoder::profile::{self, DeviceProfile};

use super::asked::LookupScope;
use crate::run::describe::{TextBlock, behaviour, object::object_title, section_text};

/// Note below a list of entries from profiles.
const MORE: &str = "(details: --device NAME)";

/// Section and document of an entry.
pub(super) fn section_of(device: &DeviceProfile, section: &str) -> String {
    if section.is_empty() || device.source.is_empty() {
        return section.to_owned();
    }
    format!("{section} of {}", device.source)
}

/// Explains an EMCY error code; `None` if it is unknown, or if only its class is known and `certain` is set.
pub(super) fn explain_emcy(asked: &LookupScope, code: u16, certain: bool) -> Option<String> {
    let standard = profile::emcy_codes().find_code(u32::from(code));
    let shown = format!("{code:04X}");
    let Some(device) = &asked.device else {
        let mut entries = asked.every_device(|device| {
            let error = device.error_entry(code)?;
            Some(format!("{}  {}", error.text, section_text(&error.source)))
        });
        entries
            .extend(asked.every_device(|device| Some(format!("swapped, {}", swapped_code(device, code)?))));
        if standard.is_none() && entries.is_empty() {
            return None;
        }
        let text = standard.map_or("undefined in CiA 301", |entry| &entry.text);
        let mut block = TextBlock::new(&shown, &format!("EMCY error code: {text}"));
        standard_lines(&mut block, standard);
        block.push_list(&entries, MORE);
        return Some(block.finish());
    };
    if let Some(error) = device.error_entry(code) {
        return Some(error_block(device, error));
    }
    let swapped = swapped_code(device, code);
    let is_exact = standard.is_some_and(|entry| entry.number == u32::from(code));
    if swapped.is_none() && (standard.is_none() || certain && !is_exact) {
        return None;
    }
    let mut block =
        TextBlock::new(&shown, &format!("EMCY error code: not in the manual of {}", device.title));
    block.push_row("swapped", &swapped.unwrap_or_default());
    standard_rows(&mut block, standard);
    Some(block.finish())
}

/// Writes the entry of CiA 301 as rows.
fn standard_rows(block: &mut TextBlock, entry: Option<&profile::CodeEntry>) {
    if let Some(entry) = entry {
        block.push_row("CiA 301", &entry.standard);
        block.push_row("hint", &entry.hint);
    }
}

/// Writes the entry of CiA 301 as lines without keys.
fn standard_lines(block: &mut TextBlock, entry: Option<&profile::CodeEntry>) {
    if let Some(entry) = entry {
        block.push_line(&format!("CiA 301: {}", entry.standard));
        block.push_line(&entry.hint);
    }
}

fn error_block(device: &DeviceProfile, error: &DeviceErrorCode) -> String {
    let what = format!("EMCY error code of {}: {}", device.title, error.text);
    let mut block = TextBlock::new(&format!("{:04X}", error.code), &what);
    block.push_row("register", &error.register.map_or(String::new(), behaviour::register_text));
    let reaction = behaviour::reaction_text(error);
    block.push_row("reaction", &if reaction.is_empty() { reaction } else { format!("to {reaction}") });
    block.push_rows("check", &error.causes);
    block.push_row("sent as", &sent_as(device, error.code));
    block.push_row("note", &error.note);
    standard_rows(&mut block, profile::emcy_codes().find_code(u32::from(error.code)));
    block.push_row("section", &section_of(device, &error.source));
    block.finish()
}

/// Byte order of the code on the bus, if it differs from CiA 301.
fn sent_as(device: &DeviceProfile, code: u16) -> String {
    let [high, low] = code.to_be_bytes();
    if high == low {
        return String::new();
    }
    match msb_first(device) {
        Some(why) => format!(
            "{high:02X} {low:02X}: most significant byte first ({why}); a tool that expects the order of CiA 301 \
             shows {low:02X}{high:02X}"
        ),
        None => String::new(),
    }
}

/// Condition under which the device sends the most significant byte first; `None` if it never does.
fn msb_first(device: &DeviceProfile) -> Option<String> {
    match device.emcy.byte_order.as_ref()? {
        ErrorCodeOrder::Fixed(OrderName::LsbFirst) => None,
        ErrorCodeOrder::Fixed(OrderName::MsbFirst) => Some("always".into()),
        ErrorCodeOrder::ByObject { object, equals, default } => {
            let (value, _) = equals.iter().find(|(_, order)| **order == OrderName::MsbFirst)?;
            let as_delivered = if *default == OrderName::MsbFirst { ", as delivered" } else { "" };
            Some(format!("{} = {value}{as_delivered}", object_title(device, object.object)))
        }
    }
}

/// The code with swapped bytes, if the device may send it in that order.
fn swapped_code(device: &DeviceProfile, code: u16) -> Option<String> {
    let other = device.error_entry(code.swap_bytes()).filter(|_| device.error_entry(code).is_none())?;
    let why = msb_first(device)?;
    Some(format!("{:04X} {}: sent most significant byte first ({why})", other.code, other.text))
}

/// Explains an SDO abort code.
pub(super) fn explain_abort(asked: &LookupScope, code: u32) -> String {
    let standard = profile::abort_codes().find_code(code);
    let shown = format!("{code:08X}");
    let Some(device) = &asked.device else {
        let text = standard.map_or("undefined in CiA 301; see the manual of the device", |entry| &entry.text);
        let mut block = TextBlock::new(&shown, &format!("SDO abort code: {text}"));
        standard_lines(&mut block, standard);
        let entries = asked.every_device(|device| {
            let texts: Vec<_> = abort_texts(device, code).map(abort_text).collect();
            (!texts.is_empty()).then(|| texts.join("; "))
        });
        block.push_list(&entries, MORE);
        return block.finish();
    };
    let general = device.abort_entry(code, None);
    let what = match (general, abort_texts(device, code).next()) {
        (Some(abort), _) => format!(" of {}: {}", device.title, abort.text),
        (None, Some(_)) => format!(" of {}: depends on the object", device.title),
        (None, None) => format!(": not in the manual of {}", device.title),
    };
    let mut block = TextBlock::new(&shown, &format!("SDO abort code{what}"));
    let by_object = abort_texts(device, code).filter(|abort| !abort.objects.is_empty());
    block.push_rows("of objects", &by_object.map(abort_text).collect::<Vec<_>>());
    for abort in abort_texts(device, code) {
        block.push_row("note", &abort.note);
    }
    standard_rows(&mut block, standard);
    block.push_row("section", &general.map_or(String::new(), |abort| section_of(device, &abort.source)));
    block.finish()
}

/// Whether a number can be an SDO abort code: it is in a class of CiA 301, or a profile defines it.
pub(super) fn may_be_abort(asked: &LookupScope, code: u32) -> bool {
    const CLASSES: [u32; 3] = [0x05, 0x06, 0x08];
    let has = |device: &DeviceProfile| abort_texts(device, code).next().is_some();
    CLASSES.contains(&(code >> 24))
        || asked.device.as_deref().is_some_and(has)
        || !asked.every_device(|device| has(device).then(String::new)).is_empty()
}

fn abort_texts(device: &DeviceProfile, code: u32) -> impl Iterator<Item = &AbortText> {
    device.aborts.iter().filter(move |abort| abort.code == code)
}

/// `1010:01, 1010:02: saving failed  [5.4.10]`.
fn abort_text(abort: &AbortText) -> String {
    let objects: Vec<_> = abort.objects.iter().map(ToString::to_string).collect();
    let of = if objects.is_empty() { String::new() } else { format!("{}: ", objects.join(", ")) };
    format!("{of}{}  {}", abort.text, section_text(&abort.source))
}
