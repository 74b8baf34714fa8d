//! JSON numbers whose digits are kept.

use std::fmt::Display;

use serde::Serialize;
use serde_json::value::RawValue;

use crate::frame::Timestamp;

/// A number as it is printed; a float has too few digits for a time in ns.
#[derive(Debug, Clone, Serialize)]
#[serde(transparent)]
pub struct ExactNumber(Box<RawValue>);

impl ExactNumber {
    /// Seconds with nine decimal places.
    pub fn of_time(time: Timestamp) -> Option<Self> {
        Self::of_digits(time)
    }

    /// The digits of `number`; `None` if they are not a JSON number.
    pub fn of_digits(number: impl Display) -> Option<Self> {
        RawValue::from_string(number.to_string()).ok().map(Self)
    }
}
