//! Text searches.

use regex_lite::Regex;

/// A search text with its pattern.
#[derive(Debug, Clone)]
pub struct SearchPattern {
    /// Text as typed.
    pub text: String,
    /// Pattern that rows must match.
    pub pattern: Regex,
}

/// A search pattern; it ignores case unless the text contains a capital letter.
///
/// # Errors
/// Invalid regular expression.
pub fn pattern(text: &str) -> Result<Regex, String> {
    let is_any_case = !text.chars().any(char::is_uppercase);
    let written = if is_any_case { format!("(?i){text}") } else { text.to_owned() };
    Regex::new(&written).map_err(|error| error.to_string())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_search_minds_case_only_if_it_is_typed_with_some() {
        assert!(pattern("emcy").unwrap().is_match("EMCY"));
        assert!(!pattern("Emcy").unwrap().is_match("EMCY"));
        assert!(pattern("[").is_err());
    }
}
