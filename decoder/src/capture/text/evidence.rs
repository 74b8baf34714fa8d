//! Detection of a format by its first lines, for formats without a header.

use super::line_format::first_lines;

/// Number of lines at the start that are classified.
const DETECTING_LINES: usize = 200;

/// Relation of a line to a format.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(in crate::capture) enum LineClass {
    /// Proves the format: no other program writes such a line.
    Proof,
    /// A line that occurs in the format, but also elsewhere.
    Related,
    /// Not a line of the format.
    Misfit,
}

/// Whether a line proves the format, and all lines before it belong to it. The answer for the first lines is that for
/// more of them, so it does not depend on the size of the pieces in which a capture arrives.
pub(in crate::capture) fn is_proven(head: &[u8], mut classify: impl FnMut(&[u8]) -> LineClass) -> bool {
    for line in first_lines(head, DETECTING_LINES) {
        match classify(line) {
            LineClass::Proof => return true,
            LineClass::Related => {}
            LineClass::Misfit => return false,
        }
    }
    false
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn all_lines_before_the_proof_must_belong_to_the_format() {
        let is = |text: &str| {
            is_proven(text.as_bytes(), |line| match line {
                b"p" => LineClass::Proof,
                b"r" => LineClass::Related,
                _ => LineClass::Misfit,
            })
        };
        assert!(is("r\n\np\nx\n") && is("p"));
        assert!(!is("r\n") && !is("r\nx\np\n") && !is(""));
    }
}
