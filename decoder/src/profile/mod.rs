//! Meaning as data: object names and types, code texts, the connection set, PDO layouts.
//!
//! The TOML files below `decoder/profiles/` are part of the binary as text. Each is parsed when the
//! first question to it is asked, never at start.

mod authored;
mod catalogue;
mod check;
mod connection_set;
mod cut;
mod data_type;
pub mod dbc;
pub mod device;
pub mod device_file;
mod dictionary;
mod formula;
pub mod imported;
mod layout;
mod lookup;
mod meaning;
pub mod object;
mod position;
mod reference;
mod resolve;

pub use catalogue::{Catalogue, Introduction, ProfileError};
pub use check::check;
pub use connection_set::{ConnectionSet, Owner, connection_set};
pub use cut::Cut;
pub(crate) use data_type::little_endian;
pub use data_type::{DataType, Value};
pub use device::Device;
pub use dictionary::{Dictionary, Entry, Found, Object};
pub use formula::formula;
pub use layout::{
    BitOrder, Carrier, Field, Layout, PdoDirection, PdoName, RawValue, Selector, Signal, SignalId,
};
pub use lookup::{
    Bits, CanErrors, Code, Codes, LssNames, UdsCode, UdsNames, UdsService, ValueIn, abort_codes, can_errors,
    emcy_codes, error_register, failure_modes, fault_hints, industry_groups, lamp_names, lss, pgn_name,
    transport_aborts, uds,
};

pub use meaning::{Factor, Indicators, Meaning, bit_words, integer, word};
pub use object::{BitName, BitNames, Effect, Names, Role, Storage};
pub use position::TextError;
pub use reference::Reference;
pub use resolve::{Known, NothingKnown, Number, Resolver};

/// A device of which nothing is known but that it is one: CiA 301.
pub fn plain_device() -> &'static Arc<Device> {
    static PLAIN: OnceLock<Arc<Device>> = OnceLock::new();
    PLAIN.get_or_init(|| {
        // A test parses every embedded file, so the empty device is never taken.
        Catalogue::default().device("cia301").unwrap_or_default()
    })
}

/// What ISO 11783 defines for all devices.
pub fn isobus() -> &'static Arc<Device> {
    static STANDARD: OnceLock<Arc<Device>> = OnceLock::new();
    STANDARD.get_or_init(|| Catalogue::default().device("iso11783").unwrap_or_default())
}

use std::sync::{Arc, OnceLock};

mod embedded {
    include!(concat!(env!("OUT_DIR"), "/profiles.rs"));
}

/// Text of an embedded file; empty if there is none of that path, which a test excludes.
fn embedded(path: &str) -> &'static str {
    embedded::FILES.iter().find(|(name, _)| *name == path).map_or("", |(_, text)| text)
}

/// Parses an embedded file. Broken data ships in no build: a test parses every file, so the fallback
/// to an empty table is never taken.
fn parse<T: serde::de::DeserializeOwned + Default>(path: &str) -> T {
    toml::from_str(embedded(path)).unwrap_or_default()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_embedded_file_is_toml() {
        assert!(embedded::FILES.len() >= 9);
        for (path, text) in embedded::FILES {
            if let Err(error) = toml::from_str::<toml::Table>(text) {
                panic!("{path}: {error}");
            }
        }
    }
}
