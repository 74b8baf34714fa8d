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
mod embedded;
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
mod standards;

pub use catalogue::{Catalogue, Introduction, ProfileError, is_bus_file};
pub use check::{check, check_ids};
pub use connection_set::{ConnectionSet, Owner, connection_set};
pub(crate) use cut::Cut;
pub(crate) use data_type::little_endian;
pub use data_type::{DataType, Value};
pub use device::Device;
pub use dictionary::{Dictionary, Entry, Found, Object};
pub use formula::formula;
pub use layout::{BitOrder, Carrier, Field, Layout, PdoDirection, PdoName, Selector, Signal, SignalId};

pub use lookup::{
    Bits, Code, Codes, LssNames, UdsCode, UdsNames, UdsService, abort_codes, emcy_codes, error_register,
    failure_modes, industry_groups, lamp_names, lss, pgn_name, transport_aborts, uds,
};
pub(crate) use lookup::{ValueIn, can_errors, fault_hints};
pub use meaning::{Factor, Indicators, Meaning, bit_words, integer, word};
pub use names::{BitName, BitNames, Names};
pub use object::{Effect, Role, Storage};
pub use position::TextError;
pub use reference::Reference;
pub use resolve::{Known, NothingKnown, Number, Resolver};
pub use standards::{isobus, plain_device};
