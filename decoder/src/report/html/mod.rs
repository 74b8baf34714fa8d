//! A report as one HTML page without scripts: markup, style and plots in one file.
//!
//! The templates escape every text; control characters are shown as `\u{1b}`.

mod claim;
mod comparison;
mod document;
mod fleet;
mod index;
mod parts;
mod plot;
mod sections;

pub use comparison::{ComparisonPage, write_comparison};
pub use document::{COMPARISON_MARK, MARK, STYLE};
pub use fleet::{FleetPage, write_fleet};
pub use index::{IndexPage, IndexRow, RuleCount, write_index};

use maud::html;

use self::claim::render_claim;
use self::document::render_page;
use super::model::CaptureReport;
use crate::words::{count_noun, group_digits};

/// The page.
pub fn write_page(report: &CaptureReport) -> String {
    let title = report.title();
    let body = html! {
        header {
            p.quiet { "cobscope report on " (report.capture.name) }
            h1 { (title) }
            p.quiet { (extent_text(report)) }
            @if let Some(failure) = &report.capture.failure {
                p { span.severity.error { "INCOMPLETE" } " " (failure) }
            }
        }
        main {
            @if report.claims.is_empty() {
                (sections::nothing_found(report))
            }
            @for own in &report.claims {
                (render_claim(own))
            }
            (sections::render_further(report))
            @if !report.claims.is_empty() {
                (sections::render_assumptions(report))
            }
            (sections::render_quality(report))
            (sections::render_sources(report))
            (sections::render_clock(report))
            (sections::render_provenance(report))
            (sections::render_coverage(report))
            (sections::render_glossary())
        }
    };
    render_page(&format!("{title} – {}", report.capture.name), "report", &body)
}

/// `359 frames in 143.001 s, candump log; 4 claims`.
fn extent_text(report: &CaptureReport) -> String {
    let capture = &report.capture;
    let frames = if capture.frames == 1 { "frame" } else { "frames" };
    let duration = capture.duration.as_ref().map_or_else(String::new, |duration| format!(" in {duration}"));
    let claims = match (report.claims.len(), report.further.len()) {
        (0, _) => String::new(),
        (shown, 0) => format!("; {}", count_noun(shown, "claim")),
        (shown, further) => format!("; {shown} of {}", count_noun(shown.saturating_add(further), "claim")),
    };
    format!("{} {frames}{duration}, {}{claims}", group_digits(capture.frames), capture.format)
}
