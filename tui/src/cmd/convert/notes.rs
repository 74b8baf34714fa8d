//! Notes on several captures, each printed once.

use std::collections::BTreeSet;

use crate::run::messages::print_note;

/// Texts with the captures to which they apply, in order of appearance.
#[derive(Default)]
pub(super) struct CaptureNotes(Vec<(String, BTreeSet<usize>)>);

impl CaptureNotes {
    /// Adds a note on a capture.
    pub(super) fn add_note(&mut self, text: &str, capture: usize) {
        match self.0.iter_mut().find(|(known, _)| known == text) {
            Some((_, of)) => _ = of.insert(capture),
            None => self.0.push((text.to_owned(), BTreeSet::from([capture]))),
        }
    }

    /// Prints all notes.
    pub(super) fn print_all(&self, names: &[String]) {
        for (text, of) in &self.0 {
            print_note(&format!("{}: {text}", common_name(names, of)));
        }
    }
}

/// Common name for some of the captures.
pub(super) fn common_name(names: &[String], of: &BTreeSet<usize>) -> String {
    let first = of.first().and_then(|first| names.get(*first)).map_or("", String::as_str);
    match (of.len(), names.len()) {
        (1, _) => first.to_owned(),
        (some, all) if some == all => format!("all {all} captures"),
        (some, all) => format!("{some} of {all} captures, first {first}"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn captures_are_named_unless_all_are_meant() {
        let names = ["a.log", "b.log", "c.log"].map(str::to_owned);
        assert_eq!(common_name(&names, &BTreeSet::from([1])), "b.log");
        assert_eq!(common_name(&names, &BTreeSet::from([1, 2])), "2 of 3 captures, first b.log");
        assert_eq!(common_name(&names, &BTreeSet::from([0, 1, 2])), "all 3 captures");
        assert_eq!(common_name(&names[..1], &BTreeSet::from([0])), "a.log");
    }
}
