//! One field of an event, and what takes them.

use crate::frame::CanId;
use crate::wire::canopen::ObjectAddress;

/// One field's value.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum FieldValue<'a> {
    /// Known to be unknown.
    Null,
    /// True or false.
    Bool(bool),
    /// Counts, node-IDs, raw numbers.
    Unsigned(u64),
    /// Signed numbers.
    Integer(i64),
    /// Scaled numbers; not finite ones are written as null.
    Real(f64),
    /// Names and texts.
    Text(&'a str),
    /// Nanoseconds, written as seconds.
    Seconds(i64),
    /// A code, written `"0x…"` with this many digits.
    Code(u64, u8),
    /// An identifier, written in hex without 0x.
    Id(CanId),
    /// An object, written `"0x1018:01"`.
    Object(ObjectAddress),
    /// Data, written as hex pairs.
    Bytes(&'a [u8]),
}

/// Takes fields as they come.
pub trait Fields {
    /// A field of the present object, or of the present list's item if `key` is empty.
    fn field(&mut self, key: &'static str, value: FieldValue<'_>);
    /// A nested object begins; an item of a list if `key` is empty.
    fn open(&mut self, key: &'static str);
    /// It ends.
    fn close(&mut self);
    /// A list begins.
    fn open_list(&mut self, key: &'static str);
    /// It ends.
    fn close_list(&mut self);
    /// Whether signals are worth computing.
    fn wants_signals(&self) -> bool {
        true
    }
}

pub(super) fn number_or_null(number: Option<u8>) -> FieldValue<'static> {
    number.map_or(FieldValue::Null, |number| FieldValue::Unsigned(u64::from(number)))
}
