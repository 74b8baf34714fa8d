//! Checks the rule names in profiles: waivers, `takes_in` and `follows`.

use crate::profile::TextError;
use crate::profile::device::ProfileFile;
use crate::query::fields::edit_distance;
use crate::rules::all_declarations;
use crate::rules::expectation::CompiledExpectation;
use crate::rules::ledger::causes::cause_table;

/// Number of suggestions for an unknown name.
const NEAREST: usize = 3;

/// Rule names in a profile that do not match any general rule, and invalid expressions of its expectations; `text` is the
/// source of `file`.
pub fn check_names(text: &str, file: &ProfileFile) -> Vec<TextError> {
    let is_known =
        |name: &str| cause_table().is_fact(name) || all_declarations().any(|rule| rule.name == name);
    let waived = file.waived_rules().map(|(name, span)| (name, span, "waiver"));
    let taken = file.taken_in().map(|(name, span)| (name, span, "takes_in or follows"));
    let unknown = waived.chain(taken).filter(|(name, ..)| !is_known(name));
    let wrong = unknown.map(|(name, span, key)| {
        let message = format!("unknown rule '{name}' in {key}; similar rules: {}", similar_rules(name));
        TextError::at_place(text, span, message)
    });
    let expressions = file.expectations().iter();
    wrong
        .chain(expressions.filter_map(|entry| CompiledExpectation::compile_entry(entry, text).err()))
        .collect()
}

/// Rules that share most words with `name`, then by edit distance.
fn similar_rules(name: &str) -> String {
    let words: Vec<&str> = name.split('-').collect();
    let common = |known: &str| known.split('-').filter(|word| words.contains(word)).count();
    let mut all: Vec<&str> = all_declarations().map(|rule| rule.name).collect();
    all.sort_by_key(|known| (usize::MAX - common(known), edit_distance(known, name), *known));
    all.truncate(NEAREST);
    all.join(", ")
}

#[cfg(test)]
mod tests {
    use super::*;

    fn errors(text: &str) -> Vec<String> {
        let text = format!("id = \"acme-pump\"\n{text}");
        let file = ProfileFile::parse(&text).unwrap();
        check_names(&text, &file)
            .iter()
            .map(|error| error.to_string().lines().next().unwrap().to_owned())
            .collect()
    }

    #[test]
    fn a_waiver_of_an_unknown_rule_is_reported_with_its_place() {
        let waiver = |rule: &str| errors(&format!("[[waiver]]\nrule = \"{rule}\"\ntext = \"t\"\n"));
        assert_eq!(waiver("boot-up-missing"), [""; 0]);
        let reported =
            "3:8: unknown rule 'sdo-short-frame' in waiver; similar rules: sdo-abort-code, pdo-short, ";
        let found = waiver("sdo-short-frame");
        assert!(found.len() == 1 && found[0].starts_with(reported), "{found:?}");
    }

    #[test]
    fn rules_take_in_their_own_and_general_ones() {
        let rule = |name: &str, takes: &str| {
            let kind = "severity = \"note\"\nkind = \"expedited\"\ntext = \"t\"";
            format!("[[rule]]\nname = \"{name}\"\n{kind}\ntakes_in = [\"{takes}\"]\n")
        };
        assert_eq!(errors(&format!("{}{}", rule("a", "b"), rule("b", "sdo-size"))), [""; 0]);
        let found = errors(&rule("a", "node-lots"));
        let reported = "2:1: unknown rule 'node-lots' in takes_in or follows; similar rules: node-lost, ";
        assert!(found.len() == 1 && found[0].starts_with(reported), "{found:?}");
    }
}
