//! Detection of a format by its first lines, for formats without a header.

use super::line_format::first_lines;

/// Number of lines at the start that are classified.
const DETECTING_LINES: usize = 200;

/// A misfit is permitted per this number of lines that fit.
const FITTING_PER_MISFIT: usize = 9;

/// Relation of a line to a format.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(in crate::capture) enum LineClass {
    /// Proves the format: a frame, or another line that no other program writes.
    Proof,
    /// A line that occurs in the format, but also elsewhere.
    Related,
    /// Not a line of the format.
    Misfit,
}

/// Whether the first line belongs to the format, nine in ten of the first lines do, and at least `least` prove it.
pub(in crate::capture) fn fits_lines(
    head: &[u8],
    least: usize,
    mut classify: impl FnMut(&[u8]) -> LineClass,
) -> bool {
    let (mut proofs, mut related, mut misfits) = (0_usize, 0_usize, 0_usize);
    for line in first_lines(head, DETECTING_LINES) {
        match classify(line) {
            LineClass::Proof => proofs += 1,
            LineClass::Related => related += 1,
            LineClass::Misfit if proofs + related == 0 => return false,
            LineClass::Misfit => misfits += 1,
        }
    }
    proofs >= least && proofs > 0 && misfits.saturating_mul(FITTING_PER_MISFIT) <= proofs + related
}

#[cfg(test)]
mod tests {
    use super::*;

    fn fits(text: &str, least: usize) -> bool {
        fits_lines(text.as_bytes(), least, |line| match line {
            b"p" => LineClass::Proof,
            b"r" => LineClass::Related,
            _ => LineClass::Misfit,
        })
    }

    #[test]
    fn one_misfit_in_ten_lines_is_permitted_but_not_the_first() {
        assert!(fits("r\n\np\n", 1));
        assert!(!fits("r\n", 0), "no proof");
        assert!(!fits("p\n", 2));
        assert!(fits(&format!("{}x\n", "p\n".repeat(9)), 1));
        assert!(!fits(&format!("{}x\n", "p\n".repeat(8)), 1));
        assert!(!fits(&format!("x\n{}", "p\n".repeat(20)), 1));
        assert!(!fits("", 0));
    }
}
