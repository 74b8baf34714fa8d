//! Object addresses in text: `1018:01`, `0x1018:01`, `1018h:01h`, `1018sub1`.

use std::str::FromStr;

use nom::Parser;
use nom::branch::alt;
use nom::bytes::complete::{tag, tag_no_case, take_while_m_n};
use nom::combinator::{all_consuming, opt};
use nom::error::Error;
use nom::sequence::{delimited, preceded};

use super::ObjectAddress;

/// The text is not a valid object address.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
#[error("not a valid object; expected e.g. 1018:01")]
pub struct NotAnAddress;

/// Parses index and sub-index in hexadecimal; an index alone means sub-index 0.
impl FromStr for ObjectAddress {
    type Err = NotAnAddress;

    fn from_str(text: &str) -> Result<Self, NotAnAddress> {
        let sub = preceded(alt((tag_no_case("sub"), tag(":"))), hexadecimal(2));
        let (_, (index, sub)) = all_consuming((hexadecimal(4), opt(sub)))
            .parse_complete(text)
            .map_err(|_: nom::Err<Error<&str>>| NotAnAddress)?;
        Ok(Self { index, sub: sub.unwrap_or_default() })
    }
}

/// A number of at most `digits` digits: `18`, `0x18` or `18h`.
fn hexadecimal<'a, N: TryFrom<u16>>(
    digits: usize,
) -> impl Parser<&'a str, Output = N, Error = Error<&'a str>> {
    let digits = take_while_m_n(1, digits, |digit: char| digit.is_ascii_hexdigit());
    delimited(opt(tag_no_case("0x")), digits, opt(tag_no_case("h")))
        .map_opt(|digits| N::try_from(u16::from_str_radix(digits, 16).ok()?).ok())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn four_notations() {
        for text in ["1018:01", "0x1018:01", "1018h:01h", "1018sub1", "1018:1", "0x1018:0x01"] {
            assert_eq!(text.parse(), Ok(ObjectAddress::new(0x1018, 1)), "{text}");
        }
        assert_eq!("1a00".parse(), Ok(ObjectAddress::new(0x1A00, 0)));
        for text in ["", ":", "1018:", "1018:100", "11018:01", "10x8:01", "1018:+1", "sub1"] {
            assert_eq!(text.parse::<ObjectAddress>(), Err(NotAnAddress), "{text}");
        }
    }
}
