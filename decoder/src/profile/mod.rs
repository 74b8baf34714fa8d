//! Meaning as data: object names and types, code texts, the connection set, PDO layouts.
//!
//! The TOML files below `decoder/profiles/` are part of the binary as text. Each is parsed when the
//! first question to it is asked, never at start.

mod authored;
mod catalogue;
mod check;
mod compiled;
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
mod names;
pub mod object;
mod one_or_many;
mod position;
mod quoted;
mod reference;
mod resolve;

pub use catalogue::{Catalogue, Introduction, ProfileError, is_bus_file};
pub use check::{check, check_ids};
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
pub use names::{BitName, BitNames, Names};
pub use object::{Effect, Role, Storage};
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

/// Reads an embedded file. Broken data ships in no build: a test reads every file, so the fallback to an empty
/// table is never taken.
fn parse<T: serde::de::DeserializeOwned + Default>(path: &str) -> T {
    let file = embedded::FILES.iter().find(|(name, ..)| *name == path);
    file.and_then(|(_, _, compiled)| compiled::read(compiled).ok()).unwrap_or_default()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn compiled_files_say_what_their_text_says() {
        assert!(embedded::FILES.len() >= 9);
        for (path, text, compiled) in embedded::FILES {
            let table: toml::Table = toml::from_str(text).unwrap();
            assert_eq!(compiled::read::<toml::Table>(compiled).unwrap(), table, "{path}");
        }
    }
}
