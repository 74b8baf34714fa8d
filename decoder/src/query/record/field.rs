//! Value of an event field, and the trait of field consumers.

use crate::frame::CanId;
use crate::wire::canopen::ObjectAddress;

/// Value of one event field.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum FieldValue<'a> {
    /// Unknown value, written as null.
    Null,
    /// `true` or `false`.
    Bool(bool),
    /// Count, node-ID or raw number.
    Unsigned(u64),
    /// Signed integer.
    Integer(i64),
    /// Scaled number; written as null if not finite.
    Real(f64),
    /// Name or other text.
    Text(&'a str),
    /// Nanoseconds, written as seconds.
    Seconds(i64),
    /// Code, written `"0x…"` with this number of digits.
    Code(u64, u8),
    /// CAN identifier, written in hex without 0x.
    Id(CanId),
    /// Object, written `"0x1018:01"`.
    Object(ObjectAddress),
    /// Bytes, written as hex pairs.
    Bytes(&'a [u8]),
}

/// Consumer of event fields, called in output order.
pub trait FieldConsumer {
    /// Adds a field to the open group; an empty `key` adds an item to the open list.
    fn add_field(&mut self, key: &'static str, value: FieldValue<'_>);
    /// Opens a nested group; an empty `key` opens an item of the open list.
    fn open_group(&mut self, key: &'static str);
    /// Closes the innermost group.
    fn close_group(&mut self);
    /// Opens a list.
    fn open_list(&mut self, key: &'static str);
    /// Closes the innermost list.
    fn close_list(&mut self);
    /// Whether the consumer uses signals; otherwise they are not computed.
    fn wants_signals(&self) -> bool {
        true
    }
}

pub(super) fn number_or_null(number: Option<u8>) -> FieldValue<'static> {
    number.map_or(FieldValue::Null, |number| FieldValue::Unsigned(u64::from(number)))
}
