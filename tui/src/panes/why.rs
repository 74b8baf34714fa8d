//! Why: the stories of the diagnosis; each line leads to its frames.
//!
//! ```text
//!  MOST LIKELY    32/20  EMCY 8305 spool position error {104}   from 7.204 s for 3.2 s [emcy-raised]
//!    then         +2 ms  ACTIVE → FAULT HOLD although control word 0F commands ACTIVE {105}
//!  DO NOW         1 check: spool or actuator blocked, dirt in the oil
//!  NOT THE CAUSE  controller silent (RPDO1 every 100 ms); NMT state (operational)
//!  NOT JUDGED     wiring: no error frames, and the capture does not show whether they were recorded
//! ```

use cobscope_decoder::diagnosis::{Diagnosis, LineLabel, StoryLine, story_count};
use cobscope_decoder::finding::{CaptureFindings, RuleOutcome};
use cobscope_decoder::sink::escape;
use cobscope_decoder::words::count_noun;
use ratatui::buffer::Buffer;
use ratatui::layout::Rect;
use ratatui::text::Line;

use super::common::LabelledLines;
use super::legend::{self, PaneLegend};
use super::{Pane, PaneRequest};
use crate::action::Action;
use crate::state::{JumpPlace, UiState};
use crate::theme::TextRole;
use crate::timeline::SurveyResults;
use crate::widgets::text_lines::TextLines;

/// Width of the labels with the mark of the selection.
const LABELS: u16 = 16;

/// The stories of the diagnosis.
#[derive(Debug, Default)]
pub struct WhyPane {
    /// Index of the selected line.
    selected: usize,
    /// The line that the user selected; stories so far may move it.
    kept: Option<DiagnosisLineKey>,
    /// Number of the diagnosis of the selection, and whether it was the last one.
    seen: (u64, bool),
}

/// Identity of a line in all diagnoses of a capture.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
struct DiagnosisLineKey {
    /// Id of the first finding of the story; 0 for a line outside the stories.
    story: u64,
    label: Option<LineLabel>,
    /// First frame of evidence.
    frame: u64,
    /// Number of earlier lines with the same story, label and frame.
    nth: usize,
}

/// A line of the pane.
struct WhyLine {
    label: &'static str,
    text: String,
    role: TextRole,
    /// Frame of evidence.
    frame: Option<u64>,
    key: DiagnosisLineKey,
}

impl WhyLine {
    fn plain_line(text: String, role: TextRole) -> Self {
        Self {
            label: "",
            text,
            role,
            frame: None,
            key: DiagnosisLineKey { story: 0, label: None, frame: 0, nth: 0 },
        }
    }

    fn line_of(line: &StoryLine, story: u64) -> Self {
        let role = match line.label {
            LineLabel::Cause | LineLabel::FirstEffect => TextRole::Bad,
            LineLabel::NoCause => TextRole::Caution,
            LineLabel::Note => TextRole::Note,
            LineLabel::Disproved | LineLabel::Unjudged | LineLabel::Manual => TextRole::Quiet,
            _ => TextRole::Text,
        };
        // A line without a label continues the one before; a blank keeps it below the text.
        let label = if line.label.label_word().is_empty() { " " } else { line.label.label_word() };
        let frame = Some(line.at.frames.last).filter(|frame| *frame > 0);
        let key = DiagnosisLineKey { story, label: Some(line.label), frame: line.at.frames.first, nth: 0 };
        Self { label, text: escape(&line.text).into_owned(), role, frame, key }
    }
}

/// Numbers lines with equal keys.
fn number_lines(lines: &mut [WhyLine]) {
    let mut known: Vec<(DiagnosisLineKey, usize)> = Vec::new();
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
fn place_of(key: DiagnosisLineKey, lines: &[WhyLine]) -> Option<usize> {
    let same = lines.iter().position(|line| line.key == key);
    same.or_else(|| lines.iter().rposition(|line| key.story > 0 && line.key.story == key.story))
}

/// Lines of all stories, of the notes, or the reason why there is none.
fn story_lines(survey: &SurveyResults) -> Vec<WhyLine> {
    let none = Diagnosis::default();
    let diagnosis = survey.diagnosis.as_ref().unwrap_or(&none);
    let count = diagnosis.stories.len();
    let mut lines = Vec::new();
    if !survey.is_complete {
        lines.push(WhyLine::plain_line(so_far(survey, count), TextRole::Quiet));
    }
    for (number, story) in (1..).zip(&diagnosis.stories) {
        let id = story.findings.first().copied().unwrap_or(0);
        if count > 1 {
            let key = DiagnosisLineKey { story: id, label: None, frame: 0, nth: 0 };
            let text = format!("story {number} of {count}");
            lines.push(WhyLine { key, ..WhyLine::plain_line(text, TextRole::Title) });
        }
        lines.extend(story.lines.iter().map(|line| WhyLine::line_of(line, id)));
    }
    if let Some(findings) = survey.findings.as_ref().filter(|_| count == 0 && survey.is_complete) {
        lines.push(WhyLine::plain_line(no_story_text(diagnosis, findings), TextRole::Good));
    }
    lines.extend(diagnosis.notes.iter().map(|note| WhyLine::line_of(&note.line, 0)));
    number_lines(&mut lines);
    lines
}

/// `2 stories so far, 1204 frames judged; rules still run`.
fn so_far(survey: &SurveyResults, count: usize) -> String {
    let found = if count == 0 { "no fault".to_owned() } else { story_count(count) };
    format!("{found} so far, {} judged; rules still run", count_noun(survey.frames, "frame"))
}

/// `no fault; 52 rules not exercised`.
fn no_story_text(diagnosis: &Diagnosis, findings: &CaptureFindings) -> String {
    let rules = findings.rules.iter().zip(&findings.tallies).filter(|(rule, _)| rule.is_on);
    let missing = rules.filter(|(_, tally)| tally.verdict() == RuleOutcome::NotExercised).count();
    let notes = match diagnosis.notes.len() {
        0 => String::new(),
        count => format!("; {}", count_noun(count, "note")),
    };
    format!("no fault in this capture{notes}; {} not exercised", count_noun(missing, "rule"))
}

impl WhyPane {
    fn selected_index(&self, lines: &[WhyLine]) -> usize {
        self.selected.min(lines.len().saturating_sub(1))
    }

    /// The lines for drawing, and the first screen row of each.
    fn drawn_lines(&self, core: &UiState, lines: &[WhyLine], width: u16) -> (LabelledLines, Vec<usize>) {
        let selected = self.selected_index(lines);
        let (mut drawn, mut starts, mut row) = (Vec::new(), Vec::new(), 0);
        for (index, line) in lines.iter().enumerate() {
            let mut style = core.theme.role_style(line.role);
            if index == selected {
                style = style.patch(core.theme.selection_style(true));
            }
            let text = Line::styled(line.text.clone(), style);
            let indent = if line.label.is_empty() { 0 } else { usize::from(LABELS) };
            let mut whole = text.clone();
            whole.spans.insert(0, " ".repeat(indent).into());
            starts.push(row);
            row += TextLines::new(&core.theme, std::slice::from_ref(&whole)).line_count(width);
            drawn.push((line.label, text));
        }
        (LabelledLines { room: LABELS, lines: drawn }, starts)
    }

    /// First visible row: the selected line is in the upper third.
    fn first_visible(&self, lines: &[WhyLine], starts: &[usize], height: u16) -> usize {
        let start = starts.get(self.selected_index(lines)).copied().unwrap_or(0);
        start.saturating_sub(usize::from(height) / 3)
    }

    fn step_selection(&mut self, lines: &[WhyLine], delta: isize) {
        self.select_line(lines, self.selected_index(lines).saturating_add_signed(delta));
    }

    fn select_line(&mut self, lines: &[WhyLine], index: usize) {
        self.selected = index.min(lines.len().saturating_sub(1));
        self.kept = lines.get(self.selected).map(|line| line.key);
    }

    /// Moves the selection to its line in a new diagnosis.
    fn keep_selection(&mut self, lines: &[WhyLine]) {
        if let Some(place) = self.kept.and_then(|key| place_of(key, lines)) {
            self.selected = place;
        }
    }

    /// Goes to the frames of the selected line.
    fn open_frames(&self, core: &UiState) -> Vec<PaneRequest> {
        let survey = core.timeline.survey();
        let lines = story_lines(&survey);
        match lines.get(self.selected_index(&lines)).map(|line| (line.frame, line.text.clone())) {
            Some((Some(frame), text)) => {
                vec![
                    PaneRequest::Go(JumpPlace::Frame(frame)),
                    PaneRequest::Say(text),
                    PaneRequest::ShowEvents,
                ]
            }
            _ => vec![PaneRequest::Refuse("this line has no frames".into())],
        }
    }
}

impl Pane for WhyPane {
    fn render_pane(&self, core: &UiState, area: Rect, buf: &mut Buffer) {
        let survey = core.timeline.survey();
        let lines = story_lines(&survey);
        let (drawn, starts) = self.drawn_lines(core, &lines, area.width.saturating_sub(1));
        drawn.render(&core.theme, self.first_visible(&lines, &starts, area.height), area, buf);
    }

    fn refresh_state(&mut self, core: &UiState) {
        let survey = core.timeline.survey();
        let present = (survey.revision, survey.is_complete);
        if std::mem::replace(&mut self.seen, present) != present {
            self.keep_selection(&story_lines(&survey));
        }
    }

    fn on_action(&mut self, action: Action, core: &UiState) -> Vec<PaneRequest> {
        let survey = core.timeline.survey();
        let lines = story_lines(&survey);
        drop(survey);
        let page = isize::try_from(core.height / 2).unwrap_or(1).max(1);
        match action {
            Action::Down => self.step_selection(&lines, 1),
            Action::Up => self.step_selection(&lines, -1),
            Action::PageDown => self.step_selection(&lines, page),
            Action::PageUp => self.step_selection(&lines, -page),
            Action::Top => self.select_line(&lines, 0),
            Action::Bottom => self.step_selection(&lines, isize::MAX),
            Action::Open | Action::Toggle => return self.open_frames(core),
            _ => {}
        }
        Vec::new()
    }

    fn on_click(&mut self, _x: u16, y: u16, area: Rect, core: &UiState) -> Vec<PaneRequest> {
        let survey = core.timeline.survey();
        let lines = story_lines(&survey);
        let (drawn, starts) = self.drawn_lines(core, &lines, area.width.saturating_sub(1));
        let scroll =
            self.first_visible(&lines, &starts, area.height).min(drawn.last_scroll(&core.theme, area));
        let row = scroll.saturating_add(usize::from(y.saturating_sub(area.y)));
        if let Some(at) = starts.partition_point(|start| *start <= row).checked_sub(1) {
            self.select_line(&lines, at);
        }
        Vec::new()
    }

    fn pane_legend(&self) -> &'static PaneLegend {
        &legend::WHY
    }

    fn performed_actions(&self) -> &'static [Action] {
        &[Action::Toggle]
    }

    fn key_bar_actions(&self) -> &'static [Action] {
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

    fn selected_finding(&self, core: &UiState) -> Option<u64> {
        let survey = core.timeline.survey();
        let lines = story_lines(&survey);
        lines.get(self.selected_index(&lines)).map(|line| line.key.story).filter(|id| *id > 0)
    }

    fn selected_line(&self, core: &UiState) -> Option<String> {
        let survey = core.timeline.survey();
        let lines = story_lines(&survey);
        let line = lines.get(self.selected_index(&lines))?;
        Some(format!("{:14} {}", line.label, line.text).trim().to_owned())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A line of a story at a frame.
    fn line(story: u64, label: LineLabel, frame: u64) -> WhyLine {
        let key = DiagnosisLineKey { story, label: Some(label), frame, nth: 0 };
        WhyLine { key, ..WhyLine::plain_line(format!("{story} {frame}"), TextRole::Text) }
    }

    fn numbered(mut lines: Vec<WhyLine>) -> Vec<WhyLine> {
        number_lines(&mut lines);
        lines
    }

    #[test]
    fn the_selection_stays_on_its_line() {
        let before = numbered(vec![
            line(1, LineLabel::Cause, 10),
            line(1, LineLabel::Effect, 12),
            line(1, LineLabel::More, 0),
            line(1, LineLabel::More, 0),
        ]);
        let after = || {
            let mut after = vec![
                line(7, LineLabel::Cause, 30),
                line(7, LineLabel::Act, 0),
                line(1, LineLabel::Cause, 10),
            ];
            after.extend([line(1, LineLabel::Effect, 11), line(1, LineLabel::Effect, 12)]);
            after.extend([
                line(1, LineLabel::More, 0),
                line(1, LineLabel::More, 0),
                line(1, LineLabel::Act, 0),
            ]);
            numbered(after)
        };
        let mut why = WhyPane::default();
        why.keep_selection(&after());
        assert_eq!(why.selected, 0, "without a choice of the user the first story is selected");
        for (chosen, expected) in [(1, 4), (2, 5), (3, 6)] {
            why.select_line(&before, chosen);
            why.keep_selection(&after());
            assert_eq!(why.selected, expected, "{chosen}");
        }
        // Its line is gone, its story remains.
        why.select_line(&before, 1);
        why.keep_selection(&numbered(vec![line(7, LineLabel::Cause, 30), line(1, LineLabel::Cause, 10)]));
        assert_eq!(why.selected, 1);
    }
}
