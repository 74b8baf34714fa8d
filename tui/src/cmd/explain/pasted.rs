//! Explains text without a frame: bytes, an object with its value, COB-ID values with flag bits, trouble codes by name, and
//! lines of this program.

use std::fmt::Write as _;

use cobscope_decoder::profile::{self, DeviceProfile, EntryResolver, IdentifierOwner, NoValues};
use cobscope_decoder::wire::canopen::ObjectAddress;
use cobscope_decoder::wire::canopen::sdo::SdoSide;

use super::asked::LookupScope;
use super::{code, frame, identifier, j1939, object, uds};
use crate::cmd::rules;
use crate::run::describe::{TextBlock, behaviour};

/// Maximum number of explanations of one line.
const MOST_READINGS: usize = 6;

/// Explanations of a value, of bytes, or of the code and the bytes of an EMCY; empty for other text.
pub(super) fn explain_content(thing: &str, asked: &LookupScope) -> Vec<String> {
    if let Some(reading) = explain_value(thing, asked) {
        return vec![reading];
    }
    if let Some(bytes) = parse_bytes(thing) {
        return explain_bytes(&bytes, asked);
    }
    // `8130 11 00 00 00 00 00`: a code has four digits, an identifier three or eight.
    let (code, rest) = thing.split_once(char::is_whitespace).unwrap_or_default();
    let number = u16::from_str_radix(code, 16).ok().filter(|_| code.len() == 4);
    match (number, parse_bytes(rest)) {
        (Some(code), Some(bytes)) if bytes.len() <= 6 => {
            explain_emergency(code, bytes.first().copied(), asked).into_iter().collect()
        }
        _ => Vec::new(),
    }
}

/// Bytes such as `80 00 00 00`, `0x80, 0x00` or sixteen digits.
fn parse_bytes(thing: &str) -> Option<Vec<u8>> {
    let is_separator =
        |letter: char| letter.is_whitespace() || matches!(letter, ',' | ';' | '[' | ']' | '{' | '}');
    let words: Vec<&str> = thing.split(is_separator).filter(|word| !word.is_empty()).collect();
    let pair = |digits: &str| (digits.len() == 2).then(|| u8::from_str_radix(digits, 16).ok()).flatten();
    if let [digits] = words.as_slice() {
        let digits = digits.strip_prefix("0x").unwrap_or(digits);
        let is_whole = digits.len() == 16 && digits.is_ascii();
        return (0..8).map(|at| digits.get(2 * at..2 * at + 2).and_then(pair).filter(|_| is_whole)).collect();
    }
    (words.len() <= 64)
        .then(|| words.iter().map(|word| pair(word.strip_prefix("0x").unwrap_or(word))).collect())?
}

/// Explanations of bytes without an identifier, as messages of the protocols in which they are valid.
fn explain_bytes(bytes: &[u8], asked: &LookupScope) -> Vec<String> {
    let mut readings = Vec::new();
    if let [low, high, register, rest @ ..] = bytes
        && rest.len() == 5
    {
        readings.extend(explain_emergency(u16::from_le_bytes([*low, *high]), Some(*register), asked));
    }
    let is_emergency = !readings.is_empty();
    let message = uds::explain_bytes(bytes, asked);
    let is_message = message.is_some();
    readings.extend(message);
    if bytes.len() == 8 && !is_emergency {
        let both = [(SdoSide::Client, "SDO request"), (SdoSide::Server, "SDO response")];
        let found = both.map(|(side, name)| frame::explain_sdo_bytes(bytes, side, name, asked));
        // Both sides abort in the same way. A segment has no object, so other messages precede it.
        let is_segment = |text: &String| text.contains(" segment, ") && is_message;
        let is_abort = bytes.first() == Some(&0x80);
        let count = if is_abort { 1 } else { 2 };
        readings.extend(found.into_iter().flatten().take(count).filter(|text| !is_segment(text)));
    }
    if let ([high, low, kind], true) = (bytes, readings.is_empty()) {
        readings.push(trouble_code_block([*high, *low], Some(*kind)));
        let digits = format!("{high:02X}{low:02X}{kind:02X}");
        readings.extend(j1939::trouble_code(asked, &digits));
    }
    readings
}

/// An EMCY error code of the standard or of a device with its register.
fn explain_emergency(code: u16, register: Option<u8>, asked: &LookupScope) -> Option<String> {
    let is_known =
        profile::emcy_codes().find_code(u32::from(code)).is_some_and(|entry| entry.number == u32::from(code))
            || asked.device.as_ref().is_some_and(|device| device.error_entry(code).is_some());
    let mut text = code::explain_emcy(asked, code, false).filter(|_| is_known && code != 0)?;
    if let Some(register) = register {
        let _ = writeln!(text, "      register     {}", behaviour::register_text(register));
    }
    Some(text)
}

/// Explains `6041=0670`, `6041:00 = 0x0670` or `status word 0670`; `None` for other text.
fn explain_value(thing: &str, asked: &LookupScope) -> Option<String> {
    const NAMES: [(&str, &str); 4] =
        [("statusword", "6041"), ("status word", "6041"), ("controlword", "6040"), ("control word", "6040")];
    let lower = thing.to_lowercase();
    let named = NAMES.iter().find_map(|(name, object)| Some((*object, lower.strip_prefix(name)?)));
    let (object, value) = if let Some((object, value)) = named {
        (object.to_owned(), value.trim_start_matches([' ', '=', ':']).to_owned())
    } else {
        let (object, value) = lower.split_once('=')?;
        (object.trim().to_owned(), value.to_owned())
    };
    let address: ObjectAddress = match object.len() {
        4 => ObjectAddress::new(u16::from_str_radix(&object, 16).ok()?, 0),
        _ => object.parse().ok()?,
    };
    let digits = value.trim();
    let digits = digits.strip_prefix("0x").unwrap_or(digits).trim_end_matches('h');
    let number = u32::from_str_radix(digits, 16).ok().filter(|_| digits.len() <= 8)?;
    let size = digits.len().div_ceil(2).next_power_of_two();
    let bytes = number.to_le_bytes();
    let bytes = bytes.get(..size)?;
    let title = format!("{address} = {number:0width$X}h", width = 2 * size);
    if let Some(device) = &asked.device {
        let (name, text) = value_text(device, address, bytes)?;
        return Some(TextBlock::new(&title, &format!("{name} of {}: {text}", device.title)).finish());
    }
    if let Some((name, text)) = value_text(profile::plain_device(), address, bytes) {
        return Some(TextBlock::new(&title, &format!("{name}: {text}")).finish());
    }
    let entries = asked.every_device(|device| {
        value_text(device, address, bytes).map(|(name, text)| format!("{name}: {text}"))
    });
    let what = if entries.is_empty() { "object of no known device" } else { "value by device" };
    let mut block = TextBlock::new(&title, what);
    block.push_list(&entries, "(--device NAME selects one)");
    Some(block.finish())
}

/// Name of an object and its value as text.
fn value_text(device: &DeviceProfile, address: ObjectAddress, bytes: &[u8]) -> Option<(String, String)> {
    let meaning = EntryResolver::new(&device.dictionary, &NoValues).resolve_meaning(address)?;
    let text = meaning.format_value(&meaning.decode(bytes));
    Some((meaning.name, text))
}

/// Explains a COB-ID value with flag bits, as in 1005:00, 1014:00, 1200:01 and 1400:01 (CiA 301 §7.5.2); `None` without them.
pub(super) fn explain_cob_id(number: u32) -> Option<String> {
    let (bit_31, bit_30, is_extended) = (number >> 31 != 0, number >> 30 & 1 != 0, number >> 29 & 1 != 0);
    let id = number & 0x1FFF_FFFF;
    if number >> 29 == 0 || !is_extended && id > 0x7FF {
        return None;
    }
    let owner = match u16::try_from(id) {
        Ok(id) if !is_extended => profile::connection_set().owner_of(id),
        _ => IdentifierOwner::Unclassified,
    };
    let (what, flags) = match owner {
        IdentifierOwner::Sync => ("SYNC", [("bit 31 set", bit_31), ("produces SYNC (bit 30)", bit_30)]),
        IdentifierOwner::Time => {
            ("TIME", [("consumes TIME (bit 31)", bit_31), ("produces TIME (bit 30)", bit_30)])
        }
        IdentifierOwner::Emcy(_) => ("EMCY", [("not valid (bit 31)", bit_31), ("bit 30 set", bit_30)]),
        IdentifierOwner::Sdo(..) => ("SDO", [("not valid (bit 31)", bit_31), ("dynamic (bit 30)", bit_30)]),
        _ => ("PDO", [("not valid (bit 31)", bit_31), ("no remote frames (bit 30)", bit_30)]),
    };
    let mut text = if is_extended { format!("{what} on {id:08X}") } else { format!("{what} on {id:03X}") };
    let extended = ("29-bit identifier (bit 29)", is_extended);
    for (flag, _) in flags.iter().chain([&extended]).filter(|(_, is_set)| *is_set) {
        let _ = write!(text, ", {flag}");
    }
    let mut block = TextBlock::new(&format!("{number:08X}"), &format!("COB-ID: {text}"));
    if let Ok(id) = u16::try_from(id)
        && !is_extended
    {
        block.push_line(identifier::explain_identifier(id).trim_end());
    }
    Some(block.finish())
}

/// Explains `U0064-87` or `P0102`; `None` for other text.
fn trouble_code_name(word: &str) -> Option<String> {
    let word = word.to_ascii_uppercase();
    let system = word.get(..1).and_then(|letter| SYSTEMS.iter().position(|(known, _)| *known == letter))?;
    let digits = word.get(1..5)?;
    let number = u16::from_str_radix(digits, 16).ok().filter(|number| *number <= 0x3FFF)?;
    let kind = word.get(5..)?;
    let kind = match kind.strip_prefix('-').unwrap_or(kind) {
        "" => None,
        digits if digits.len() == 2 => Some(u8::from_str_radix(digits, 16).ok()?),
        _ => return None,
    };
    let number = u16::try_from(system).ok()? << 14 | number;
    Some(trouble_code_block(number.to_be_bytes(), kind))
}

/// First letters of trouble codes, by the upper two bits (ISO 15031-6).
const SYSTEMS: [(&str, &str); 4] = [("P", "powertrain"), ("C", "chassis"), ("B", "body"), ("U", "network")];

/// Groups of failure types, by the upper four bits of the third byte (SAE J2012-DA).
const FAILURES: [&str; 10] = [
    "general failure",
    "general electrical failure",
    "general signal failure",
    "frequency or pulse width failure",
    "internal failure of the device",
    "programming failure",
    "failure found by an algorithm",
    "mechanical failure",
    "bus signal or message failure",
    "component failure",
];

fn trouble_code_block([high, low]: [u8; 2], kind: Option<u8>) -> String {
    let (letter, system) = SYSTEMS.get(usize::from(high >> 6)).copied().unwrap_or_default();
    let digits = u16::from_be_bytes([high & 0x3F, low]);
    let suffix = kind.map_or(String::new(), |kind| format!("-{kind:02X}"));
    let bytes = kind.map_or(String::new(), |kind| format!(" {kind:02X}"));
    let origin = match high >> 4 & 3 {
        0 => ", code of the standard",
        1 => ", code of the manufacturer",
        _ => "",
    };
    let what = format!("UDS trouble code {high:02X} {low:02X}{bytes}: {system}{origin}");
    let mut block = TextBlock::new(&format!("{letter}{digits:04X}{suffix}"), &what);
    if let Some(kind) = kind {
        let group = FAILURES.get(usize::from(kind >> 4)).copied().unwrap_or("reserved");
        block.push_row("failure type", &format!("{kind:02X} {group}"));
    }
    block.push_row("source", "SAE J2012, ISO 15031-6; texts of codes are in the manual of the vehicle");
    block.finish()
}

/// Explains codes and names within a text, such as a line that this program printed.
pub(super) fn explain_words(thing: &str, asked: &LookupScope) -> Vec<String> {
    let mut readings: Vec<String> = Vec::new();
    let mut add = |reading: Option<String>| {
        if let Some(reading) = reading.filter(|reading| !readings.contains(reading)) {
            readings.push(reading);
        }
    };
    let named = thing.split('[').skip(1).filter_map(|rest| rest.split(']').next());
    for rule in named.filter_map(|name| rules::find_rule(&asked.catalogue, name)) {
        add(Some(rules::rule_page(&rule)));
    }
    let is_mark =
        |letter: char| letter.is_whitespace() || matches!(letter, ',' | ';' | '=' | '(' | ')' | '[' | ']');
    let words: Vec<&str> = thing.split(is_mark).map(|word| word.trim_end_matches([':', '?'])).collect();
    let words: Vec<&str> = words.into_iter().filter(|word| !word.is_empty()).collect();
    for (at, word) in words.iter().enumerate() {
        let next = words.get(at + 1).copied().unwrap_or_default();
        add(explain_label(word, next, words.get(at + 2..).unwrap_or_default(), asked));
        add(trouble_code_name(word));
        let is_object = word.len() == 7 && word.as_bytes().get(4) == Some(&b':');
        add(word.parse().ok().filter(|_| is_object).map(|address| object::explain_entry(asked, address)));
    }
    if readings.is_empty() {
        readings.extend(explain_event_line(&words));
    }
    readings.truncate(MOST_READINGS);
    readings
}

/// Explanation of a number after its name: `EMCY 8130`, `NRC 31`, `SPN 298985 FMI 19`.
fn explain_label(label: &str, number: &str, rest: &[&str], asked: &LookupScope) -> Option<String> {
    let digits = number.strip_prefix("0x").unwrap_or(number).trim_end_matches('h');
    let hex = |most: usize| u32::from_str_radix(digits, 16).ok().filter(|_| digits.len() <= most);
    match label.to_ascii_lowercase().as_str() {
        "emcy" => {
            let register = rest.first().filter(|word| word.len() == 2);
            let register = register.and_then(|word| u8::from_str_radix(word, 16).ok());
            explain_emergency(u16::try_from(hex(4)?).ok()?, register, asked)
        }
        "nrc" => uds::explain_named(&format!("nrc:{digits}"), asked),
        "did" => uds::explain_named(&format!("did:{digits}"), asked),
        "abort" | "refused" | "code" if digits.len() == 8 => Some(code::explain_abort(asked, hex(8)?)),
        "pg" | "pgn" => j1939::parameter_group(asked, &format!("pgn:{number}")),
        "spn" => {
            let fmi = rest.iter().skip_while(|word| !word.eq_ignore_ascii_case("fmi")).nth(1)?;
            j1939::explain_fault(asked, &format!("{number}/{fmi}"))
        }
        "object" => number.parse().ok().map(|address| object::explain_entry(asked, address)),
        "cob-id" | "cobid" | "id" if digits.len() <= 3 => {
            Some(identifier::explain_identifier(u16::try_from(hex(3)?).ok()?))
        }
        _ => None,
    }
}

/// Identifier of the message in a line of `decode`: the node as `5/05`, and the kind of the message.
fn explain_event_line(words: &[&str]) -> Option<String> {
    let node = words.iter().find_map(|word| {
        let name = word.rsplit(['→', '>']).next()?;
        let (decimal, hex) = name.split_once('/')?;
        let node: u8 = decimal.parse().ok()?;
        (u8::from_str_radix(hex, 16) == Ok(node)).then_some(node)
    });
    let is_message = |owner: IdentifierOwner, word: &str| match (owner, word) {
        (IdentifierOwner::Nmt, "NMT") | (IdentifierOwner::Sync, "SYNC") | (IdentifierOwner::Time, "TIME") => {
            true
        }
        (IdentifierOwner::ErrorControl(id), "HB" | "STATE" | "LOST" | "BACK" | "BOOT" | "GUARD") => {
            Some(id) == node
        }
        (IdentifierOwner::Pdo(name, id), word) => Some(id) == node && name.to_string() == word,
        _ => false,
    };
    let owner = |id: u16| profile::connection_set().owner_of(id);
    (0..=0x7FF)
        .find(|id| words.iter().any(|word| is_message(owner(*id), word)))
        .map(identifier::explain_identifier)
}
