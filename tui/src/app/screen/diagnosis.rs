//! The line of the diagnosis: counts and the first story.
//!
//! ```text
//! 1 error 3 warnings: 32/20 EMCY 8305 spool position error, 7.204 s             } story  0 why
//! 1 error so far: 32/20 EMCY 8305 spool position error, 7.204 s                 } story  0 why
//! ```

use cobscope_decoder::figures::format_time;
use cobscope_decoder::finding::{RuleOutcome, Severity};
use cobscope_decoder::sink::escape;
use cobscope_decoder::words::count_noun;
use ratatui::buffer::Buffer;
use ratatui::layout::Rect;
use ratatui::text::Line;

use crate::state::UiState;
use crate::theme::TextRole;
use crate::timeline::SurveyResults;
use crate::widgets::draw;

/// Keys that lead on, shorter ones for narrow screens.
const KEYS: [&str; 3] = ["} story  0 why", "0 why", ""];

/// Draws the line. The title of the story is cut before counts, time and keys.
pub(in crate::app) fn draw_diagnosis(core: &UiState, area: Rect, buf: &mut Buffer) {
    if area.is_empty() {
        return;
    }
    let survey = core.timeline.survey();
    let (text, end, role) = diagnosis_words(core, &survey);
    let wanted = draw::text_width(&text).saturating_add(draw::text_width(&end));
    let room = |keys: &str| area.width.saturating_sub(draw::text_width(keys).saturating_add(2));
    let fitting = KEYS.into_iter().find(|keys| wanted <= room(keys));
    let keys = if end.is_empty() { "" } else { fitting.unwrap_or_default() };
    let room = room(keys).saturating_sub(draw::text_width(&end));
    let style = core.theme.role_style(role);
    draw::draw_line(
        buf,
        Rect { width: room, ..area },
        &Line::styled(text.clone(), style),
        draw::TextAlignment::Left,
        &core.theme,
    );
    let used = draw::text_width(&text).min(room);
    draw::put_text(buf, area.x + used, area.y, draw::text_width(&end), &end, style);
    let quiet = core.theme.role_style(TextRole::Quiet);
    draw::draw_line(buf, area, &Line::styled(keys, quiet), draw::TextAlignment::Right, &core.theme);
}

/// Text, its time, and its role.
fn diagnosis_words(core: &UiState, survey: &SurveyResults) -> (String, String, TextRole) {
    let Some(story) = survey.diagnosis.as_ref().and_then(|diagnosis| diagnosis.stories.first()) else {
        let Some(findings) = survey.findings.as_ref().filter(|_| survey.is_complete) else {
            return ("rules run; no fault so far".to_owned(), String::new(), TextRole::Quiet);
        };
        let rules = findings.rules.iter().zip(&findings.tallies).filter(|(rule, _)| rule.is_on);
        let missing = rules.filter(|(_, tally)| tally.verdict() == RuleOutcome::NotExercised).count();
        let text = format!("no findings; {} not exercised", count_noun(missing, "rule"));
        return (text, String::new(), TextRole::Good);
    };
    let (errors, warnings) = survey.diagnosed;
    let count = |number, name| (number > 0).then(|| count_noun(number, name));
    let counts = [count(errors, "error"), count(warnings, "warning")];
    let counts: Vec<_> = counts.into_iter().flatten().collect();
    let so_far = if survey.is_complete { "" } else { " so far" };
    let title = without_frames(&story.title);
    let text = format!("{}{so_far}: {}", counts.join(" "), escape(title).replace("  ", " "));
    let time = story.began.time.zip(core.first_time()).map(|(time, first)| time.since(first));
    let end = time.map_or_else(|| " ".to_owned(), |time| format!(", {}", format_time(time)));
    let role = if story.severity == Severity::Error { TextRole::Bad } else { TextRole::Caution };
    (text, end, role)
}

/// The title of a story without the frames at its end, which the Why pane shows.
fn without_frames(title: &str) -> &str {
    match title.rsplit_once(" {") {
        Some((text, frames)) if frames.ends_with('}') => text,
        _ => title,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_frames_at_the_end_are_left_out() {
        assert_eq!(without_frames("5/05  EMCY 8130 {7-12}"), "5/05  EMCY 8130");
        let lost = "5/05  no heartbeat after {3} (last frame {4}, operational)";
        assert_eq!(without_frames(lost), lost);
    }
}
