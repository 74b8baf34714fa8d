//! Report pages of findings and stories.

use cobscope_decoder::finding::Severity;

use super::application::{App, InputMode, PromptPurpose};
use super::ask::capture_stem;
use super::shown_panes::ShownPanes;
use crate::state::UiState;

/// Maximum length of the rule in a proposed file name, in characters.
const LONGEST_RULE: usize = 40;

impl App {
    /// Opens the prompt for the file of the page of the selected finding or story.
    pub(super) fn ask_report(&mut self) {
        if self.core.timeline.live().is_some() {
            return self.core.show_refusal("a report needs a file; open the recorded capture with view");
        }
        let Some(finding) = chosen_finding(&self.panes, &self.core) else {
            return self
                .core
                .show_refusal("no finding selected: select one in Findings or Why, or go to one with ]");
        };
        if let Some(reason) = without_story(&self.core, finding) {
            return self
                .core
                .show_refusal(&format!("finding {finding}: {reason}, in no story; a report needs a story"));
        }
        self.reports.finding = Some(finding);
        let name = report_name(&self.core, finding);
        self.open_prompt(PromptPurpose::Report, "report to");
        if let InputMode::Prompt(_, prompt) = &mut self.mode {
            prompt.propose_text(&name);
        }
        self.refresh_prompt_row();
    }
}

/// Finding of the selected row, else the one at the cursor; of several the first that is not a note.
fn chosen_finding(panes: &ShownPanes, core: &UiState) -> Option<u64> {
    let of_row = panes.focused_pane().and_then(|pane| pane.selected_finding(core));
    of_row.or_else(|| {
        let frame = core.cursor.frame;
        let survey = core.timeline.survey();
        let here: Vec<_> = survey.places.iter().filter(|place| place.frame == frame).collect();
        let main = here.iter().find(|place| place.severity > Severity::Note).or(here.first());
        main.map(|place| place.id)
    })
}

/// Reason why no story contains a finding; None if one does, or as long as it is not known.
fn without_story(core: &UiState, finding: u64) -> Option<&'static str> {
    let survey = core.timeline.survey();
    let group = survey.findings.as_ref()?.group_by_id(finding)?;
    let stories = &survey.diagnosis.as_ref()?.stories;
    let is_reported = stories.iter().any(|story| story.findings.contains(&finding));
    group.omission().filter(|_| !is_reported)
}

/// Proposed name: capture, rule and number of the finding.
fn report_name(core: &UiState, finding: u64) -> String {
    let survey = core.timeline.survey();
    let rule = survey.overview.opened.iter().find(|opened| opened.news.id == finding);
    let is_plain = |letter: char| letter.is_ascii_alphanumeric() || matches!(letter, '-' | '_');
    let rule: String = rule.map_or(String::new(), |opened| {
        let letters = opened.news.rule.chars().map(|it| if is_plain(it) { it } else { '-' });
        format!("-{}", letters.take(LONGEST_RULE).collect::<String>())
    });
    format!("{}{rule}-{finding}.html", capture_stem(core))
}
