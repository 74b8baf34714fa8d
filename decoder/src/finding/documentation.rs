//! Sections of the documentation of a rule.

/// First sentence of a section, in the form of a clause: `Check the cable.` becomes `check the cable`.
pub(super) fn next_step(section: &str) -> Option<String> {
    let text = section.split_whitespace().collect::<Vec<_>>().join(" ");
    let sentence = text.split(". ").next()?.trim_end_matches('.');
    let mut letters = sentence.chars();
    let first = letters.next()?;
    let is_word = letters.clone().next().is_some_and(char::is_lowercase);
    let first = if is_word { first.to_ascii_lowercase() } else { first };
    Some(format!("{first}{}", letters.as_str()))
}

/// Text below a heading of a rule documentation.
pub fn section_text<'a>(explanation: &'a str, heading: &str) -> Option<&'a str> {
    let mut at = 0;
    for line in explanation.split_inclusive('\n') {
        at += line.len();
        if line.trim().strip_prefix("# ") == Some(heading) {
            let rest = explanation.get(at..)?;
            let end = rest.find("\n # ").or_else(|| rest.find("\n# ")).unwrap_or(rest.len());
            return rest.get(..end);
        }
    }
    None
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_next_step_is_the_first_sentence() {
        let next = |text| next_step(text).unwrap_or_default();
        assert_eq!(next("\n Check the cable\n and 1.5 V. Then more.\n"), "check the cable and 1.5 V");
        assert_eq!(next(" SYNC first."), "SYNC first");
        assert_eq!(next_step("\n"), None);
    }
}
