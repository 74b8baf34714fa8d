//! Sections after the claims.

use maud::{Markup, html};

use crate::report::glossary::glossary_marks;
use crate::report::model::{Attachment, CaptureReport, Provenance, VerdictCoverage};
use crate::words::{count_noun, group_digits};

/// A heading with a list; nothing without texts.
fn render_list(title: &str, id: &str, texts: &[String]) -> Markup {
    html! {
        @if !texts.is_empty() {
            section aria-labelledby=(id) {
                h2 id=(id) { (title) }
                ul { @for text in texts { li { (text) } } }
            }
        }
    }
}

/// What was checked, in a report without a claim.
pub(super) fn nothing_found(report: &CaptureReport) -> Markup {
    let coverage = &report.coverage;
    html! {
        section aria-labelledby="result" {
            h2 id="result" { "Result" }
            dl.summary {
                dt { "What" }
                dd { strong { (report.within_scope("no finding with a warning or an error")) } }
                dt { "Checked" }
                dd {
                    (count_noun(coverage.passed.len(), "rule")) " without a defect, "
                    (coverage.not_exercised.len()) " not exercised; both are listed below"
                }
            }
            @if !report.account.is_empty() { pre { @for line in &report.account { (line) "\n" } } }
        }
    }
}

/// Stories without a claim, and notes.
pub(super) fn render_further(report: &CaptureReport) -> Markup {
    html! {
        (render_list("Further stories, without evidence on this page", "further", &report.further))
        (render_list("Notes", "notes", &report.notes))
    }
}

/// Assumptions that the claims rest on.
pub(super) fn render_assumptions(report: &CaptureReport) -> Markup {
    html! {
        section aria-labelledby="assumptions" {
            h2 id="assumptions" { "Assumptions (?)" }
            @if report.assumptions.is_empty() {
                p { "none: all values and states in the claims were seen on the bus" }
            } @else {
                ul { @for text in &report.assumptions { li { (text) } } }
            }
        }
    }
}

/// Quality of the capture, and what it cannot show.
pub(super) fn render_quality(report: &CaptureReport) -> Markup {
    html! {
        (render_list("Quality of the capture", "quality", &report.quality))
        (render_list("What the capture cannot show", "blind", &report.blind))
    }
}

/// Sources of the rules behind the claims.
pub(super) fn render_sources(report: &CaptureReport) -> Markup {
    html! {
        @if !report.sources.is_empty() {
            section aria-labelledby="sources" {
                h2 id="sources" { "Manual and standard" }
                div.scroll {
                    table {
                        thead { tr { th scope="col" { "Rule" } th scope="col" { "Defect" } th scope="col" { "Source" } } }
                        tbody {
                            @for source in &report.sources {
                                tr { td.data { (source.rule) } td { (source.title) } td { (source.source) } }
                            }
                        }
                    }
                }
            }
        }
        (render_list("Devices", "devices", &report.devices))
    }
}

/// Source and zone of the timestamps.
pub(super) fn render_clock(report: &CaptureReport) -> Markup {
    render_list("Timestamps", "clock", &report.clock)
}

/// Command, version and hashes of a report.
pub(super) fn render_provenance(report: &CaptureReport) -> Markup {
    render_made(&report.provenance, "How this report was made", report.attachment.as_ref())
}

/// Command, version and hashes.
pub(super) fn render_made(made: &Provenance, title: &str, own: Option<&Attachment>) -> Markup {
    html! {
        section aria-labelledby="made" {
            h2 id="made" { (title) }
            dl {
                dt { "Command" }
                dd { code { (made.command) } }
                dt { "Program" }
                dd { "cobscope " (made.version) }
            }
            div.scroll {
                table {
                    thead {
                        tr {
                            th scope="col" { "Use" } th scope="col" { "File" } th.number scope="col" { "Bytes" }
                            th scope="col" { "SHA-256" }
                        }
                    }
                    tbody {
                        @for file in &made.files {
                            tr {
                                td { (file.role) }
                                td { (file.name) }
                                td.number { @if file.size > 0 { (group_digits(file.size)) } }
                                td.data.hash { (file.sha256) }
                            }
                        }
                        @if let Some(own) = own { (render_attachment(own)) }
                    }
                }
            }
        }
    }
}

fn render_attachment(own: &Attachment) -> Markup {
    let frames = format!("cut-out capture, {}", count_noun(own.frames, "frame"));
    html! {
        tr {
            td {
                (frames)
                @if own.is_cut { ", cut at the limit" }
                @if !own.is_timed { ", timestamps 0: the capture has none" }
            }
            td {
                @match &own.embedded {
                    Some(base64) => {
                        a download=(own.name) href=(format!("data:application/octet-stream;base64,{base64}")) {
                            (own.name)
                        }
                        ", embedded"
                    }
                    None => { (own.name) ", next to this page" },
                }
                @if let Some(bus_file) = &own.bus_file {
                    br; "read with --bus " (bus_file)
                }
            }
            td.number { (group_digits(own.size as u64)) }
            td.data.hash { (own.sha256) }
        }
    }
}

/// Verdicts of all rules.
pub(super) fn render_coverage(report: &CaptureReport) -> Markup {
    let coverage = &report.coverage;
    let counted = |rules: &[(String, u64)]| {
        html! {
            @for (place, (rule, count)) in rules.iter().enumerate() {
                @if place > 0 { ", " }
                span.data { (rule) } " " (group_digits(*count))
            }
            @if rules.is_empty() { "none" }
        }
    };
    html! {
        section aria-labelledby="rules" {
            h2 id="rules" { "Rules" }
            dl {
                dt { "With defects" }
                dd { (counted(&coverage.failed)) }
                dt { "Without a defect" }
                dd { (counted(&coverage.passed)) }
                dt { "Not exercised" }
                dd {
                    @if report.claims.is_empty() && !coverage.not_exercised.is_empty() {
                        "see the table below"
                    } @else {
                        @for (place, (rule, _)) in coverage.not_exercised.iter().enumerate() {
                            @if place > 0 { ", " }
                            span.data { (rule) }
                        }
                        @if coverage.not_exercised.is_empty() { "none" }
                    }
                }
            }
            // Without a finding, the reader asks first what was not checked, and why.
            @if report.claims.is_empty() && !coverage.not_exercised.is_empty() {
                (not_exercised(coverage))
            }
            p.quiet { "Numbers are counts of checks. A rule is not exercised if the capture contains nothing that it checks." }
        }
    }
}

/// Rules that were not exercised, with what was missing in the capture.
fn not_exercised(coverage: &VerdictCoverage) -> Markup {
    html! {
        div.scroll {
            table {
                caption { "Rules that were not exercised" }
                thead { tr { th scope="col" { "Rule" } th scope="col" { "Needs" } } }
                tbody {
                    @for (rule, needs) in &coverage.not_exercised { tr { td.data { (rule) } td { (needs) } } }
                }
            }
        }
    }
}

/// Meaning of the marks.
pub(super) fn render_glossary() -> Markup {
    html! {
        section aria-labelledby="marks" {
            h2 id="marks" { "Marks on this page" }
            dl { @for mark in glossary_marks() { dt { code { (mark.mark) } } dd { (mark.meaning) } } }
        }
    }
}
