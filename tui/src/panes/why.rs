//! Why: the stories of the diagnosis; each line leads to its frames.
//!
//! ```text
//!  MOST LIKELY    32/20  EMCY 8305 spool position error {104}   from 7.204 s for 3.2 s [emcy-raised]
//!    then         +2 ms  ACTIVE → FAULT HOLD although control word 0F commands ACTIVE {105}
//!  DO NOW         1 check: spool or actuator blocked, dirt in the oil
//!  NOT THE CAUSE  controller silent (RPDO1 every 100 ms); NMT state (operational)
//!  NOT JUDGED     wiring: no error frames, and the capture does not show whether they were recorded
//! ```

use cobscope_decoder::diagnosis::{Diagnosis, Label, StoryLine};
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
use crate::timeline::Survey;
use crate::widgets::text_lines::TextLines;

/// Width of the labels with the mark of the selection.
const LABELS: u16 = 16;

/// The stories of the diagnosis.
#[derive(Debug, Default)]
pub struct Why {
    /// Index of the selected line.
    selected: usize,
}

/// A line of the pane.
struct WhyLine {
    label: &'static str,
    text: String,
    role: Role,
    /// Frame of evidence.
    frame: Option<u64>,
}

impl WhyLine {
    fn plain(text: String, role: Role) -> Self {
        Self { label: "", text, role, frame: None }
    }

    fn of(line: &StoryLine) -> Self {
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
        Self { label, text: escape(&line.text).into_owned(), role, frame }
    }
}

/// Lines of all stories, of the notes, or the reason why there is none.
fn lines(survey: &Survey) -> Vec<WhyLine> {
    let (Some(diagnosis), Some(findings)) = (&survey.diagnosis, &survey.findings) else {
        return vec![WhyLine::plain("rules run; the diagnosis follows at the end …".into(), Role::Quiet)];
    };
    let count = diagnosis.stories.len();
    let mut lines = Vec::new();
    for (number, story) in (1..).zip(&diagnosis.stories) {
        if count > 1 {
            lines.push(WhyLine::plain(format!("story {number} of {count}"), Role::Title));
        }
        lines.extend(story.lines.iter().map(WhyLine::of));
    }
    if count == 0 {
        lines.push(WhyLine::plain(nothing(diagnosis, findings), Role::Good));
    }
    lines.extend(diagnosis.notes.iter().map(WhyLine::of));
    lines
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
        self.selected = self.at(lines).saturating_add_signed(delta).min(lines.len().saturating_sub(1));
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
            Action::Top => self.selected = 0,
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
            self.selected = at;
        }
        Vec::new()
    }

    fn legend(&self) -> &'static Legend {
        &legend::WHY
    }

    fn actions(&self) -> &'static [Action] {
        &[Action::Open, Action::Down, Action::NextFinding, Action::NextError, Action::Copy, Action::Back]
    }

    fn line(&self, core: &Core) -> Option<String> {
        let survey = core.timeline.survey();
        let lines = lines(&survey);
        let line = lines.get(self.at(&lines))?;
        Some(format!("{:14} {}", line.label, line.text).trim().to_owned())
    }
}
