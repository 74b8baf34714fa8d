//! Why: the stories of the diagnosis; each line leads to its frames.
//!
//! ```text
//!  MOST LIKELY    32/20  EMCY 8305 spool position error {104}   from 7.204 s for 3.2 s [emcy-raised]
//!    then         +2 ms  ACTIVE → FAULT HOLD although control word 0F commands ACTIVE {105}
//!  DO NOW         1 check: spool or actuator blocked, dirt in the oil
//!  NOT THE CAUSE  controller silent (RPDO1 every 100 ms); NMT state (operational)
//!  NOT JUDGED     wiring: no error frames, and the capture does not show whether they were recorded
//! ```

use cobscope_decoder::diagnosis::{Diagnosis, Label, StoryLine, stories};
use cobscope_decoder::finding::{Findings, Verdict};
use cobscope_decoder::sink::escape;
use cobscope_decoder::words::plural;
use ratatui::buffer::Buffer;
use ratatui::layout::Rect;
use ratatui::text::Line;

use super::common::LabelledLines;
use super::legend::{self, Legend};
use super::{Effect, Pane};
use crate::action::Action;
use crate::state::{Core, JumpPlace};
use crate::theme::Role;
use crate::timeline::SurveyResults;
use crate::widgets::text_lines::TextLines;

/// Width of the labels with the mark of the selection.
const LABELS: u16 = 16;

/// The stories of the diagnosis.
#[derive(Debug, Default)]
pub struct Why {
    /// Index of the selected line.
    selected: usize,
    /// The line that the user selected; stories so far may move it.
    kept: Option<LineKey>,
    /// Number of the diagnosis of the selection, and whether it was the last one.
    seen: (u64, bool),
}

/// Identity of a line in all diagnoses of a capture.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
struct LineKey {
    /// Id of the first finding of the story; 0 for a line outside the stories.
    story: u64,
    label: Option<Label>,
    /// First frame of evidence.
    frame: u64,
    /// Number of earlier lines with the same story, label and frame.
    nth: usize,
}

/// A line of the pane.
struct WhyLine {
    label: &'static str,
    text: String,
    role: Role,
    /// Frame of evidence.
    frame: Option<u64>,
    key: LineKey,
}

impl WhyLine {
    fn plain(text: String, role: Role) -> Self {
        Self { label: "", text, role, frame: None, key: LineKey { story: 0, label: None, frame: 0, nth: 0 } }
    }

    fn of(line: &StoryLine, story: u64) -> Self {
        let role = match line.label {
            Label::Cause | Label::FirstEffect => Role::Bad,
            Label::NoCause => Role::Caution,
            Label::Note => Role::Note,
            Label::Disproved | Label::Unjudged | Label::Manual => Role::Quiet,
            _ => Role::Text,
        };
        // A line without a label continues the one before; a blank keeps it below the text.
        let label = if line.label.word().is_empty() { " " } else { line.label.word() };
        let frame = Some(line.at.frames.last).filter(|frame| *frame > 0);
        let key = LineKey { story, label: Some(line.label), frame: line.at.frames.first, nth: 0 };
        Self { label, text: escape(&line.text).into_owned(), role, frame, key }
    }
}

/// Numbers lines with equal keys.
fn number(lines: &mut [WhyLine]) {
    let mut known: Vec<(LineKey, usize)> = Vec::new();
    for line in lines {
        if let Some((_, count)) = known.iter_mut().find(|(key, _)| *key == line.key) {
            line.key.nth = *count;
            *count += 1;
        } else {
            known.push((line.key, 1));
        }
    }
}

/// Index of a line in other lines; else of the last line of its story.
fn place_of(key: LineKey, lines: &[WhyLine]) -> Option<usize> {
    let same = lines.iter().position(|line| line.key == key);
    same.or_else(|| lines.iter().rposition(|line| key.story > 0 && line.key.story == key.story))
}

/// Lines of all stories, of the notes, or the reason why there is none.
fn lines(survey: &SurveyResults) -> Vec<WhyLine> {
    let none = Diagnosis::default();
    let diagnosis = survey.diagnosis.as_ref().unwrap_or(&none);
    let count = diagnosis.stories.len();
    let mut lines = Vec::new();
    if !survey.is_complete {
        lines.push(WhyLine::plain(so_far(survey, count), Role::Quiet));
    }
    for (number, story) in (1..).zip(&diagnosis.stories) {
        let id = story.findings.first().copied().unwrap_or(0);
        if count > 1 {
            let key = LineKey { story: id, label: None, frame: 0, nth: 0 };
            let text = format!("story {number} of {count}");
            lines.push(WhyLine { key, ..WhyLine::plain(text, Role::Title) });
        }
        lines.extend(story.lines.iter().map(|line| WhyLine::of(line, id)));
    }
    if let Some(findings) = survey.findings.as_ref().filter(|_| count == 0 && survey.is_complete) {
        lines.push(WhyLine::plain(nothing(diagnosis, findings), Role::Good));
    }
    lines.extend(diagnosis.notes.iter().map(|note| WhyLine::of(&note.line, 0)));
    number(&mut lines);
    lines
}

/// `2 stories so far, 1204 frames judged; rules still run`.
fn so_far(survey: &SurveyResults, count: usize) -> String {
    let found = if count == 0 { "no fault".to_owned() } else { stories(count) };
    format!("{found} so far, {} judged; rules still run", plural(survey.frames, "frame"))
}

/// `no fault; 52 rules not exercised`.
fn nothing(diagnosis: &Diagnosis, findings: &Findings) -> String {
    let rules = findings.rules.iter().zip(&findings.tallies).filter(|(rule, _)| rule.is_on);
    let missing = rules.filter(|(_, tally)| tally.verdict() == Verdict::NotExercised).count();
    let notes = match diagnosis.notes.len() {
        0 => String::new(),
        count => format!("; {}", plural(count, "note")),
    };
    format!("no fault in this capture{notes}; {} not exercised", plural(missing, "rule"))
}

impl Why {
    fn at(&self, lines: &[WhyLine]) -> usize {
        self.selected.min(lines.len().saturating_sub(1))
    }

    /// The lines for drawing, and the first screen row of each.
    fn drawn(&self, core: &Core, lines: &[WhyLine], width: u16) -> (LabelledLines, Vec<usize>) {
        let selected = self.at(lines);
        let (mut drawn, mut starts, mut row) = (Vec::new(), Vec::new(), 0);
        for (index, line) in lines.iter().enumerate() {
            let mut style = core.theme.style(line.role);
            if index == selected {
                style = style.patch(core.theme.selection(true));
            }
            let text = Line::styled(line.text.clone(), style);
            let indent = if line.label.is_empty() { 0 } else { usize::from(LABELS) };
            let mut whole = text.clone();
            whole.spans.insert(0, " ".repeat(indent).into());
            starts.push(row);
            row += TextLines::new(&core.theme, std::slice::from_ref(&whole)).total(width);
            drawn.push((line.label, text));
        }
        (LabelledLines { room: LABELS, lines: drawn }, starts)
    }

    /// First visible row: the selected line is in the upper third.
    fn scroll(&self, lines: &[WhyLine], starts: &[usize], height: u16) -> usize {
        let start = starts.get(self.at(lines)).copied().unwrap_or(0);
        start.saturating_sub(usize::from(height) / 3)
    }

    fn step(&mut self, lines: &[WhyLine], delta: isize) {
        self.select(lines, self.at(lines).saturating_add_signed(delta));
    }

    fn select(&mut self, lines: &[WhyLine], index: usize) {
        self.selected = index.min(lines.len().saturating_sub(1));
        self.kept = lines.get(self.selected).map(|line| line.key);
    }

    /// Moves the selection to its line in a new diagnosis.
    fn keep(&mut self, lines: &[WhyLine]) {
        if let Some(place) = self.kept.and_then(|key| place_of(key, lines)) {
            self.selected = place;
        }
    }

    /// Goes to the frames of the selected line.
    fn open(&self, core: &Core) -> Vec<Effect> {
        let survey = core.timeline.survey();
        let lines = lines(&survey);
        match lines.get(self.at(&lines)).map(|line| (line.frame, line.text.clone())) {
            Some((Some(frame), text)) => {
                vec![Effect::Go(JumpPlace::Frame(frame)), Effect::Say(text), Effect::ShowEvents]
            }
            _ => vec![Effect::Refuse("this line has no frames".into())],
        }
    }
}

impl Pane for Why {
    fn render(&self, core: &Core, area: Rect, buf: &mut Buffer) {
        let survey = core.timeline.survey();
        let lines = lines(&survey);
        let (drawn, starts) = self.drawn(core, &lines, area.width.saturating_sub(1));
        drawn.render(&core.theme, self.scroll(&lines, &starts, area.height), area, buf);
    }

    fn refresh(&mut self, core: &Core) {
        let survey = core.timeline.survey();
        let present = (survey.revision, survey.is_complete);
        if std::mem::replace(&mut self.seen, present) != present {
            self.keep(&lines(&survey));
        }
    }

    fn act(&mut self, action: Action, core: &Core) -> Vec<Effect> {
        let survey = core.timeline.survey();
        let lines = lines(&survey);
        drop(survey);
        let page = isize::try_from(core.height / 2).unwrap_or(1).max(1);
        match action {
            Action::Down => self.step(&lines, 1),
            Action::Up => self.step(&lines, -1),
            Action::PageDown => self.step(&lines, page),
            Action::PageUp => self.step(&lines, -page),
            Action::Top => self.select(&lines, 0),
            Action::Bottom => self.step(&lines, isize::MAX),
            Action::Open | Action::Toggle => return self.open(core),
            _ => {}
        }
        Vec::new()
    }

    fn click(&mut self, _x: u16, y: u16, area: Rect, core: &Core) -> Vec<Effect> {
        let survey = core.timeline.survey();
        let lines = lines(&survey);
        let (drawn, starts) = self.drawn(core, &lines, area.width.saturating_sub(1));
        let scroll = self.scroll(&lines, &starts, area.height).min(drawn.last_scroll(&core.theme, area));
        let row = scroll.saturating_add(usize::from(y.saturating_sub(area.y)));
        if let Some(at) = starts.partition_point(|start| *start <= row).checked_sub(1) {
            self.select(&lines, at);
        }
        Vec::new()
    }

    fn legend(&self) -> &'static Legend {
        &legend::WHY
    }

    fn performs(&self) -> &'static [Action] {
        &[Action::Toggle]
    }

    fn actions(&self) -> &'static [Action] {
        &[
            Action::Open,
            Action::Down,
            Action::NextFinding,
            Action::NextError,
            Action::Report,
            Action::Copy,
            Action::Back,
        ]
    }

    fn finding(&self, core: &Core) -> Option<u64> {
        let survey = core.timeline.survey();
        let lines = lines(&survey);
        lines.get(self.at(&lines)).map(|line| line.key.story).filter(|id| *id > 0)
    }

    fn line(&self, core: &Core) -> Option<String> {
        let survey = core.timeline.survey();
        let lines = lines(&survey);
        let line = lines.get(self.at(&lines))?;
        Some(format!("{:14} {}", line.label, line.text).trim().to_owned())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A line of a story at a frame.
    fn line(story: u64, label: Label, frame: u64) -> WhyLine {
        let key = LineKey { story, label: Some(label), frame, nth: 0 };
        WhyLine { key, ..WhyLine::plain(format!("{story} {frame}"), Role::Text) }
    }

    fn numbered(mut lines: Vec<WhyLine>) -> Vec<WhyLine> {
        number(&mut lines);
        lines
    }

    #[test]
    fn the_selection_stays_on_its_line() {
        let before = numbered(vec![
            line(1, Label::Cause, 10),
            line(1, Label::Effect, 12),
            line(1, Label::More, 0),
            line(1, Label::More, 0),
        ]);
        let after = || {
            let mut after =
                vec![line(7, Label::Cause, 30), line(7, Label::Act, 0), line(1, Label::Cause, 10)];
            after.extend([line(1, Label::Effect, 11), line(1, Label::Effect, 12)]);
            after.extend([line(1, Label::More, 0), line(1, Label::More, 0), line(1, Label::Act, 0)]);
            numbered(after)
        };
        let mut why = Why::default();
        why.keep(&after());
        assert_eq!(why.selected, 0, "without a choice of the user the first story is selected");
        for (chosen, expected) in [(1, 4), (2, 5), (3, 6)] {
            why.select(&before, chosen);
            why.keep(&after());
            assert_eq!(why.selected, expected, "{chosen}");
        }
        // Its line is gone, its story remains.
        why.select(&before, 1);
        why.keep(&numbered(vec![line(7, Label::Cause, 30), line(1, Label::Cause, 10)]));
        assert_eq!(why.selected, 1);
    }
}
