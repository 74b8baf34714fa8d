//! Converts a database signal to a field of a layout: type, scale, names, and J1939 codes without a value.

use std::sync::Arc;

use crate::profile::data_type::DataType;
use crate::profile::layout::{BitOrder, SignalField, SignalId};
use crate::profile::meaning::{IndicatorCoding, ObjectMeaning, ParameterIndicators, RawConversion};
use crate::profile::names::ValueNames;

/// A signal from either file format, with a checked position.
#[derive(Debug)]
pub(super) struct DbcSignal {
    pub(super) name: String,
    pub(super) spn: Option<u32>,
    /// First bit, as in [`SignalField::bit`].
    pub(super) bit: u16,
    /// Length in bits, 1..=64; 32 or 64 for a float.
    pub(super) bits: u16,
    pub(super) order: BitOrder,
    pub(super) is_signed: bool,
    pub(super) is_float: bool,
    pub(super) factor: f64,
    pub(super) offset: f64,
    /// Minimum and maximum in its unit, if stated.
    pub(super) limits: Option<[f64; 2]>,
    pub(super) unit: String,
    pub(super) values: Option<Arc<ValueNames>>,
}

impl DbcSignal {
    /// Converts the signal; never fails.
    pub(super) fn into_field(self) -> SignalField {
        let data_type = match (self.is_float, self.is_signed, self.bits) {
            (true, _, 33..) => DataType::Real64,
            (true, _, _) => DataType::Real32,
            (false, true, bits) => DataType::signed_of(bits),
            (false, false, bits) => DataType::unsigned_of(bits),
        };
        let indicators = self.indicator_codes();
        let is_scaled = (self.factor - 1.0).abs() > 0.0 || self.offset.abs() > 0.0;
        let scale = RawConversion {
            factor: self.factor,
            offset: self.offset,
            full_scale: None,
            is_reciprocal: false,
        };
        let digits = fraction_digits(self.factor).max(fraction_digits(self.offset));
        let meaning = ObjectMeaning {
            name: self.name,
            data_type: Some(data_type),
            unit: self.unit,
            scale: is_scaled.then_some(scale),
            decimals: if self.is_float { FLOAT_DIGITS } else { shown_digits(self.factor, digits) },
            digits: if self.is_float { u8::MAX } else { digits },
            limits: self.limits,
            values: self.values,
            indicators,
            ..ObjectMeaning::default()
        };
        SignalField {
            id: self.spn.map_or(SignalId::Name, SignalId::Spn),
            meaning: Some(Arc::new(meaning)),
            bit: self.bit,
            bits: self.bits,
            order: self.order,
            present: None,
            data_type,
            is_typed: true,
        }
    }

    /// J1939 indicator codes above the maximum value; only unsigned suspect parameters have them. Without a
    /// maximum, the code alone decides.
    fn indicator_codes(&self) -> Option<ParameterIndicators> {
        if self.spn.is_none() || self.is_signed || self.is_float {
            return None;
        }
        let indicators = ParameterIndicators { bits: self.bits, largest: 0, coding: IndicatorCoding::J1939 };
        let Some([_, most]) = self.limits else { return Some(indicators) };
        Some(ParameterIndicators { largest: largest_raw(most, self.factor, self.offset)?, ..indicators })
    }
}

/// Raw number of the largest value; `None` if it is negative, or if the factor is.
pub(super) fn largest_raw(most: f64, factor: f64, offset: f64) -> Option<u64> {
    // Tolerance of a millionth of a step: 100 % at 0.4 %/bit is 250.00000000000003.
    let largest = ((most - offset) / factor + 1e-6).floor();
    #[expect(
        clippy::cast_possible_truncation,
        clippy::cast_sign_loss,
        reason = "saturates, and is not negative"
    )]
    (largest >= 0.0 && factor > 0.0).then_some(largest as u64)
}

/// Decimals of a scaled float, whose precision is unknown.
const FLOAT_DIGITS: u8 = 6;

/// Decimals of the shortest decimal form of a number.
pub(crate) fn fraction_digits(number: f64) -> u8 {
    let text = number.to_string();
    let digits = text.split_once('.').map_or(0, |(_, digits)| digits.len());
    u8::try_from(digits).unwrap_or(u8::MAX)
}

/// Decimals in which a step of `factor` is visible, at most `digits`: 1/256 km/h alone has eight.
pub(crate) fn shown_digits(factor: f64, digits: u8) -> u8 {
    /// Decimals after the first significant one of a step.
    const MORE: f64 = 2.0;
    let needed = (-factor.abs().log10()).ceil() + MORE;
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "saturates")]
    let needed = needed.clamp(0.0, 255.0) as u8;
    needed.min(digits)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn digits_follow_the_factor() {
        let shown = |factor: f64| shown_digits(factor, fraction_digits(factor));
        assert_eq!((shown(1.0), shown(0.1), shown(0.125), shown(10.0)), (0, 1, 3, 0));
        // 1/256 = 0.00390625: the first significant digit is the third decimal.
        assert_eq!((fraction_digits(1.0 / 256.0), shown(1.0 / 256.0)), (8, 5));
        assert_eq!((shown(1e-7), shown(1e-16), shown(0.0)), (7, 16, 0));
    }
}
