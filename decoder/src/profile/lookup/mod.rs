//! Codes and bits with their texts.

mod uds;

use std::sync::OnceLock;

use serde::Deserialize;

use super::embedded::parse;
use crate::wire::j1939::{Lamps, Lit, Pgn};

pub(crate) use uds::ValueIn;
pub use uds::{UdsCode, UdsNames, UdsService, uds};

/// One code of a table.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Code {
    /// The code.
    #[serde(rename = "code")]
    pub number: u32,
    /// Bits of a code that must agree; all where the table does not say.
    #[serde(default = "all_bits")]
    pub mask: u32,
    /// What it means.
    pub text: String,
    /// What usually causes it.
    #[serde(default)]
    pub hint: String,
}

const fn all_bits() -> u32 {
    u32::MAX
}

/// A table of codes.
#[derive(Debug, Default, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Codes {
    code: Vec<Code>,
}

impl Codes {
    /// The entry that matches `code` most specifically.
    pub fn find(&self, code: u32) -> Option<&Code> {
        let matching = self.code.iter().filter(|entry| code & entry.mask == entry.number & entry.mask);
        matching.max_by_key(|entry| entry.mask.count_ones())
    }

    /// Text of `code`; a plain statement where the table has none.
    pub fn text(&self, code: u32) -> &str {
        self.find(code).map_or("unknown code", |entry| &entry.text)
    }
}

/// One bit or one value of a byte.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
struct Bit {
    #[serde(rename = "bit", alias = "value")]
    mask: u32,
    name: String,
    #[serde(default)]
    text: String,
}

/// Named bits, or named values, of a byte.
#[derive(Debug, Default)]
pub struct Bits(Vec<Bit>);

impl Bits {
    /// Names of the bits set in `value`, low to high.
    pub fn names(&self, value: u32) -> impl Iterator<Item = &str> {
        self.0.iter().filter(move |entry| value & entry.mask != 0).map(|entry| entry.name.as_str())
    }

    /// Plain texts of the bits set in `value`, low to high.
    pub fn texts(&self, value: u32) -> impl Iterator<Item = &str> {
        self.0
            .iter()
            .filter(move |entry| value & entry.mask != 0)
            .map(|entry| if entry.text.is_empty() { entry.name.as_str() } else { entry.text.as_str() })
    }

    /// Plain text of the entry that equals `value`.
    pub fn text_of(&self, value: u32) -> Option<&str> {
        self.0.iter().find(|entry| entry.mask == value).map(|entry| entry.text.as_str())
    }
}

/// Units a profile may use.
pub(super) fn units() -> &'static Vec<String> {
    #[derive(Default, Deserialize)]
    #[serde(deny_unknown_fields)]
    struct File {
        unit: Vec<String>,
    }
    static TABLE: OnceLock<Vec<String>> = OnceLock::new();
    TABLE.get_or_init(|| parse::<File>("lookups/units.toml").unit)
}

/// SDO abort codes (CiA 301 §7.2.4.3.17).
pub fn abort_codes() -> &'static Codes {
    static TABLE: OnceLock<Codes> = OnceLock::new();
    TABLE.get_or_init(|| parse("lookups/sdo_abort_codes.toml"))
}

/// Reasons of a connection abort (J1939-21 §5.10.3.4).
pub fn transport_aborts() -> &'static Codes {
    static TABLE: OnceLock<Codes> = OnceLock::new();
    TABLE.get_or_init(|| parse("lookups/transport_aborts.toml"))
}

/// Failure mode identifiers (J1939-73 appendix A).
pub fn failure_modes() -> &'static Codes {
    static TABLE: OnceLock<Codes> = OnceLock::new();
    TABLE.get_or_init(|| parse("lookups/failure_modes.toml"))
}

/// Industry groups of a NAME (J1939-81 §4.1.1.2).
pub fn industry_groups() -> &'static Bits {
    #[derive(Default, Deserialize)]
    #[serde(deny_unknown_fields)]
    struct File {
        class: Vec<Bit>,
    }
    static TABLE: OnceLock<Bits> = OnceLock::new();
    TABLE.get_or_init(|| Bits(parse::<File>("lookups/industry_groups.toml").class))
}

/// Names of the lamps that are lit, with how they flash (J1939-73 §5.7.1).
pub fn lamp_names(lamps: Lamps) -> impl Iterator<Item = &'static str> {
    #[derive(Deserialize)]
    #[serde(deny_unknown_fields)]
    struct Lamp {
        shift: u8,
        name: String,
        slow: String,
        fast: String,
    }
    #[derive(Default, Deserialize)]
    #[serde(deny_unknown_fields)]
    struct File {
        lamp: Vec<Lamp>,
    }
    static TABLE: OnceLock<Vec<Lamp>> = OnceLock::new();
    let table = TABLE.get_or_init(|| parse::<File>("lookups/lamps.toml").lamp);
    table.iter().filter_map(move |lamp| {
        Some(match lamps.lit(lamp.shift)? {
            Lit::Steady => lamp.name.as_str(),
            Lit::Slow => &lamp.slow,
            Lit::Fast => &lamp.fast,
        })
    })
}

/// Name of a parameter group that belongs to the protocols themselves.
pub fn pgn_name(pgn: Pgn) -> Option<String> {
    #[derive(Deserialize)]
    #[serde(deny_unknown_fields)]
    struct Group {
        number: u32,
        to: Option<u32>,
        name: String,
    }
    #[derive(Default, Deserialize)]
    #[serde(deny_unknown_fields)]
    struct File {
        pgn: Vec<Group>,
    }
    static TABLE: OnceLock<Vec<Group>> = OnceLock::new();
    let groups = TABLE.get_or_init(|| parse::<File>("lookups/pgns.toml").pgn);
    let number = pgn.number();
    let group = groups.iter().find(|it| (it.number..=it.to.unwrap_or(it.number)).contains(&number))?;
    Some(group.name.replace("{n}", &number.saturating_sub(group.number).to_string()))
}

/// EMCY error codes and classes (CiA 301 §7.2.7.1).
pub fn emcy_codes() -> &'static Codes {
    static TABLE: OnceLock<Codes> = OnceLock::new();
    TABLE.get_or_init(|| parse("lookups/emcy_codes.toml"))
}

/// What to look at after a fault of a kind, likeliest first; empty for an unknown one.
pub(crate) fn fault_hints(fault: &str) -> &'static [String] {
    #[derive(Deserialize)]
    #[serde(deny_unknown_fields)]
    struct Hint {
        fault: String,
        texts: Vec<String>,
    }
    #[derive(Default, Deserialize)]
    #[serde(deny_unknown_fields)]
    struct File {
        hint: Vec<Hint>,
    }
    static TABLE: OnceLock<File> = OnceLock::new();
    let file = TABLE.get_or_init(|| parse("lookups/fault_hints.toml"));
    file.hint.iter().find(|hint| hint.fault == fault).map_or(&[], |hint| &hint.texts)
}

/// Bits of the error register, object 0x1001.
pub fn error_register() -> &'static Bits {
    #[derive(Default, Deserialize)]
    #[serde(deny_unknown_fields)]
    struct File {
        bit: Vec<Bit>,
    }
    static TABLE: OnceLock<Bits> = OnceLock::new();
    TABLE.get_or_init(|| {
        // This table counts bits, the others give masks.
        let file: File = parse("lookups/error_register.toml");
        Bits(file.bit.into_iter().map(|entry| Bit { mask: 1 << (entry.mask & 31), ..entry }).collect())
    })
}

/// Names in SocketCAN error frames.
#[derive(Debug, Default)]
pub(crate) struct CanErrors {
    /// Class bits of the identifier.
    pub classes: Bits,
    /// Controller byte.
    pub controller: Bits,
    /// Protocol byte.
    pub protocol: Bits,
    /// Location byte, values.
    pub location: Bits,
    /// Transceiver byte, values.
    pub transceiver: Bits,
}

/// SocketCAN's error classes and details (linux/can/error.h).
pub(crate) fn can_errors() -> &'static CanErrors {
    #[derive(Default, Deserialize)]
    #[serde(deny_unknown_fields)]
    struct File {
        class: Vec<Bit>,
        controller: Vec<Bit>,
        protocol: Vec<Bit>,
        location: Vec<Bit>,
        transceiver: Vec<Bit>,
    }
    static TABLE: OnceLock<CanErrors> = OnceLock::new();
    TABLE.get_or_init(|| {
        let file: File = parse("lookups/can_error_classes.toml");
        CanErrors {
            classes: Bits(file.class),
            controller: Bits(file.controller),
            protocol: Bits(file.protocol),
            location: Bits(file.location),
            transceiver: Bits(file.transceiver),
        }
    })
}

#[derive(Debug, Clone, Deserialize)]
struct Service {
    code: u8,
    name: String,
    title: String,
    #[serde(default)]
    field: Option<String>,
}

#[derive(Debug, Clone, Deserialize)]
struct LssResult {
    service: u8,
    code: u8,
    text: String,
}

#[derive(Debug, Clone, Deserialize)]
struct BitRate {
    index: u8,
    #[serde(default)]
    kbit: Option<u32>,
    #[serde(default)]
    auto: bool,
}

/// Names of LSS services, results and bit rates (CiA 305).
#[derive(Debug, Default, Deserialize)]
pub struct LssNames {
    service: Vec<Service>,
    result: Vec<LssResult>,
    bit_rate: Vec<BitRate>,
}

impl LssNames {
    /// Name of a command specifier as output writes it.
    pub fn service(&self, code: u8) -> &str {
        self.service.iter().find(|entry| entry.code == code).map_or("unknown", |entry| &entry.name)
    }

    /// Whether there is a service of that name.
    pub fn has(&self, name: &str) -> bool {
        self.service.iter().any(|entry| entry.name == name)
    }

    /// Key of the number a command specifier carries.
    pub(crate) fn number_key(&self, code: u8) -> &str {
        let service = self.service.iter().find(|entry| entry.code == code);
        service.and_then(|entry| entry.field.as_deref()).unwrap_or("number")
    }

    /// Readable title of a command specifier.
    pub fn title(&self, code: u8) -> &str {
        self.service.iter().find(|entry| entry.code == code).map_or("unknown service", |entry| &entry.title)
    }

    /// Text of the result of a configuration service.
    pub fn result(&self, service: u8, code: u8) -> &str {
        let found = self.result.iter().find(|entry| entry.service == service && entry.code == code);
        found.map_or("unknown result", |entry| &entry.text)
    }

    /// Bit rate of an entry of table 0, in kbit/s.
    pub fn bit_rate(&self, entry: u8) -> Option<u32> {
        self.bit_rate.iter().find(|rate| rate.index == entry && !rate.auto).and_then(|rate| rate.kbit)
    }
}

/// Names of CiA 305.
pub fn lss() -> &'static LssNames {
    static TABLE: OnceLock<LssNames> = OnceLock::new();
    TABLE.get_or_init(|| parse("standard/cia305.toml"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn abort_codes_have_texts() {
        assert_eq!(abort_codes().text(0x0602_0000), "object does not exist");
        assert_eq!(abort_codes().text(0x1234_5678), "unknown code");
    }

    #[test]
    fn the_most_specific_emcy_entry_wins() {
        assert_eq!(emcy_codes().text(0x8130), "heartbeat or life-guard error");
        assert_eq!(emcy_codes().text(0x8199), "communication");
    }

    #[test]
    fn register_bits_and_error_classes() {
        let names: Vec<_> = error_register().names(0x11).collect();
        assert_eq!(names, ["generic", "communication"]);
        let classes: Vec<_> = can_errors().classes.names(0x0C).collect();
        assert_eq!(classes, ["controller", "protocol"]);
        assert!(can_errors().location.text_of(0x19).is_some());
    }

    #[test]
    fn lamps_have_names() {
        // 01 01 00 01: malfunction, red stop, protect; flash 11 01 11 00.
        let names: Vec<_> = lamp_names(Lamps { status: 0b0101_0001, flash: 0b1101_1100 }).collect();
        assert_eq!(names, ["malfunction", "red-stop-fast", "protect-slow"]);
    }

    #[test]
    fn lss_names() {
        assert_eq!(lss().service(0x51), "fast-scan");
        assert_eq!(lss().bit_rate(0), Some(1000));
        assert_ne!(lss().result(0x11, 1), "unknown result");
    }
}
