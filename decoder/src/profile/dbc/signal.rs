//! A signal of a database as field of a layout: type, scale, names and codes without value.

use std::sync::Arc;

use crate::profile::data_type::DataType;
use crate::profile::layout::{BitOrder, Field, SignalId};
use crate::profile::meaning::{Factor, Indicators, Meaning};
use crate::profile::names::Names;

/// A signal, whichever form of file tells it. Its place is checked.
#[derive(Debug)]
pub(super) struct Signal {
    pub(super) name: String,
    pub(super) spn: Option<u32>,
    /// As [`Field::bit`].
    pub(super) bit: u16,
    /// 1..=64; 32 or 64 of a float.
    pub(super) bits: u16,
    pub(super) order: BitOrder,
    pub(super) is_signed: bool,
    pub(super) is_float: bool,
    pub(super) factor: f64,
    pub(super) offset: f64,
    /// Least and largest value in its unit, if the file tells them.
    pub(super) limits: Option<[f64; 2]>,
    pub(super) unit: String,
    pub(super) values: Option<Arc<Names>>,
}

impl Signal {
    /// The field, always there.
    pub(super) fn field(self) -> Field {
        let data_type = match (self.is_float, self.is_signed, self.bits) {
            (true, _, 33..) => DataType::Real64,
            (true, _, _) => DataType::Real32,
            (false, true, bits) => DataType::signed(bits),
            (false, false, bits) => DataType::unsigned(bits),
        };
        let indicators = self.indicators();
        let is_scaled = (self.factor - 1.0).abs() > 0.0 || self.offset.abs() > 0.0;
        let scale = Factor { factor: self.factor, offset: self.offset, full_scale: None };
        let digits = fraction_digits(self.factor).max(fraction_digits(self.offset));
        let meaning = Meaning {
            name: self.name,
            data_type: Some(data_type),
            unit: self.unit,
            scale: is_scaled.then_some(scale),
            decimals: if self.is_float { FLOAT_DIGITS } else { shown_digits(self.factor, digits) },
            digits: if self.is_float { u8::MAX } else { digits },
            limits: self.limits,
            values: self.values,
            indicators,
            ..Meaning::default()
        };
        Field {
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

    /// Codes above the largest value. Only suspect parameters have them, and these are unsigned. Where the file
    /// gives no largest value the code alone decides.
    fn indicators(&self) -> Option<Indicators> {
        if self.spn.is_none() || self.is_signed || self.is_float {
            return None;
        }
        let Some([_, most]) = self.limits else { return Some(Indicators { bits: self.bits, largest: 0 }) };
        // A millionth of a step: 100 % of 0.4 % a bit is 250.00000000000003.
        let largest = ((most - self.offset) / self.factor + 1e-6).floor();
        #[expect(
            clippy::cast_possible_truncation,
            clippy::cast_sign_loss,
            reason = "saturates, and is not negative"
        )]
        let largest = (largest >= 0.0 && self.factor > 0.0).then_some(largest as u64)?;
        Some(Indicators { bits: self.bits, largest })
    }
}

/// Digits a scaled float is shown with; its own are not known.
const FLOAT_DIGITS: u8 = 6;

/// Digits behind the point of the shortest decimal number that is this one.
fn fraction_digits(number: f64) -> u8 {
    let text = number.to_string();
    let digits = text.split_once('.').map_or(0, |(_, digits)| digits.len());
    u8::try_from(digits).unwrap_or(u8::MAX)
}

/// Digits in which a step of `factor` is seen, and no more of those there are: a 256th km/h has eight.
fn shown_digits(factor: f64, digits: u8) -> u8 {
    /// Digits behind the first one of a step.
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
        // 1/256 = 0.00390625: a step is seen in the third digit.
        assert_eq!((fraction_digits(1.0 / 256.0), shown(1.0 / 256.0)), (8, 5));
        assert_eq!((shown(1e-7), shown(1e-16), shown(0.0)), (7, 16, 0));
    }
}
