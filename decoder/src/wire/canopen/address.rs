//! Object addresses in text: `1018:01`, `0x1018:01`, `1018h:01h`, `1018sub1`.

use std::str::FromStr;

use super::ObjectAddress;

/// The text is not a valid object address.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
#[error("not a valid object; expected e.g. 1018:01")]
pub struct NotAnAddress;

/// Parses index and sub-index in hexadecimal; an index alone means sub-index 0.
impl FromStr for ObjectAddress {
    type Err = NotAnAddress;

    fn from_str(text: &str) -> Result<Self, NotAnAddress> {
        let lower = text.to_ascii_lowercase();
        let (index, sub) = match lower.split_once("sub").or_else(|| lower.split_once(':')) {
            Some((index, sub)) => (index, sub),
            None => (lower.as_str(), "0"),
        };
        let number = |text: &str, digits: usize| {
            let bare = text.strip_prefix("0x").unwrap_or(text);
            let bare = bare.strip_suffix('h').unwrap_or(bare);
            let fits =
                (1..=digits).contains(&bare.len()) && bare.bytes().all(|byte| byte.is_ascii_hexdigit());
            fits.then(|| u16::from_str_radix(bare, 16).ok()).flatten().ok_or(NotAnAddress)
        };
        let sub = u8::try_from(number(sub, 2)?).map_err(|_| NotAnAddress)?;
        Ok(Self { index: number(index, 4)?, sub })
    }
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
