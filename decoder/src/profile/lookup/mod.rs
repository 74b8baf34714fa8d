//! Lookup tables for codes and bits.

mod groups;
mod uds;

use std::sync::OnceLock;

use serde::Deserialize;

use super::embedded::parse_embedded;
use crate::wire::j1939::{FlashRate, LampStates};

pub use groups::pgn_name;
pub(crate) use groups::{is_fast_packet, is_nmea2000_group, is_public_group};
pub(crate) use uds::ValueIn;
pub use uds::{UdsCode, UdsNames, UdsService, uds_names};

/// Entry of a code table.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct CodeEntry {
    /// Code number.
    #[serde(rename = "code")]
    pub number: u32,
    /// Bits of the code to compare; all by default.
    #[serde(default = "all_bits")]
    pub mask: u32,
    /// Meaning of the code.
    pub text: String,
    /// Short name in the standard; empty if the table has none.
    #[serde(default)]
    pub standard: String,
    /// Most common cause.
    #[serde(default)]
    pub hint: String,
}

const fn all_bits() -> u32 {
    u32::MAX
}

/// Table of codes.
#[derive(Debug, Default, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct CodeTable {
    code: Vec<CodeEntry>,
}

impl CodeTable {
    /// Most specific entry that matches `code`.
    pub fn find_code(&self, code: u32) -> Option<&CodeEntry> {
        let matching = self.code.iter().filter(|entry| code & entry.mask == entry.number & entry.mask);
        matching.max_by_key(|entry| entry.mask.count_ones())
    }

    /// Text of `code`; "unknown code" without an entry.
    pub fn code_text(&self, code: u32) -> &str {
        self.find_code(code).map_or("unknown code", |entry| &entry.text)
    }
}

/// A named bit or value of a byte.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
struct NamedBit {
    #[serde(rename = "bit", alias = "value")]
    mask: u32,
    name: String,
    #[serde(default)]
    text: String,
}

/// Named bits or values of a byte.
#[derive(Debug, Default)]
pub struct NamedBits(Vec<NamedBit>);

impl NamedBits {
    /// Names of the bits set in `value`, in ascending order.
    pub fn set_names(&self, value: u32) -> impl Iterator<Item = &str> {
        self.0.iter().filter(move |entry| value & entry.mask != 0).map(|entry| entry.name.as_str())
    }

    /// Texts of the bits set in `value`, in ascending order.
    pub fn set_texts(&self, value: u32) -> impl Iterator<Item = &str> {
        self.0
            .iter()
            .filter(move |entry| value & entry.mask != 0)
            .map(|entry| if entry.text.is_empty() { entry.name.as_str() } else { entry.text.as_str() })
    }

    /// Text of the entry that equals `value`.
    pub fn text_of(&self, value: u32) -> Option<&str> {
        self.0.iter().find(|entry| entry.mask == value).map(|entry| entry.text.as_str())
    }
}

/// Units that a profile can use.
pub(super) fn unit_names() -> &'static Vec<String> {
    #[derive(Default, Deserialize)]
    #[serde(deny_unknown_fields)]
    struct LookupFile {
        unit: Vec<String>,
    }
    static TABLE: OnceLock<Vec<String>> = OnceLock::new();
    TABLE.get_or_init(|| parse_embedded::<LookupFile>("lookups/units.toml").unit)
}

/// SDO abort codes (CiA 301 §7.2.4.3.17).
pub fn abort_codes() -> &'static CodeTable {
    static TABLE: OnceLock<CodeTable> = OnceLock::new();
    TABLE.get_or_init(|| parse_embedded("lookups/sdo_abort_codes.toml"))
}

/// Reasons of a connection abort (J1939-21 §5.10.3.4).
pub fn transport_aborts() -> &'static CodeTable {
    static TABLE: OnceLock<CodeTable> = OnceLock::new();
    TABLE.get_or_init(|| parse_embedded("lookups/transport_aborts.toml"))
}

/// Failure mode identifiers (J1939-73 appendix A).
pub fn failure_modes() -> &'static CodeTable {
    static TABLE: OnceLock<CodeTable> = OnceLock::new();
    TABLE.get_or_init(|| parse_embedded("lookups/failure_modes.toml"))
}

/// Industry groups of a NAME (J1939-81 §4.1.1.2).
pub fn industry_groups() -> &'static NamedBits {
    #[derive(Default, Deserialize)]
    #[serde(deny_unknown_fields)]
    struct LookupFile {
        class: Vec<NamedBit>,
    }
    static TABLE: OnceLock<NamedBits> = OnceLock::new();
    TABLE.get_or_init(|| NamedBits(parse_embedded::<LookupFile>("lookups/industry_groups.toml").class))
}

/// Names of the lamps that are on, including the flash rate (J1939-73 §5.7.1).
pub fn lamp_names(lamps: LampStates) -> impl Iterator<Item = &'static str> {
    #[derive(Deserialize)]
    #[serde(deny_unknown_fields)]
    struct LampEntry {
        shift: u8,
        name: String,
        slow: String,
        fast: String,
    }
    #[derive(Default, Deserialize)]
    #[serde(deny_unknown_fields)]
    struct LookupFile {
        lamp: Vec<LampEntry>,
    }
    static TABLE: OnceLock<Vec<LampEntry>> = OnceLock::new();
    let table = TABLE.get_or_init(|| parse_embedded::<LookupFile>("lookups/lamps.toml").lamp);
    table.iter().filter_map(move |lamp| {
        Some(match lamps.flash_rate(lamp.shift)? {
            FlashRate::Steady => lamp.name.as_str(),
            FlashRate::Slow => &lamp.slow,
            FlashRate::Fast => &lamp.fast,
        })
    })
}

/// EMCY error codes and classes (CiA 301 §7.2.7.1).
pub fn emcy_codes() -> &'static CodeTable {
    static TABLE: OnceLock<CodeTable> = OnceLock::new();
    TABLE.get_or_init(|| parse_embedded("lookups/emcy_codes.toml"))
}

/// Points to check after a finding of a rule, most likely first; empty for a rule without hints.
pub(crate) fn fault_hints(rule: &str) -> &'static [String] {
    #[derive(Deserialize)]
    #[serde(deny_unknown_fields)]
    struct LookupHint {
        rule: String,
        texts: Vec<String>,
    }
    #[derive(Default, Deserialize)]
    #[serde(deny_unknown_fields)]
    struct LookupFile {
        hint: Vec<LookupHint>,
    }
    static TABLE: OnceLock<LookupFile> = OnceLock::new();
    let file = TABLE.get_or_init(|| parse_embedded("lookups/fault_hints.toml"));
    file.hint.iter().find(|hint| hint.rule == rule).map_or(&[], |hint| &hint.texts)
}

/// Bits of the error register, object 0x1001.
pub fn error_register() -> &'static NamedBits {
    #[derive(Default, Deserialize)]
    #[serde(deny_unknown_fields)]
    struct LookupFile {
        bit: Vec<NamedBit>,
    }
    static TABLE: OnceLock<NamedBits> = OnceLock::new();
    TABLE.get_or_init(|| {
        // This table contains bit numbers, the others contain masks.
        let file: LookupFile = parse_embedded("lookups/error_register.toml");
        NamedBits(
            file.bit.into_iter().map(|entry| NamedBit { mask: 1 << (entry.mask & 31), ..entry }).collect(),
        )
    })
}

/// Lookup tables for SocketCAN error frames.
#[derive(Debug, Default)]
pub(crate) struct CanErrors {
    /// Error classes in the identifier, bits.
    pub classes: NamedBits,
    /// Controller byte, bits.
    pub controller: NamedBits,
    /// Protocol byte, bits.
    pub protocol: NamedBits,
    /// Location byte, values.
    pub location: NamedBits,
    /// Transceiver byte, values.
    pub transceiver: NamedBits,
}

/// Error classes and details of SocketCAN (linux/can/error.h).
pub(crate) fn can_errors() -> &'static CanErrors {
    #[derive(Default, Deserialize)]
    #[serde(deny_unknown_fields)]
    struct LookupFile {
        class: Vec<NamedBit>,
        controller: Vec<NamedBit>,
        protocol: Vec<NamedBit>,
        location: Vec<NamedBit>,
        transceiver: Vec<NamedBit>,
    }
    static TABLE: OnceLock<CanErrors> = OnceLock::new();
    TABLE.get_or_init(|| {
        let file: LookupFile = parse_embedded("lookups/can_error_classes.toml");
        CanErrors {
            classes: NamedBits(file.class),
            controller: NamedBits(file.controller),
            protocol: NamedBits(file.protocol),
            location: NamedBits(file.location),
            transceiver: NamedBits(file.transceiver),
        }
    })
}

#[derive(Debug, Clone, Deserialize)]
struct ServiceEntry {
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
struct BitRateEntry {
    index: u8,
    #[serde(default)]
    kbit: Option<u32>,
    #[serde(default)]
    auto: bool,
}

/// Names of LSS services, results and bit rates (CiA 305).
#[derive(Debug, Default, Deserialize)]
pub struct LssNames {
    service: Vec<ServiceEntry>,
    result: Vec<LssResult>,
    bit_rate: Vec<BitRateEntry>,
}

impl LssNames {
    /// Name of a command specifier in output.
    pub fn service_name(&self, code: u8) -> &str {
        self.service.iter().find(|entry| entry.code == code).map_or("unknown", |entry| &entry.name)
    }

    /// Whether a service has this name.
    pub fn has_service(&self, name: &str) -> bool {
        self.service.iter().any(|entry| entry.name == name)
    }

    /// Output key of the number in messages with this command specifier.
    pub(crate) fn number_key(&self, code: u8) -> &str {
        let service = self.service.iter().find(|entry| entry.code == code);
        service.and_then(|entry| entry.field.as_deref()).unwrap_or("number")
    }

    /// Title of a command specifier.
    pub fn service_title(&self, code: u8) -> &str {
        self.service.iter().find(|entry| entry.code == code).map_or("unknown service", |entry| &entry.title)
    }

    /// Text of the result of a configuration service.
    pub fn result_text(&self, service: u8, code: u8) -> &str {
        let found = self.result.iter().find(|entry| entry.service == service && entry.code == code);
        found.map_or("unknown result", |entry| &entry.text)
    }

    /// Bit rate of an entry in bit timing table 0, in kbit/s.
    pub fn bit_rate(&self, entry: u8) -> Option<u32> {
        self.bit_rate.iter().find(|rate| rate.index == entry && !rate.auto).and_then(|rate| rate.kbit)
    }
}

/// Names defined in CiA 305.
pub fn lss_names() -> &'static LssNames {
    static TABLE: OnceLock<LssNames> = OnceLock::new();
    TABLE.get_or_init(|| parse_embedded("standard/cia305.toml"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn abort_codes_have_texts() {
        assert_eq!(abort_codes().code_text(0x0602_0000), "object does not exist");
        assert_eq!(abort_codes().code_text(0x1234_5678), "unknown code");
    }

    #[test]
    fn the_most_specific_emcy_entry_wins() {
        assert_eq!(emcy_codes().code_text(0x8130), "heartbeat or life-guard error");
        assert_eq!(emcy_codes().code_text(0x8199), "communication");
    }

    #[test]
    fn codes_have_the_short_names_of_cia_301() {
        for entry in emcy_codes().code.iter().chain(&abort_codes().code) {
            assert!(!entry.standard.is_empty() && !entry.standard.ends_with('.'), "{entry:?}");
        }
        let emcy = |code| emcy_codes().find_code(code).unwrap().standard.as_str();
        assert_eq!(emcy(0x8130), "Life guard error or heartbeat error");
        assert_eq!(emcy(0x8199), "Communication");
        let abort = abort_codes().find_code(0x0602_0000).unwrap();
        assert_eq!(abort.standard, "Object does not exist in the object dictionary");
    }

    #[test]
    fn register_bits_and_error_classes() {
        let names: Vec<_> = error_register().set_names(0x11).collect();
        assert_eq!(names, ["generic", "communication"]);
        let classes: Vec<_> = can_errors().classes.set_names(0x0C).collect();
        assert_eq!(classes, ["controller", "protocol"]);
        assert!(can_errors().location.text_of(0x19).is_some());
    }

    #[test]
    fn lamps_have_names() {
        // 01 01 00 01: malfunction, red stop, protect; flash 11 01 11 00.
        let names: Vec<_> = lamp_names(LampStates { status: 0b0101_0001, flash: 0b1101_1100 }).collect();
        assert_eq!(names, ["malfunction", "red-stop-fast", "protect-slow"]);
    }

    #[test]
    fn lss_names_are_found() {
        assert_eq!(lss_names().service_name(0x51), "fast-scan");
        assert_eq!(lss_names().bit_rate(0), Some(1000));
        assert_ne!(lss_names().result_text(0x11, 1), "unknown result");
    }
}
