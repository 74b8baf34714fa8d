//! Values as numbers of a plot.

use super::data_type::DecodedValue;
use super::layout::SignalField;
use super::meaning::as_integer;

impl SignalField {
    /// A value as a number for a plot: the scaled quantity or the number of a state. None for special values
    /// such as "not available".
    pub fn plot_number(&self, value: &DecodedValue) -> Option<f64> {
        let plain = match value {
            #[expect(clippy::cast_precision_loss, reason = "drawn with a few digits")]
            DecodedValue::Unsigned(number) => *number as f64,
            #[expect(clippy::cast_precision_loss, reason = "drawn with a few digits")]
            DecodedValue::Integer(number) => *number as f64,
            DecodedValue::Real(number) => *number,
            DecodedValue::Text(_) | DecodedValue::Bytes(_) => return None,
        };
        let Some(meaning) = self.meaning.as_deref() else { return Some(plain) };
        if meaning.scale.is_some() {
            return meaning.scaled_value(value);
        }
        // A name among the values is a state; a special value has no number.
        let special =
            meaning.special.as_deref().zip(as_integer(value)).and_then(|(names, raw)| names.get(raw));
        let is_indicated =
            meaning.indicators.is_some() && meaning.values.is_none() && meaning.value_label(value).is_some();
        (special.is_none() && !is_indicated).then_some(plain)
    }
}
