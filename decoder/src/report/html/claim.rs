//! A claim with its evidence.

use maud::{Markup, html};

use super::parts::{frame_id, link_frames, render_fact_number, render_severity};
use super::plot::render_plot;
use crate::report::model::{EvidenceFrame, NodeValues, ReportClaim};
use crate::words::count_noun;

/// Length of eight bytes in hexadecimal, which are not broken.
const CLASSIC_BYTES: usize = 23;

/// Maximum number of frames in the summary.
const SHOWN_PROOF: usize = 3;

/// The section of a claim.
pub(super) fn render_claim(claim: &ReportClaim) -> Markup {
    let id = format!("claim{}", claim.number);
    html! {
        section aria-labelledby=(id) {
            h2 id=(id) { "Claim " (claim.number) ": " (render_severity(claim.severity)) }
            (render_summary(claim))
            h3 { "Story" }
            (render_story(claim))
            @if !claim.plots.is_empty() {
                h3 { "Signals" }
                @for own in &claim.plots { (render_plot(own)) }
            }
            h3 { "Frames" }
            (render_evidence(claim))
            @for values in &claim.values {
                h3 { "Object values: " (values.who) }
                (render_objects(values, claim))
            }
            @if !claim.context.is_empty() {
                h3 { "Before and at that time" }
                pre { @for line in &claim.context { (link_frames(line, claim)) "\n" } }
            }
        }
    }
}

/// What, when, proof and section.
fn render_summary(claim: &ReportClaim) -> Markup {
    html! {
        dl.summary {
            dt { "What" }
            dd { strong { (link_frames(&claim.title, claim)) } br; (claim.who) }
            dt { "When" }
            dd { (claim.when) }
            dt { "Proof" }
            dd {
                @for frame in proof_frames(claim) {
                    div {
                        a href=(format!("#{}", frame_id(claim, frame.number))) { "{" (frame.number) "}" }
                        " " code { (frame.id) " [" (frame.bytes) "]" }
                        @if let Some(meaning) = frame.meaning.first() { " " (meaning) }
                    }
                }
                @if claim.evidence.is_empty() { "no frame: the story is about an absence" }
                @else if claim.evidence.len() > SHOWN_PROOF {
                    div.quiet { (count_noun(claim.evidence.len(), "frame")) " listed below" }
                }
            }
            dt { "Section" }
            dd {
                @for source in &claim.sources { div { (source) } }
                @if claim.sources.is_empty() { "none: rule of the user, or fact without a rule" }
            }
        }
    }
}

/// Frames of the first facts.
fn proof_frames(claim: &ReportClaim) -> Vec<&EvidenceFrame> {
    let mut all: Vec<_> = claim.evidence.iter().collect();
    all.sort_by_key(|frame| (frame.marks.first().copied().unwrap_or(usize::MAX), frame.number));
    all.truncate(SHOWN_PROOF);
    all
}

/// Lines of the story with their labels.
fn render_story(claim: &ReportClaim) -> Markup {
    html! {
        dl.story {
            @for line in &claim.lines {
                dt { (line.label.label_word().trim()) }
                dd {
                    @if let Some(number) = line.mark { (render_fact_number(number)) }
                    (link_frames(&line.text, claim))
                }
            }
        }
    }
}

/// The list of frames.
fn render_evidence(claim: &ReportClaim) -> Markup {
    html! {
        div.scroll {
            table {
                caption {
                    "Frames that show the claim"
                    @if claim.omitted > 0 { "; " (count_noun(claim.omitted, "further frame")) " not listed" }
                }
                thead {
                    tr {
                        th.number scope="col" { "Frame" } th scope="col" { "Fact" } th.number scope="col" { "Time/s" }
                        th scope="col" { "Bus" } th scope="col" { "ID" } th scope="col" { "Bytes" }
                        th scope="col" { "Meaning" }
                    }
                }
                tbody {
                    @for frame in &claim.evidence {
                        tr id=(frame_id(claim, frame.number)) {
                            td.number { "{" (frame.number) "}" }
                            td.facts { @for number in &frame.marks { (render_fact_number(*number)) } }
                            td.number { (frame.time.trim_end_matches(" s")) }
                            td { (frame.bus) }
                            td.data.short { (frame.id) }
                            td.data.short[frame.bytes.len() <= CLASSIC_BYTES] { (frame.bytes) }
                            td {
                                @for meaning in &frame.meaning { div { (meaning) @if frame.is_presumed { "?" } } }
                                @if frame.meaning.is_empty() { span.quiet { "no event of its own" } }
                            }
                        }
                    }
                }
            }
        }
    }
}

/// Object values with their origin.
fn render_objects(values: &NodeValues, claim: &ReportClaim) -> Markup {
    html! {
        div.scroll {
            table {
                caption {
                    (link_frames(&values.at, claim)) ": " (values.rows.len()) " of " (count_noun(values.total, "known object"))
                    "; ▸ marks objects that the findings name"
                }
                thead {
                    tr {
                        th scope="col" { "Object" } th scope="col" { "Name" } th scope="col" { "Value" }
                        th scope="col" { "Bytes" } th scope="col" { "Origin" }
                    }
                }
                tbody {
                    @for row in &values.rows {
                        tr {
                            td.data.short { @if row.is_subject { "▸" } (row.object) }
                            td { (row.name) }
                            td { (row.value) }
                            td.data { (row.bytes) }
                            td.short { (row.origin) @if row.frame > 0 { " {" (row.frame) "}" } }
                        }
                    }
                }
            }
        }
    }
}
