//! Text searches.

use cobscope_decoder::replay::RowPattern;

/// A search text with its pattern.
#[derive(Debug, Clone)]
pub struct SearchPattern {
    /// Text as typed.
    pub text: String,
    /// Pattern that rows must match.
    pub pattern: RowPattern,
}

impl SearchPattern {
    /// The pattern of a typed text.
    ///
    /// # Errors
    /// Invalid regular expression.
    pub fn new(text: &str) -> Result<Self, String> {
        Ok(Self { text: text.to_owned(), pattern: RowPattern::new(text)? })
    }
}
