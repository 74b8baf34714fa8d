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
mod written;

pub(crate) use authored::TextProblem;
pub use catalogue::{Catalogue, ProfileError, ReportedIdentity, is_bus_file};
pub use check::{check_device, check_ids};
pub(crate) use compiled::read_compiled;
pub use connection_set::{ConnectionSet, IdentifierOwner, connection_set};
pub(crate) use cut::IntegerPosition;
pub(crate) use data_type::little_endian;
pub use data_type::{DataType, DecodedValue};
pub(crate) use dbc::{fraction_digits, shown_digits};
pub use device::{DeviceProfile, ExpectCondition, ExpectEntry};
pub(crate) use device::{ExpectTable, check_entries};
pub use dictionary::{Dictionary, ResolvedObject};
pub use entry::{ObjectEntry, SubEntry};
pub use error_texts::{ErrorTexts, suggested_error_text};
pub use formula::evaluate_formula;
pub use layout::{
    BitOrder, DecodedSignal, FieldSelector, FixedBits, LayoutOrigin, PayloadLayout, PdoDirection, PdoName,
    SignalField, SignalId, ValueCarrier,
};

pub use letters::{BitLetter, bit_letters, letter_legend, word_letters};
pub use lookup::{
    CodeEntry, CodeTable, LssNames, NamedBits, UdsCode, UdsNames, UdsService, abort_codes, emcy_codes,
    error_register, failure_modes, industry_groups, lamp_names, lss_names, pgn_name, transport_aborts,
    uds_names,
};
pub(crate) use lookup::{
    ValueIn, can_errors, fault_hints, is_fast_packet, is_nmea2000_group, is_public_group,
};
pub use meaning::{
    IndicatorCode, IndicatorCoding, ObjectMeaning, ParameterIndicators, RawConversion, as_integer, as_word,
    bit_words,
};
pub use names::{BitName, BitNames, ValueNames};
pub use object::{ObjectRole, Persistence, ValueStorage, WriteEffect};
pub use position::TextError;
pub use reference::ObjectReference;
pub use resolve::{DecidingNumber, EntryResolver, KnownValues, NoValues};
pub use standards::{isobus, plain_device};
pub(crate) use written::node_id;
pub use written::{NodeNumber, SpannedText};
