//! Small parts of pages.

use maud::{Markup, html};

use crate::finding::Severity;
use crate::report::model::ReportClaim;

/// Severity as a word; its colour repeats it.
pub(super) fn render_severity(severity: Severity) -> Markup {
    let class = match severity {
        Severity::Error => "severity error",
        Severity::Warning => "severity warning",
        Severity::Note => "severity note",
    };
    html! { span class=(class) { (severity.name().to_uppercase()) } }
}

/// Number of a fact of the story.
pub(super) fn render_fact_number(number: usize) -> Markup {
    html! { span.fact { (number) } }
}

/// Id of a frame in the list of a claim.
pub(super) fn frame_id(claim: &ReportClaim, frame: u64) -> String {
    format!("claim{}-frame{frame}", claim.number)
}

/// A text whose frames in braces are links to the list of frames.
pub(super) fn link_frames(text: &str, claim: &ReportClaim) -> Markup {
    let mut rest = text;
    let mut parts = Vec::new();
    while let Some((before, (inside, after))) =
        rest.split_once('{').and_then(|(before, after)| Some((before, after.split_once('}')?)))
    {
        parts.push((before, Some(inside)));
        rest = after;
    }
    parts.push((rest, None));
    html! {
        @for (before, inside) in parts {
            (before)
            @if let Some(inside) = inside { (render_frames(inside, claim)) }
        }
    }
}

/// Contents of braces: `104`, `36 38 40`, `12-13`.
fn render_frames(inside: &str, claim: &ReportClaim) -> Markup {
    let first = inside.split([' ', '-']).next().and_then(|number| number.parse().ok());
    let listed = first.filter(|number| claim.evidence.iter().any(|frame| frame.number == *number));
    html! {
        @match listed {
            Some(number) => a href=(format!("#{}", frame_id(claim, number))) { "{" (inside) "}" },
            None => { "{" (inside) "}" },
        }
    }
}
