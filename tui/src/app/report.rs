//! Report pages of findings and stories.

use std::path::Path;

use cobscope_decoder::finding::Severity;

use super::application::{App, InputMode, PromptPurpose};
use super::requests::ReportRequest;

/// Suffixes of the page, which select its format.
const SUFFIXES: [&str; 2] = ["html", "md"];

/// Maximum length of the rule in a proposed file name, in characters.
const LONGEST_RULE: usize = 40;

/// Whether the suffix of a file selects the format of a page.
pub(super) fn has_format(path: &Path) -> bool {
    path.extension().is_some_and(|suffix| SUFFIXES.iter().any(|known| suffix.eq_ignore_ascii_case(known)))
}

impl App {
    /// Opens the prompt for the file of the page of the selected finding or story.
    pub(super) fn ask_report(&mut self) {
        if self.core.timeline.live().is_some() {
            return self.core.show_refusal("a report needs a file; open the recorded capture with view");
        }
        let Some(finding) = self.chosen_finding() else {
            return self
                .core
                .show_refusal("no finding selected: select one in Findings or Why, or go to one with ]");
        };
        if let Some(reason) = self.without_story(finding) {
            return self
                .core
                .show_refusal(&format!("finding {finding}: {reason}, in no story; a report needs a story"));
        }
        self.reporting = Some(finding);
        let name = self.report_name(finding);
        self.open_prompt(PromptPurpose::Report, "report to");
        if let InputMode::Prompt(_, prompt) = &mut self.mode {
            prompt.propose_text(&name);
        }
        self.refresh_prompt_row();
    }

    /// Finding of the selected row, else the one at the cursor; of several the first that is not a note.
    fn chosen_finding(&self) -> Option<u64> {
        let of_row = self.panes.get(self.pane).and_then(|pane| pane.selected_finding(&self.core));
        of_row.or_else(|| {
            let frame = self.core.cursor.frame;
            let survey = self.core.timeline.survey();
            let here: Vec<_> = survey.places.iter().filter(|place| place.frame == frame).collect();
            let main = here.iter().find(|place| place.severity > Severity::Note).or(here.first());
            main.map(|place| place.id)
        })
    }

    /// Reason why no story contains a finding; None if one does, or as long as it is not known.
    fn without_story(&self, finding: u64) -> Option<&'static str> {
        let survey = self.core.timeline.survey();
        let group = survey.findings.as_ref()?.group_by_id(finding)?;
        let stories = &survey.diagnosis.as_ref()?.stories;
        let is_reported = stories.iter().any(|story| story.findings.contains(&finding));
        group.omission().filter(|_| !is_reported)
    }

    /// Proposed name: capture, rule and number of the finding.
    fn report_name(&self, finding: u64) -> String {
        let survey = self.core.timeline.survey();
        let rule = survey.overview.opened.iter().find(|opened| opened.news.id == finding);
        let is_plain = |letter: char| letter.is_ascii_alphanumeric() || matches!(letter, '-' | '_');
        let rule: String = rule.map_or(String::new(), |opened| {
            let letters = opened.news.rule.chars().map(|it| if is_plain(it) { it } else { '-' });
            format!("-{}", letters.take(LONGEST_RULE).collect::<String>())
        });
        format!("{}{rule}-{finding}.html", self.capture_stem())
    }

    /// Starts writing the page.
    pub(super) fn write_report(&mut self, path: &str) {
        let Some(finding) = self.reporting.take() else { return };
        let request = ReportRequest { finding, path: path.into() };
        match (self.write_report)(request, self.core.timeline.options()) {
            Ok(()) => self.core.begin_export(),
            Err(error) => self.core.show_refusal(&format!("{error:#}")),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_suffix_selects_the_format_of_the_page() {
        for (name, expected) in
            [("case.html", true), ("a b/case.MD", true), ("case", false), ("case.pdf", false), ("", false)]
        {
            assert_eq!(has_format(name.as_ref()), expected, "{name}");
        }
    }
}
