//! The page of a fleet: machines and weeks, the worst stories, and the captures of each machine.

use maud::{Markup, html};

use super::document::render_page;
use crate::finding::Severity;
use crate::report::fleet::{Fleet, FleetCapture, FleetMachine, StoryKind, WeekCell};
use crate::words::{count_noun, group_digits};

/// Maximum number of captures listed per machine, the latest ones.
const MOST_CAPTURES: usize = 100;

/// Maximum number of stories listed per capture.
const MOST_STORIES: usize = 3;

/// Page of a fleet.
#[derive(Debug, Clone, Default)]
pub struct FleetPage {
    /// Folder of the lake.
    pub name: String,
    /// Verdicts and stories.
    pub fleet: Fleet,
    /// Command line.
    pub command: String,
    /// Version of the program.
    pub version: String,
}

/// The page.
pub fn write_fleet(own: &FleetPage) -> String {
    let fleet = &own.fleet;
    let title = format!("Fleet of {}", own.name);
    let body = html! {
        header {
            p.quiet { "cobscope " (own.version) }
            h1 { (title) }
            p.quiet { (count_noun(fleet.captures, "capture")) " of " (count_noun(fleet.machines.len(), "machine")) }
        }
        main {
            h2 { "Machines and weeks" }
            div.scroll { (render_weeks(fleet)) }
            p.quiet {
                "Captures per week, from Monday, UTC; E failed, U unreadable or incomplete."
                @if fleet.earlier > 0 { " " (count_noun(fleet.earlier, "capture")) " of earlier weeks are not shown." }
            }
            h2 { "Worst stories" }
            @if fleet.kinds.is_empty() { p { "no story" } } @else { div.scroll { (render_kinds(fleet)) } }
            @if fleet.further_kinds > 0 { p.quiet { "and " (fleet.further_kinds) " more kinds of stories" } }
            h2 { "Captures" }
            @for (number, machine) in (1..).zip(&fleet.machines) { (render_captures(number, machine)) }
            h2 { "How this page was made" }
            p { code { (own.command) } }
        }
    };
    render_page(&title, "index", &body)
}

fn render_weeks(fleet: &Fleet) -> Markup {
    html! {
        table {
            thead {
                tr {
                    th scope="col" { "Machine" }
                    @for week in &fleet.weeks {
                        th.rule scope="col" {
                            span { @match week { Some(week) => (week), None => "no date" } }
                        }
                    }
                }
            }
            tbody {
                @for (number, machine) in (1_usize..).zip(&fleet.machines) {
                    tr {
                        th scope="row" { a href={ "#m" (number) } { (machine.name) } }
                        @for cell in &machine.weeks { td { (week_cell(*cell)) } }
                    }
                }
            }
        }
    }
}

fn week_cell(cell: WeekCell) -> Markup {
    html! {
        @if cell.captures > 0 { (cell.captures) }
        @if cell.failed > 0 { " " span.severity.error { "E " (cell.failed) } }
        @if cell.unreadable > 0 { " " span.severity.warning { "U " (cell.unreadable) } }
    }
}

fn render_kinds(fleet: &Fleet) -> Markup {
    html! {
        table {
            thead {
                tr {
                    th scope="col" { "Severity" }
                    th scope="col" { "Rule" }
                    th scope="col" { "Node" }
                    th.number scope="col" { "Captures" }
                    th scope="col" { "Machines" }
                    th scope="col" { "Days" }
                    th scope="col" { "First one" }
                }
            }
            tbody { @for kind in &fleet.kinds { (kind_row(kind, fleet)) } }
        }
    }
}

fn kind_row(kind: &StoryKind, fleet: &Fleet) -> Markup {
    let number = |name: &str| fleet.machines.iter().position(|machine| machine.name == name);
    html! {
        tr {
            td { (render_severity(kind.severity)) }
            td { (kind.rule) }
            td { (kind.node) }
            td.number { (group_digits(kind.captures as u64)) }
            td {
                @for (place, name) in kind.machines.iter().enumerate() {
                    @if place > 0 { ", " }
                    a href={ "#m" (number(name).unwrap_or_default().saturating_add(1)) } { (name) }
                }
            }
            td.short {
                @match kind.days {
                    Some((first, last)) if first == last => (first),
                    Some((first, last)) => { (first) " to " (last) },
                    None => "",
                }
            }
            td { (kind.example) }
        }
    }
}

fn render_captures(number: usize, machine: &FleetMachine) -> Markup {
    let skipped = machine.captures.len().saturating_sub(MOST_CAPTURES);
    html! {
        h3 id={ "m" (number) } { (machine.name) }
        @if machine.captures.is_empty() { p { "no story" } }
        @else {
            @if skipped > 0 { p.quiet { "the latest " (MOST_CAPTURES) " of " (machine.captures.len()) } }
            div.scroll {
                table {
                    thead {
                        tr {
                            th scope="col" { "Day" }
                            th scope="col" { "Capture" }
                            th.number scope="col" { "Frames" }
                            th scope="col" { "Verdict" }
                            th scope="col" { "Stories" }
                        }
                    }
                    tbody { @for capture in machine.captures.iter().skip(skipped) { (capture_row(capture)) } }
                }
            }
        }
    }
}

fn capture_row(capture: &FleetCapture) -> Markup {
    let further = capture.stories.len().saturating_sub(MOST_STORIES);
    html! {
        tr {
            td.short { @if let Some(day) = capture.day { (day) } }
            td.data { (capture.capture) }
            td.number { (group_digits(capture.frames)) }
            td { (capture.verdict.name()) }
            td {
                @if let Some(failure) = &capture.failure {
                    div { span.severity.warning { "INCOMPLETE" } " " (failure) }
                }
                @for story in capture.stories.iter().take(MOST_STORIES) {
                    div { (render_severity(story.severity)) " " (story.title) }
                }
                @if further > 0 { div.quiet { "and " (further) " more" } }
            }
        }
    }
}

fn render_severity(severity: Severity) -> Markup {
    html! {
        @match severity {
            Severity::Error => span.severity.error { "ERROR" },
            Severity::Warning => span.severity.warning { "WARNING" },
            Severity::Note => span.severity.note { "NOTE" },
        }
    }
}
