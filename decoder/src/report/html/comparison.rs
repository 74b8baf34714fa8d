//! The differences between two captures as a page of the same layout as a report.

use std::collections::BTreeMap;

use maud::{Markup, html};

use super::document::{COMPARISON_MARK, marked_page};
use super::sections::render_made;
use crate::bus_file::DiffTolerances;
use crate::comparison::{
    CaptureComparison, CaptureRecord, ComparedSide, Difference, DifferenceKind, DifferenceSection,
    EvidenceMark, Observation, UnobservedSubject, text,
};
use crate::report::model::Provenance;
use crate::words::{count_noun, group_digits};

/// Contents of the page.
#[derive(Debug, Clone, Copy)]
pub struct ComparisonPage<'a> {
    /// Differences, what was not seen, and what is equal.
    pub comparison: &'a CaptureComparison,
    /// The first capture.
    pub good: &'a CaptureRecord,
    /// The second capture.
    pub bad: &'a CaptureRecord,
    /// Tolerances of the comparison.
    pub tolerances: &'a DiffTolerances,
    /// How the page was made.
    pub provenance: &'a Provenance,
}

/// Differences with the same label.
struct DifferenceGroup<'a> {
    title: &'static str,
    rows: Vec<&'a Difference>,
}

impl DifferenceGroup<'_> {
    /// Whether the heading states which capture has the values, and the other one has none.
    fn is_one_sided(&self) -> bool {
        let is_one_sided = |it: &&Difference| it.good.is_none() || it.bad.is_none();
        self.rows.iter().all(|it| it.section == DifferenceSection::Faults && is_one_sided(it))
    }
}

/// The page.
pub fn write_comparison(contents: &ComparisonPage<'_>) -> String {
    let ComparisonPage { comparison, good, bad, .. } = *contents;
    let title = match comparison.differences.len() {
        0 if comparison.is_void() => "Nothing compared".to_owned(),
        0 => "No difference within the tolerances".to_owned(),
        count => count_noun(count, "difference"),
    };
    let groups = group_by_label(comparison);
    let body = html! {
        header {
            p.quiet { "cobscope diff" }
            h1 { (title) }
            dl.summary {
                dt { "Good" } dd { (extent_text(good)) }
                dt { "Bad" } dd { (extent_text(bad)) }
                @if let Some(first) = comparison.differences.first() {
                    dt { "First" } dd { strong { (difference_summary(first)) } }
                }
                @if !groups.is_empty() {
                    dt { "Sections" }
                    dd {
                        @for (place, group) in groups.iter().enumerate() {
                            @if place > 0 { ", " }
                            a href=(format!("#{}", id_of(group.title))) { (group.title) }
                            " " (group.rows.len())
                        }
                    }
                }
            }
        }
        main {
            @for group in &groups { (render_group(group)) }
            (not_seen(comparison, ComparedSide::Good))
            (not_seen(comparison, ComparedSide::Bad))
            (render_equal(comparison))
            (render_limits(comparison))
            (render_tolerances(contents.tolerances))
            (render_made(contents.provenance, "How this comparison was made", None))
            (render_marks())
        }
    };
    marked_page(&format!("{title} – {} and {}", good.name, bad.name), "report", COMPARISON_MARK, &body)
}

/// `good.log: 612.0 s, 1,204 frames, 3 error frames`.
fn extent_text(record: &CaptureRecord) -> String {
    let duration = record.duration.map_or("without timestamps".to_owned(), text::format_seconds);
    let errors = match record.error_frames {
        0 => String::new(),
        count => format!(", {}", count_noun(count, "error frame")),
    };
    let frames = if record.frames == 1 { "frame" } else { "frames" };
    format!("{}: {duration}, {} {frames}{errors}", record.name, group_digits(record.frames))
}

/// A difference in one line.
fn difference_summary(it: &Difference) -> String {
    let value = |value: &Option<Observation>| match value {
        Some(value) => value.text.clone(),
        None => "not seen".to_owned(),
    };
    let values = match (it.section, &it.good, &it.bad) {
        (DifferenceSection::Faults, Some(only), None) | (DifferenceSection::Faults, None, Some(only)) => {
            only.text.clone()
        }
        _ => format!("{} | {}", value(&it.good), value(&it.bad)),
    };
    let aspect = if is_finding(it) { "" } else { it.aspect.as_str() };
    let subject = if values.starts_with(it.subject.as_str()) { "" } else { it.subject.as_str() };
    let parts = [subject, aspect, values.as_str()];
    parts.into_iter().filter(|part| !part.is_empty()).collect::<Vec<_>>().join("  ")
}

/// Differences by label, in the order of their first one.
fn group_by_label(comparison: &CaptureComparison) -> Vec<DifferenceGroup<'_>> {
    let mut groups: Vec<DifferenceGroup<'_>> = Vec::new();
    for it in &comparison.differences {
        let title = text::difference_label(it);
        match groups.iter_mut().find(|group| group.title == title) {
            Some(group) => group.rows.push(it),
            None => groups.push(DifferenceGroup { title, rows: vec![it] }),
        }
    }
    groups
}

/// Id of the heading of a group.
fn id_of(title: &str) -> String {
    title.to_ascii_lowercase().replace(' ', "-")
}

fn render_group(group: &DifferenceGroup<'_>) -> Markup {
    let id = id_of(group.title);
    let (what, what_differs) =
        if group.rows.iter().all(|it| is_finding(it)) { ("Rule", "Finding") } else { ("What", "Value") };
    html! {
        section aria-labelledby=(id) {
            h2 id=(id) { (group.title) }
            div.scroll {
                table.compared {
                    thead {
                        tr {
                            th scope="col" { "Subject" } th scope="col" { (what) }
                            @if group.is_one_sided() {
                                th scope="col" colspan="2" { (what_differs) }
                            } @else {
                                th scope="col" { "Good" } th scope="col" { "Bad" }
                            }
                            th scope="col" { "Note" }
                        }
                    }
                    tbody {
                        @for it in &group.rows {
                            tr {
                                td { (it.subject) } td { (it.aspect) }
                                @if group.is_one_sided() {
                                    td colspan="2" { (render_value(it.bad.as_ref().or(it.good.as_ref()))) }
                                } @else {
                                    td { (render_value(it.good.as_ref())) } td { (render_value(it.bad.as_ref())) }
                                }
                                td { (it.note) }
                            }
                        }
                    }
                }
            }
        }
    }
}

fn is_finding(it: &Difference) -> bool {
    matches!(it.kind, DifferenceKind::Finding | DifferenceKind::StoryEnded | DifferenceKind::FindingEnded)
}

/// A value with its time and frame.
fn render_value(value: Option<&Observation>) -> Markup {
    html! {
        @match value {
            // The text of a finding names its frames itself.
            Some(value) => {
                (value.text)
                (render_place(if value.text.contains('{') { EvidenceMark { frame: 0, ..value.mark } } else { value.mark }))
            },
            None => span.quiet { "not seen" },
        }
    }
}

fn render_place(mark: EvidenceMark) -> Markup {
    html! {
        @if mark.frame > 0 || mark.time.is_some() {
            br;
            span.quiet {
                @if let Some(time) = mark.time { (text::format_seconds(time)) " " }
                @if mark.frame > 0 { "{" (mark.frame) "}" }
            }
        }
    }
}

/// What one capture never showed: most important first.
fn not_seen(comparison: &CaptureComparison, side: ComparedSide) -> Markup {
    let own: Vec<&UnobservedSubject> = comparison.not_seen.iter().filter(|it| it.by == side).collect();
    let title = text::not_seen_by(side);
    let id = id_of(title);
    html! {
        @if !own.is_empty() {
            section aria-labelledby=(id) {
                h2 id=(id) { (title) }
                p.quiet { "Not a difference: the capture had no opportunity to show it, or is too short." }
                div.scroll {
                    table {
                        thead {
                            tr { th scope="col" { "Kind" } th scope="col" { "Subject" } th scope="col" { "What" } }
                        }
                        tbody {
                            @for it in own {
                                tr {
                                    td.short { (it.noun.name()) } td.short { (it.subject) }
                                    td { (it.aspect) (render_place(it.mark)) }
                                }
                            }
                        }
                    }
                }
            }
        }
    }
}

fn render_equal(comparison: &CaptureComparison) -> Markup {
    let mut sections: BTreeMap<DifferenceSection, Vec<String>> = BTreeMap::new();
    for ((section, noun), count) in &comparison.equal {
        sections.entry(*section).or_default().push(count_noun(*count, noun.name()));
    }
    html! {
        @if !sections.is_empty() {
            section aria-labelledby="equal" {
                h2 id="equal" { "EQUAL" }
                dl { @for (section, counts) in &sections { dt { (section.name()) } dd { (counts.join(", ")) } } }
            }
        }
    }
}

fn render_limits(comparison: &CaptureComparison) -> Markup {
    html! {
        @if !comparison.limits.is_empty() {
            section aria-labelledby="limits" {
                h2 id="limits" { "NOT COMPARED" }
                ul { @for (_, limit) in &comparison.limits { li { (limit) } } }
            }
        }
    }
}

fn render_tolerances(tolerances: &DiffTolerances) -> Markup {
    let all = [
        ("period-percent", tolerances.period),
        ("gap-percent", tolerances.gap),
        ("longest-gap-percent", tolerances.longest_gap),
        ("latency-percent", tolerances.latency),
        ("count-percent", tolerances.count),
        ("load-percent", tolerances.load),
        ("set-point-percent", tolerances.set_point),
        ("time-ms", tolerances.time_ms),
    ];
    html! {
        section aria-labelledby="tolerances" {
            h2 id="tolerances" { "Tolerances" }
            p {
                @for (place, (key, value)) in all.iter().enumerate() {
                    @if place > 0 { ", " }
                    span.data { (key) " = " (value) }
                }
                " (table [diff] of the bus file)"
            }
        }
    }
}

fn render_marks() -> Markup {
    html! {
        section aria-labelledby="glossary" {
            h2 id="glossary" { "Marks" }
            dl {
                dt { "55.0 s {96}" } dd { "time from the first frame of the capture, and number of the frame" }
                dt { "?" } dd { "assumed: not confirmed by a message" }
            }
        }
    }
}
