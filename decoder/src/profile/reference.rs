//! References between entries of a profile: `5208:02`, `5208:02 fixed`, `6043:00 step 800`.

use std::fmt;
use std::str::FromStr;

use serde::Deserialize;

use crate::wire::canopen::ObjectAddress;

/// Reference to an object from an entry that can be repeated.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Deserialize)]
#[serde(try_from = "String")]
pub struct ObjectReference {
    /// Object for the first repeat.
    pub object: ObjectAddress,
    /// Distance between repeats; `None` for the stride of the entry itself.
    pub step: Option<u16>,
}

impl ObjectReference {
    /// Object for repeat `nth`, from 0, of an entry with this stride.
    pub fn shift_object(self, nth: u16, stride: u16) -> ObjectAddress {
        let distance = self.step.unwrap_or(stride).wrapping_mul(nth);
        ObjectAddress { index: self.object.index.wrapping_add(distance), ..self.object }
    }

    /// Fixed reference to the object of repeat `nth`.
    #[must_use]
    pub(crate) fn pin_repeat(self, nth: u16, stride: u16) -> Self {
        Self { object: self.shift_object(nth, stride), step: Some(0) }
    }
}

impl FromStr for ObjectReference {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let mut words = text.split_whitespace();
        let object = words.next().unwrap_or_default().parse().map_err(|error| format!("{error}"))?;
        let step = match (words.next(), words.next(), words.next()) {
            (None, ..) => None,
            (Some("fixed"), None, _) => Some(0),
            (Some("step"), Some(step), None) => Some(
                u16::from_str_radix(step.trim_start_matches("0x"), 16)
                    .map_err(|_| format!("invalid step '{step}'; expected a hex number such as 800"))?,
            ),
            _ => {
                return Err(format!(
                    "invalid reference '{text}'; expected 5208:02, 5208:02 fixed or 6043:00 step 800"
                ));
            }
        };
        Ok(Self { object, step })
    }
}

impl TryFrom<String> for ObjectReference {
    type Error = String;

    fn try_from(text: String) -> Result<Self, String> {
        text.parse()
    }
}

/// Reference to one bit of an object: `5038:00/1`.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize)]
#[serde(try_from = "String")]
pub struct BitReference {
    /// Object that contains the bit.
    pub object: ObjectReference,
    /// Bit number, from 0.
    pub bit: u8,
}

impl TryFrom<String> for BitReference {
    type Error = String;

    fn try_from(text: String) -> Result<Self, String> {
        let wrong = || format!("invalid bit '{text}'; expected the form 5038:00/1");
        let (object, bit) = text.split_once('/').ok_or_else(wrong)?;
        let (bit, rest) = bit.split_once(' ').unwrap_or((bit, ""));
        let bit = bit.parse().ok().filter(|bit| *bit < 64).ok_or_else(wrong)?;
        Ok(Self { object: format!("{object} {rest}").parse()?, bit })
    }
}

/// Range of objects, both ends included: `1000:00..1FFF:FF`, or a single object.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize)]
#[serde(try_from = "String")]
pub struct ObjectRange {
    first: ObjectReference,
    last: ObjectReference,
}

impl ObjectRange {
    /// Whether the range for repeat `nth` contains `object`.
    pub fn covers(&self, object: ObjectAddress, nth: u16, stride: u16) -> bool {
        (self.first.shift_object(nth, stride)..=self.last.shift_object(nth, stride)).contains(&object)
    }

    /// First and last object for the first repeat.
    pub const fn range_ends(&self) -> (ObjectAddress, ObjectAddress) {
        (self.first.object, self.last.object)
    }

    /// Fixed range for repeat `nth`.
    #[must_use]
    pub(crate) fn pin_repeat(self, nth: u16, stride: u16) -> Self {
        Self { first: self.first.pin_repeat(nth, stride), last: self.last.pin_repeat(nth, stride) }
    }
}

impl TryFrom<String> for ObjectRange {
    type Error = String;

    fn try_from(text: String) -> Result<Self, String> {
        let (first, last) = text.split_once("..").unwrap_or((&text, &text));
        let (mut first, last): (ObjectReference, ObjectReference) =
            (first.trim().parse()?, last.trim().parse()?);
        // A step after the last object applies to both ends.
        first.step = first.step.or(last.step);
        if last.object < first.object {
            return Err(format!("invalid range '{text}'; expected the lower object first"));
        }
        Ok(Self { first, last })
    }
}

impl fmt::Display for ObjectRange {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let (first, last) = self.range_ends();
        if first == last { write!(f, "{first}") } else { write!(f, "{first} to {last}") }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn references_move_with_their_entry_unless_they_say_otherwise() {
        let at =
            |text: &str, nth| text.parse::<ObjectReference>().unwrap().shift_object(nth, 0x700).to_string();
        assert_eq!(at("2200:00", 3), "3700:00");
        assert_eq!(at("6043:00 step 800", 2), "7043:00");
        assert_eq!(at("5208:02 fixed", 2), "5208:02");
        assert!("6043:00 by 800".parse::<ObjectReference>().is_err());
        assert!("6043:00 step x".parse::<ObjectReference>().is_err());
    }

    #[test]
    fn ranges_and_bits() {
        let range = ObjectRange::try_from("1000:00..1FFF:FF".to_owned()).unwrap();
        assert!(range.covers(ObjectAddress::new(0x1FFF, 0), 0, 0));
        assert!(!range.covers(ObjectAddress::new(0x2000, 0), 0, 0));
        let fixed = ObjectRange::try_from("1600:00..1607:FF fixed".to_owned()).unwrap();
        assert!(fixed.covers(ObjectAddress::new(0x1600, 0), 3, 0x800));
        assert!(ObjectRange::try_from("2000:00..1000:00".to_owned()).is_err());
        let bit = BitReference::try_from("5038:00/1".to_owned()).unwrap();
        assert_eq!((bit.object.object.to_string().as_str(), bit.bit), ("5038:00", 1));
        assert_eq!(BitReference::try_from("6040:00/3 fixed".to_owned()).unwrap().object.step, Some(0));
        assert!(BitReference::try_from("5038:00/64".to_owned()).is_err());
    }
}
