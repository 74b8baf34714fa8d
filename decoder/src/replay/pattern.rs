//! Text searches in rows.

use regex_lite::Regex;

/// A pattern that the text of a row must match.
#[derive(Debug, Clone)]
pub struct RowPattern(Regex);

impl RowPattern {
    /// A regular expression; it ignores case unless the text contains a capital letter.
    ///
    /// # Errors
    /// Invalid regular expression.
    pub fn new(text: &str) -> Result<Self, String> {
        let is_any_case = !text.chars().any(char::is_uppercase);
        let written = if is_any_case { format!("(?i){text}") } else { text.to_owned() };
        Regex::new(&written).map(Self).map_err(|error| error.to_string())
    }

    /// Whether a text matches.
    pub fn is_match(&self, text: &str) -> bool {
        self.0.is_match(text)
    }
}

impl PartialEq for RowPattern {
    fn eq(&self, other: &Self) -> bool {
        self.0.as_str() == other.0.as_str()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_search_minds_case_only_if_it_is_typed_with_some() {
        assert!(RowPattern::new("emcy").unwrap().is_match("EMCY"));
        assert!(!RowPattern::new("Emcy").unwrap().is_match("EMCY"));
        assert!(RowPattern::new("[").is_err());
    }
}
