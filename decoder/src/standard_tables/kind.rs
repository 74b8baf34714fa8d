//! Columns of a field: kind, length, scale.
//!
//! `decoder/standards/README.md` lists the letters.

/// How the bits of a field are read.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum FieldKind {
    /// Bits without a meaning.
    Gap,
    Unsigned,
    Signed,
    Real,
    /// A number whose states have texts.
    Enumeration,
    /// Named bits.
    Bits,
    /// Text of a fixed length, padded.
    Text,
    /// Text with a length and an encoding before it.
    EncodedText,
    /// Text with a length before it and a zero after it.
    CountedText,
    /// Text up to an asterisk.
    DelimitedText,
    Bytes,
    /// Two decimal digits in each byte.
    Digits,
    /// Days since 1970.
    Date,
    /// Time of day.
    Clock,
    /// Number of a parameter group.
    Group,
    /// Number that selects the next value of kind `KeyedValue`.
    Key,
    /// Length of that value in bytes.
    Length,
    KeyedValue,
    /// Value of a field of another group: the group of the last `Group` field, the field of the last number.
    Referenced,
}

impl FieldKind {
    /// Whether a field contains characters.
    pub(super) const fn is_text(self) -> bool {
        matches!(self, Self::Text | Self::EncodedText | Self::CountedText | Self::DelimitedText)
    }
}

/// Parsed second column: `u16=419@190`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct KindColumn {
    pub(super) kind: FieldKind,
    /// Length in bits; 0 if it depends on the payload.
    pub(super) bits: u16,
    /// Number that the field must have.
    pub(super) wanted: Option<u64>,
    /// Suspect parameter number.
    pub(super) spn: Option<u32>,
    /// Line of the field with the length in bits.
    pub(super) length_line: Option<usize>,
    /// Bytes that a length counts in addition to the value.
    pub(super) overhead: u64,
}

impl KindColumn {
    pub(super) fn parse_column(text: &str) -> Option<Self> {
        let kind = kind_of(text.chars().next()?)?;
        let rest = text.get(1..)?;
        let digits = rest.find(|letter: char| !letter.is_ascii_digit()).unwrap_or(rest.len());
        let (bits, rest) = rest.split_at_checked(digits)?;
        let number = |sign: char| {
            let (_, after) = rest.split_once(sign)?;
            let end = after.find(|letter: char| !letter.is_ascii_digit()).unwrap_or(after.len());
            after.get(..end)?.parse::<u64>().ok()
        };
        Some(Self {
            kind,
            bits: if bits.is_empty() { 0 } else { bits.parse().ok()? },
            wanted: number('='),
            spn: number('@').and_then(|spn| u32::try_from(spn).ok()),
            length_line: number('<').and_then(|line| usize::try_from(line).ok()),
            overhead: number('-').unwrap_or(0),
        })
    }
}

fn kind_of(letter: char) -> Option<FieldKind> {
    Some(match letter {
        '-' => FieldKind::Gap,
        'u' => FieldKind::Unsigned,
        'i' => FieldKind::Signed,
        'r' => FieldKind::Real,
        'e' => FieldKind::Enumeration,
        'b' => FieldKind::Bits,
        's' => FieldKind::Text,
        'a' => FieldKind::EncodedText,
        'z' => FieldKind::CountedText,
        '*' => FieldKind::DelimitedText,
        'x' => FieldKind::Bytes,
        'd' => FieldKind::Digits,
        't' => FieldKind::Date,
        'c' => FieldKind::Clock,
        'p' => FieldKind::Group,
        'k' => FieldKind::Key,
        'n' => FieldKind::Length,
        'v' => FieldKind::KeyedValue,
        'w' => FieldKind::Referenced,
        _ => return None,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_column_has_kind_length_and_marks() {
        let read = |text| KindColumn::parse_column(text).unwrap();
        let plain = KindColumn {
            kind: FieldKind::Unsigned,
            bits: 16,
            wanted: None,
            spn: Some(190),
            length_line: None,
            overhead: 0,
        };
        assert_eq!(read("u16@190"), plain);
        assert_eq!(read("u16=419@190"), KindColumn { wanted: Some(419), ..plain });
        assert_eq!((read("x<3").length_line, read("x<3").bits, read("n16-3").overhead), (Some(3), 0, 3));
        assert_eq!((read("-6").kind, read("-6").bits), (FieldKind::Gap, 6));
        assert_eq!(KindColumn::parse_column("?8"), None);
        assert_eq!(KindColumn::parse_column(""), None);
    }
}
