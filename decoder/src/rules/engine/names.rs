//! Rules that profiles name: waivers, and what their rules take in.

use crate::profile::TextError;
use crate::profile::device::ProfileFile;
use crate::query::fields::distance;
use crate::rules::declarations;

/// Names that are told for one that does not exist.
const NEAREST: usize = 3;

/// Names in a profile, read from `text`, that no general rule has.
pub fn check_names(text: &str, file: &ProfileFile) -> Vec<TextError> {
    let is_known = |name: &str| declarations().any(|rule| rule.name == name);
    let waived = file.waived().map(|(name, span)| (name, span, "waived"));
    let taken = file.taken_in().map(|(name, span)| (name, span, "taken in"));
    let unknown = waived.chain(taken).filter(|(name, ..)| !is_known(name));
    let wrong = unknown.map(|(name, span, how)| {
        let message =
            format!("there is no rule '{name}' that could be {how}; the nearest are {}", near(name));
        TextError::at(text, span, message)
    });
    wrong.collect()
}

/// Rules with most words in common, then those with fewest letters to change.
fn near(name: &str) -> String {
    let words: Vec<&str> = name.split('-').collect();
    let common = |known: &str| known.split('-').filter(|word| words.contains(word)).count();
    let mut all: Vec<&str> = declarations().map(|rule| rule.name).collect();
    all.sort_by_key(|known| (usize::MAX - common(known), distance(known, name), *known));
    all.truncate(NEAREST);
    all.join(", ")
}

#[cfg(test)]
mod tests {
    use super::*;

    fn said(text: &str) -> Vec<String> {
        let text = format!("id = \"acme-pump\"\n{text}");
        let file = ProfileFile::parse(&text).unwrap();
        check_names(&text, &file)
            .iter()
            .map(|error| error.to_string().lines().next().unwrap().to_owned())
            .collect()
    }

    #[test]
    fn a_waiver_of_a_rule_there_is_not_is_told_with_its_place() {
        let waiver = |rule: &str| said(&format!("[[waiver]]\nrule = \"{rule}\"\ntext = \"t\"\n"));
        assert_eq!(waiver("boot-up-missing"), [""; 0]);
        let told = "3:8: there is no rule 'sdo-short-frame' that could be waived; the nearest are \
                    sdo-abort-code, pdo-short, ";
        let found = waiver("sdo-short-frame");
        assert!(found.len() == 1 && found[0].starts_with(told), "{found:?}");
    }

    #[test]
    fn rules_take_in_their_own_and_general_ones() {
        let rule = |name: &str, takes: &str| {
            let kind = "severity = \"note\"\nkind = \"expedited\"\ntext = \"t\"";
            format!("[[rule]]\nname = \"{name}\"\n{kind}\ntakes_in = [\"{takes}\"]\n")
        };
        assert_eq!(said(&format!("{}{}", rule("a", "b"), rule("b", "sdo-size"))), [""; 0]);
        let found = said(&rule("a", "node-lots"));
        let told = "2:1: there is no rule 'node-lots' that could be taken in; the nearest are node-lost, ";
        assert!(found.len() == 1 && found[0].starts_with(told), "{found:?}");
    }
}
