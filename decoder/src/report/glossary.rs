//! Meaning of the marks in reports: `glossary.toml`.

use std::sync::OnceLock;

use serde::Deserialize;

/// A mark with its meaning.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct GlossaryMark {
    /// The mark, or an example of it.
    pub(super) mark: String,
    /// Meaning as sentences.
    pub(super) meaning: String,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct GlossaryFile {
    mark: Vec<GlossaryMark>,
}

/// All marks, parsed once.
pub(super) fn glossary_marks() -> &'static [GlossaryMark] {
    static MARKS: OnceLock<Vec<GlossaryMark>> = OnceLock::new();
    // A unit test checks that the file is valid; an invalid file would yield an empty table.
    MARKS.get_or_init(|| {
        toml::from_str::<GlossaryFile>(include_str!("glossary.toml"))
            .map_or_else(|_| Vec::new(), |it| it.mark)
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::diagnosis::LineLabel;

    #[test]
    fn every_label_of_a_story_is_explained() {
        toml::from_str::<GlossaryFile>(include_str!("glossary.toml")).unwrap();
        let texts = glossary_marks().iter().flat_map(|it| [it.mark.as_str(), it.meaning.as_str()]);
        let text = texts.collect::<Vec<_>>().join("\n");
        let labels = [
            LineLabel::Cause,
            LineLabel::NoCause,
            LineLabel::FirstEffect,
            LineLabel::Effect,
            LineLabel::EarlierEffect,
            LineLabel::Act,
        ];
        for label in labels.into_iter().chain([LineLabel::Disproved, LineLabel::Unjudged]) {
            assert!(text.contains(label.label_word().trim()), "{label:?}");
        }
    }
}
