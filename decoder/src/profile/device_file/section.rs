//! Names of the sections that describe objects (CiA 306-1 §4.6 to §4.8).

/// Section name by its meaning.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum SectionName {
    /// `[1003]`: an object.
    Object(u16),
    /// `[1003sub1]`; the sub-index is hexadecimal.
    Sub(u16, u8),
    /// `[1003Name]`: names of the entries of a compact array.
    Names(u16),
    /// `[1003Value]`: values of these entries in a DCF.
    Values(u16),
    /// `[1003Denotation]`: user-defined names of these entries in a DCF.
    Denotations(u16),
    /// `[M1Fixed6000]`, `[M1Fixed6000sub1]`: objects of a module, independent of its slot.
    ModuleFixed(u16, Option<u8>),
    /// `[M1SubExt6000]`: entries of a module, appended to those of previous modules.
    ModuleExtension,
    /// Any other section of the standard or the manufacturer.
    Other,
    /// Invalid name that resembles a section of an object.
    Strange,
}

impl SectionName {
    /// Parses a name in lower case without spaces.
    pub(super) fn parse_name(key: &str) -> Self {
        match key
            .strip_prefix('m')
            .map(|rest| (rest, rest.trim_start_matches(|digit: char| digit.is_ascii_digit())))
        {
            Some((number, rest)) if rest.len() < number.len() => Self::of_module(rest),
            _ => Self::of_object(key),
        }
    }

    fn of_module(key: &str) -> Self {
        if key.starts_with("subext") && key != "subextends" {
            return Self::ModuleExtension;
        }
        match key.strip_prefix("fixed").map(Self::of_object) {
            Some(Self::Object(index)) => Self::ModuleFixed(index, None),
            Some(Self::Sub(index, sub)) => Self::ModuleFixed(index, Some(sub)),
            _ => Self::Other,
        }
    }

    /// Parses an index of four digits; CANFestival writes type definitions with fewer: `[A0]`.
    fn of_object(key: &str) -> Self {
        let key = key.strip_prefix("0x").unwrap_or(key);
        let digits = key.bytes().take_while(u8::is_ascii_hexdigit).count();
        let Some((index, rest)) = key.split_at_checked(digits.min(4)) else { return Self::Other };
        let Ok(index) = u16::from_str_radix(index, 16) else { return Self::Other };
        match rest {
            "" => Self::Object(index),
            _ if digits < 2 => Self::Other,
            "name" => Self::Names(index),
            "value" => Self::Values(index),
            "denotation" => Self::Denotations(index),
            "objectlinks" => Self::Other,
            _ => match rest.strip_prefix("sub").map(|sub| u8::from_str_radix(sub, 16)) {
                Some(Ok(sub)) => Self::Sub(index, sub),
                _ if digits >= 4 => Self::Strange,
                _ => Self::Other,
            },
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_of_every_kind() {
        for (key, expected) in [
            ("1003", SectionName::Object(0x1003)),
            ("a0", SectionName::Object(0xA0)),
            ("1003sub0", SectionName::Sub(0x1003, 0)),
            ("1003sub0a", SectionName::Sub(0x1003, 10)),
            ("abcdsubff", SectionName::Sub(0xABCD, 255)),
            ("1a00value", SectionName::Values(0x1A00)),
            ("3004name", SectionName::Names(0x3004)),
            ("3004denotation", SectionName::Denotations(0x3004)),
            ("1f22objectlinks", SectionName::Other),
            ("m1fixed6000", SectionName::ModuleFixed(0x6000, None)),
            ("m12fixed6000sub1", SectionName::ModuleFixed(0x6000, Some(1))),
            ("m1subext1027", SectionName::ModuleExtension),
            ("m1subextends", SectionName::Other),
            ("m1moduleinfo", SectionName::Other),
            ("m1fixedobjects", SectionName::Other),
            ("mandatoryobjects", SectionName::Other),
            ("deviceinfo", SectionName::Other),
            ("fileinfo", SectionName::Other),
            ("comments", SectionName::Other),
            ("", SectionName::Other),
            ("1003sub100", SectionName::Strange),
            ("1003sub", SectionName::Strange),
            ("10030", SectionName::Strange),
            ("1003süb", SectionName::Strange),
        ] {
            assert_eq!(SectionName::parse_name(key), expected, "{key}");
        }
    }
}
