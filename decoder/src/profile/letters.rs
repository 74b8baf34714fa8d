//! Letters for the bits of a device word: one per named bit, a capital if the bit is set.
//!
//! ```text
//! 0003h   D H a r   disabled, hold, not active, not ready
//! ```

use super::names::{BitName, BitNames};

/// Maximum number of bits of a word with letters; a longer word is not readable as letters.
const MOST: usize = 16;

/// A bit with its letter.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct BitLetter<'a> {
    /// Bit with its name.
    pub bit: &'a BitName,
    /// Capital, with the number at the end of the name if it has one: `D`, `E3`. Unique within the word.
    pub letter: String,
}

/// Letters of all named single bits, from bit 0; empty if the word has none, or too many.
///
/// The first letter of the name, else its next free one, else the next free one of the alphabet.
pub fn bit_letters(bits: &BitNames) -> Vec<BitLetter<'_>> {
    let mut named: Vec<&BitName> = bits.list.iter().filter(|bit| !bit.reserved && bit.width == 1).collect();
    named.sort_by_key(|bit| bit.bit);
    if named.len() > MOST {
        return Vec::new();
    }
    let mut letters: Vec<BitLetter<'_>> = Vec::new();
    for bit in named {
        let title = bit.bit_title();
        let number: String = title.chars().skip_while(|letter| !letter.is_ascii_digit()).collect();
        let number = if number.bytes().all(|digit| digit.is_ascii_digit()) { number } else { String::new() };
        let own = title.chars().filter(char::is_ascii_alphabetic);
        let mut candidates =
            own.chain('A'..='Z').map(|letter| format!("{}{number}", letter.to_ascii_uppercase()));
        let is_free = |letter: &String| letters.iter().all(|other| other.letter != *letter);
        let Some(letter) = candidates.find(is_free) else { return Vec::new() };
        letters.push(BitLetter { bit, letter });
    }
    letters
}

impl BitLetter<'_> {
    /// The letter for a value of the word: a capital if the bit is set.
    pub fn letter_for(&self, word: u64) -> String {
        if self.bit.bits_of(word) == 0 { self.letter.to_ascii_lowercase() } else { self.letter.clone() }
    }
}

/// A word as letters, with its fields of several bits after them: `DHar`, `scml set 2`. None without letters.
pub fn word_letters(bits: &BitNames, word: u64) -> Option<String> {
    let letters = bit_letters(bits);
    if letters.is_empty() {
        return None;
    }
    let mut text: String = letters.iter().map(|letter| letter.letter_for(word)).collect();
    for field in bits.list.iter().filter(|bit| !bit.reserved && bit.width > 1) {
        let number = field.bits_of(word);
        text.push(' ');
        text.push_str(&field.bit_word(number).unwrap_or_else(|| format!("{} {number}", field.bit_title())));
    }
    Some(text)
}

/// Meaning of the letters of a word: `D disabled`, `H hold`.
pub fn letter_legend(bits: &BitNames) -> Vec<String> {
    let meaning = |letter: &BitLetter<'_>| match &letter.bit.off {
        Some(off) => format!("{} {}, {} {off}", letter.letter, letter.bit.bit_title(), letter.letter_for(0)),
        None => format!("{} {}", letter.letter, letter.bit.bit_title()),
    };
    bit_letters(bits).iter().map(meaning).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn bits(names: &[&str]) -> BitNames {
        let bit = |(bit, name): (u8, &&str)| BitName {
            bit,
            width: 1,
            name: (*name).to_owned(),
            text: None,
            off: None,
            values: None,
            reserved: name.is_empty(),
        };
        BitNames { list: (0..).zip(names).map(bit).collect() }
    }

    fn letters(names: &[&str]) -> Vec<String> {
        bit_letters(&bits(names)).into_iter().map(|letter| letter.letter).collect()
    }

    #[test]
    fn letters_are_unique_within_a_word() {
        assert_eq!(letters(&["disabled", "hold", "active", "ready"]), ["D", "H", "A", "R"]);
        assert_eq!(letters(&["ready", "ramp-running", "", "reset"]), ["R", "A", "E"]);
        // No letter of the name is free: the alphabet continues.
        assert_eq!(letters(&["a", "a", "b", "a"]), ["A", "B", "C", "D"]);
        assert_eq!(letters(&["do1", "ok", "do2", "error-12"]), ["D1", "O", "D2", "E12"]);
        // A number within a name is not its number.
        assert_eq!(letters(&["2-stage pump"]), ["S"]);
        let many: Vec<String> = (0..17).map(|number| format!("binary-{number}")).collect();
        let many: Vec<&str> = many.iter().map(String::as_str).collect();
        assert!(letters(&many).is_empty(), "too many to read");
        assert_eq!(letters(&[]).len(), 0);
    }

    #[test]
    fn a_capital_is_a_set_bit() {
        let word = bits(&["disabled", "hold", "active", "ready"]);
        assert_eq!(word_letters(&word, 0x0F).as_deref(), Some("DHAR"));
        assert_eq!(word_letters(&word, 0x03).as_deref(), Some("DHar"));
        assert_eq!(letter_legend(&word)[..2], ["D disabled", "H hold"]);
        assert_eq!(word_letters(&BitNames::default(), 3), None);
    }

    #[test]
    fn fields_of_several_bits_follow_the_letters() {
        let mut word = bits(&["stop", "enable"]);
        let set = BitName { bit: 4, width: 4, ..word.list[0].clone() };
        word.list.push(BitName { name: "parameter-set".into(), text: Some("set".into()), ..set });
        assert_eq!(word_letters(&word, 0x21).as_deref(), Some("Se set 2"));
        assert_eq!(word_letters(&word, 0x02).as_deref(), Some("sE set 0"));
    }
}
