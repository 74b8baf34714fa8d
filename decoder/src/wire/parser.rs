//! Common part of all parsers: their error, and the only place that converts it to [`MalformedPayload`].
//!
//! A message is a nom parser of `&[u8]`, which [`parse_message`] runs. A missing field is reported at its own
//! offset. [`field_group`] and [`field_sequence`] report several fields and the bytes that all of them need.

use nom::combinator::{peek, rest};
use nom::error::{ErrorKind, ParseError};
use nom::number::complete::u8 as byte;
use nom::sequence::preceded;
use nom::{Err, IResult, Parser};

use super::MalformedPayload;

/// Error of a parser.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct MissingBytes {
    /// Bytes from the failed field to the end of the payload.
    available: usize,
    /// Bytes needed from the failed field on; 0 if it is complete and its value is not allowed.
    needed: usize,
}

impl ParseError<&[u8]> for MissingBytes {
    fn from_error_kind(input: &[u8], kind: ErrorKind) -> Self {
        let needed = if kind == ErrorKind::Verify { 0 } else { input.len().saturating_add(1) };
        Self { available: input.len(), needed }
    }

    fn append(_: &[u8], _: ErrorKind, inner: Self) -> Self {
        inner
    }
}

/// Result of a parser: the remaining bytes and a part of the message.
pub(super) type Parsed<'a, T> = IResult<&'a [u8], T, MissingBytes>;

/// Parser of a message or of a part of it.
pub(super) trait FieldParser<'a>: Parser<&'a [u8], Error = MissingBytes> {}

impl<'a, P: Parser<&'a [u8], Error = MissingBytes>> FieldParser<'a> for P {}

/// Parses the payload of a message; bytes after the message are ignored.
///
/// # Errors
/// If a field is missing or its value is not allowed.
#[inline]
pub(super) fn parse_message<'a, T>(
    layer: &'static str,
    payload: &'a [u8],
    mut message: impl FieldParser<'a, Output = T>,
) -> Result<T, MalformedPayload> {
    match message.parse_complete(payload) {
        Ok((_, message)) => Ok(message),
        Err(error) => Err(malformed(layer, payload.len(), &error)),
    }
}

#[cold]
fn malformed(layer: &'static str, length: usize, error: &Err<MissingBytes>) -> MalformedPayload {
    let (available, needed) = match error {
        // Parsers of complete input never return it.
        Err::Incomplete(_) => (0, 1),
        Err::Error(missing) | Err::Failure(missing) => (missing.available, missing.needed),
    };
    let small = |value: usize| u8::try_from(value).unwrap_or(u8::MAX);
    let offset = small(length.saturating_sub(available));
    MalformedPayload { layer, offset, needed: small(needed), available: small(available) }
}

/// Fields that are reported as a whole: an error states the offset of the first one and the bytes of all.
#[inline]
pub(super) fn field_group<'a, P: FieldParser<'a>>(mut fields: P) -> impl FieldParser<'a, Output = P::Output> {
    move |input: &'a [u8]| {
        fields.parse_complete(input).map_err(|error| {
            error.map(|missing| missing.reported_from(input.len(), input.len(), &mut fields))
        })
    }
}

/// Fields that are reported one by one: an error states the offset of the first missing field, and the bytes
/// of this field and all after it.
#[inline]
pub(super) fn field_sequence<'a, P: FieldParser<'a>>(
    mut fields: P,
) -> impl FieldParser<'a, Output = P::Output> {
    move |input: &'a [u8]| {
        fields.parse_complete(input).map_err(|error| {
            error.map(|missing| missing.reported_from(missing.available, input.len(), &mut fields))
        })
    }
}

impl MissingBytes {
    /// The same error with `available` bytes left, where `fields` started with `length` bytes.
    #[cold]
    fn reported_from<'a>(self, available: usize, length: usize, fields: &mut impl FieldParser<'a>) -> Self {
        if self.needed == 0 {
            return self;
        }
        let consumed = length.saturating_sub(available);
        Self { available, needed: minimum_length(fields).saturating_sub(consumed) }
    }
}

/// Number of bytes that `fields` need. Only the parsers define it, so growing lengths are tried.
fn minimum_length<'a>(fields: &mut impl FieldParser<'a>) -> usize {
    static ZEROS: [u8; u8::MAX as usize] = [0; u8::MAX as usize];
    let mut is_enough =
        |length: &usize| ZEROS.get(..*length).is_some_and(|zeros| fields.parse_complete(zeros).is_ok());
    (0..ZEROS.len()).find(&mut is_enough).unwrap_or(ZEROS.len())
}

/// `N` bytes.
#[inline]
pub(super) fn byte_array<const N: usize>(input: &[u8]) -> Parsed<'_, [u8; N]> {
    match input.split_first_chunk() {
        Some((bytes, rest)) => Ok((rest, *bytes)),
        None => Err(Err::Error(MissingBytes { available: input.len(), needed: N })),
    }
}

/// All remaining bytes, at least one.
#[inline]
pub(super) fn remaining_bytes(input: &[u8]) -> Parsed<'_, &[u8]> {
    preceded(peek(byte), rest).parse_complete(input)
}

/// Bits of a number: `width` bits, fewer than 64, from bit `lowest` up.
#[inline]
pub(super) fn bit_field<T: TryFrom<u64> + Default>(number: impl Into<u64>, lowest: u32, width: u32) -> T {
    let mask = (1 << width) - 1;
    T::try_from(number.into() >> lowest & mask).unwrap_or_default()
}
