//! Meaning of the marks in reports: `glossary.toml`.

use std::sync::OnceLock;

use serde::Deserialize;

/// A mark with its meaning.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Mark {
    /// The mark, or an example of it.
    pub(super) mark: String,
    /// Meaning as sentences.
    pub(super) meaning: String,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct GlossaryFile {
    mark: Vec<Mark>,
}

/// All marks, parsed once.
pub(super) fn marks() -> &'static [Mark] {
    static MARKS: OnceLock<Vec<Mark>> = OnceLock::new();
    // A unit test checks that the file is valid; an invalid file would yield an empty table.
    MARKS.get_or_init(|| {
        toml::from_str::<GlossaryFile>(include_str!("glossary.toml"))
            .map_or_else(|_| Vec::new(), |it| it.mark)
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::diagnosis::Label;

    #[test]
    fn every_label_of_a_story_is_explained() {
        toml::from_str::<GlossaryFile>(include_str!("glossary.toml")).unwrap();
        let texts = marks().iter().flat_map(|it| [it.mark.as_str(), it.meaning.as_str()]);
        let text = texts.collect::<Vec<_>>().join("\n");
        let labels = [
            Label::Cause,
            Label::NoCause,
            Label::FirstEffect,
            Label::Effect,
            Label::EarlierEffect,
            Label::Act,
        ];
        for label in labels.into_iter().chain([Label::Disproved, Label::Unjudged]) {
            assert!(text.contains(label.word().trim()), "{label:?}");
        }
    }
}
