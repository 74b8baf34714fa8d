//! Meaning as data: object names and types, code texts, the connection set, PDO layouts.
//!
//! The TOML files of `decoder/profiles/` are embedded in the binary. Each one is loaded on first use, not at
//! start.

mod authored;
mod catalogue;
mod check;
mod compiled;
mod connection_set;
mod cut;
mod data_type;
pub mod dbc;
mod deciding;
pub mod device;
pub mod device_file;
mod dictionary;
mod embedded;
mod entry;
mod error_texts;
mod formula;
pub mod imported;
mod layer;
mod layout;
mod letters;
mod lookup;
mod meaning;
mod names;
pub mod object;
mod one_or_many;
mod plotted;
mod position;
mod quoted;
mod reference;
mod resolve;
mod standards;

pub use catalogue::{Catalogue, ProfileError, ReportedIdentity, is_bus_file};
pub use check::{check, check_ids};
pub use connection_set::{ConnectionSet, Owner, connection_set};
pub(crate) use cut::IntegerPosition;
pub(crate) use data_type::little_endian;
pub use data_type::{DataType, Value};
pub use device::Device;
pub use dictionary::{Dictionary, ResolvedObject};
pub use entry::{Entry, Object};
pub use error_texts::{ErrorTexts, suggested_error_text};
pub use formula::formula;
pub use layout::{
    BitOrder, Carrier, Field, FixedBits, Layout, LayoutOrigin, PdoDirection, PdoName, Selector, Signal,
    SignalId,
};

pub use letters::{BitLetter, bit_letters, letter_legend, word_letters};
pub use lookup::{
    Bits, Code, Codes, LssNames, UdsCode, UdsNames, UdsService, abort_codes, emcy_codes, error_register,
    failure_modes, industry_groups, lamp_names, lss, pgn_name, transport_aborts, uds,
};
pub(crate) use lookup::{
    ValueIn, can_errors, fault_hints, is_fast_packet, is_nmea2000_group, is_public_group,
};
pub use meaning::{Factor, IndicatorCode, IndicatorCoding, Indicators, Meaning, bit_words, integer, word};
pub use names::{BitName, BitNames, Names};
pub use object::{Effect, Persistence, Role, Storage};
pub use position::TextError;
pub use reference::Reference;
pub use resolve::{KnownValues, NoValues, Number, Resolver};
pub use standards::{isobus, plain_device};
