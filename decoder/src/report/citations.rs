//! Frames that a story cites, and the facts that they show.

use std::collections::BTreeMap;

use super::model::ClaimLine;
use crate::diagnosis::{LineLabel, Story};
use crate::finding::{CaptureFindings, FindingCause, FindingGroup, Occurrence};

/// Maximum number of frames listed per claim.
pub(super) const MOST_CITED: usize = 40;

/// Maximum number of frames read from braces in one text.
const MOST_IN_TEXT: usize = 12;

/// Frames that a claim cites, each with the numbers of the facts that it shows.
#[derive(Debug, Clone, Default)]
pub(super) struct Citations {
    frames: BTreeMap<u64, Vec<usize>>,
    /// Number of frames above the limit.
    pub(super) omitted: usize,
}

impl Citations {
    /// Frames of the lines of a story and of its findings. Frames of lines take precedence.
    pub(super) fn citations_of(story: &Story, lines: &[ClaimLine], findings: &CaptureFindings) -> Self {
        let mut cited = Self::default();
        for (line, fact) in story.lines.iter().zip(lines) {
            cited.add_frames(line.at, fact.mark);
            for frame in in_braces(&line.text) {
                cited.add_frame(frame, fact.mark);
            }
        }
        let groups = story.findings.iter().filter_map(|id| findings.groups.iter().find(|it| it.id == *id));
        for group in groups {
            cited.add_group(group);
        }
        cited
    }

    fn add_group(&mut self, group: &FindingGroup) {
        if let Some(FindingCause::Fact(fact)) = &group.cause {
            self.add_frames(fact.at, None);
        }
        let worst = group.worst.as_ref().map(|(_, _, at)| *at);
        for at in group.first.iter().copied().chain(worst).chain(group.last.iter().copied()) {
            self.add_frames(at, None);
        }
    }

    fn add_frames(&mut self, at: Occurrence, mark: Option<usize>) {
        self.add_frame(at.frames.first, mark);
        self.add_frame(at.frames.last, mark);
    }

    fn add_frame(&mut self, frame: u64, mark: Option<usize>) {
        if frame == 0 {
            return;
        }
        if self.frames.len() >= MOST_CITED && !self.frames.contains_key(&frame) {
            self.omitted = self.omitted.saturating_add(1);
            return;
        }
        let marks = self.frames.entry(frame).or_default();
        if let Some(mark) = mark.filter(|mark| !marks.contains(mark)) {
            marks.push(mark);
        }
    }

    /// Whether a frame is cited.
    pub(super) fn contains(&self, frame: u64) -> bool {
        self.frames.contains_key(&frame)
    }

    /// Cited frames in order.
    pub(super) fn iter(&self) -> impl Iterator<Item = (u64, &[usize])> {
        self.frames.iter().map(|(frame, marks)| (*frame, marks.as_slice()))
    }
}

/// Lines of a story with the numbers of its facts.
pub(super) fn number_lines(story: &Story) -> Vec<ClaimLine> {
    let mut last = 0;
    let numbered = |line: &crate::diagnosis::StoryLine| {
        let is_fact = matches!(
            line.label,
            LineLabel::Cause | LineLabel::FirstEffect | LineLabel::Effect | LineLabel::EarlierEffect
        ) && line.at.frames.last > 0;
        last += usize::from(is_fact);
        ClaimLine { mark: is_fact.then_some(last), label: line.label, text: line.text.clone() }
    };
    story.lines.iter().map(numbered).collect()
}

/// Frame numbers in the braces of a text: `{104}`, `{36 38 40}`, `{12-13}`.
pub(super) fn in_braces(text: &str) -> Vec<u64> {
    let inside = text.split('{').skip(1).filter_map(|part| part.split_once('}'));
    let numbers = inside.flat_map(|(inside, _)| inside.split([' ', '-', ',']));
    numbers.filter_map(|number| number.parse().ok()).take(MOST_IN_TEXT).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn frames_in_braces() {
        assert_eq!(in_braces("a {104}, 3 × control in 200 ms {36 38 40} {12-13}"), [104, 36, 38, 40, 12, 13]);
        assert!(in_braces("no frame {x} {99999999999999999999} {").is_empty());
    }

    #[test]
    fn frames_above_the_limit_are_counted() {
        let mut cited = Citations::default();
        for frame in 0..=45 {
            cited.add_frame(frame, Some(1));
        }
        cited.add_frame(3, Some(2));
        assert_eq!((cited.frames.len(), cited.omitted), (MOST_CITED, 5));
        assert!(cited.contains(40) && !cited.contains(41) && !cited.contains(0));
        assert_eq!(cited.iter().nth(2), Some((3, &[1, 2][..])));
    }
}
