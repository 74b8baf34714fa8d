//! The index page of several reports: a table of captures and rules.

use std::collections::BTreeSet;
use std::fmt::Write as _;

use maud::{Markup, html};

use super::document::render_page;
use crate::finding::Severity;
use crate::words::count_noun;

/// Reports of a folder.
#[derive(Debug, Clone, Default)]
pub struct IndexPage {
    /// What was reported on: `captures/`.
    pub name: String,
    /// Captures in order.
    pub rows: Vec<IndexRow>,
    /// Command line.
    pub command: String,
    /// Version of the program.
    pub version: String,
}

/// A capture of the index.
#[derive(Debug, Clone, Default)]
pub struct IndexRow {
    /// Name of the capture.
    pub capture: String,
    /// File name of its report; `None` without a report.
    pub page: Option<String>,
    /// Rules with findings.
    pub rules: Vec<RuleCount>,
    /// Verdict, or why the capture was not read.
    pub remark: String,
}

/// Findings of a rule in one capture.
#[derive(Debug, Clone)]
pub struct RuleCount {
    /// Name of the rule.
    pub rule: String,
    /// Number of findings.
    pub count: usize,
    /// Highest severity.
    pub severity: Severity,
}

/// The index page.
pub fn write_index(index: &IndexPage) -> String {
    let rules: BTreeSet<&str> =
        index.rows.iter().flat_map(|row| &row.rules).map(|count| count.rule.as_str()).collect();
    let title = format!("Reports on {}", index.name);
    let body = html! {
        header {
            p.quiet { "cobscope " (index.version) }
            h1 { (title) }
            p.quiet { (count_noun(index.rows.len(), "capture")) ", " (count_noun(rules.len(), "rule")) " with findings" }
        }
        main {
            h2 { "Captures and rules" }
            div.scroll { (render_table(index, &rules)) }
            p.quiet { "E error, W warning, N note, with the number of findings." }
            h2 { "How these reports were made" }
            p { code { (index.command) } }
        }
    };
    render_page(&title, "index", &body)
}

fn render_table(index: &IndexPage, rules: &BTreeSet<&str>) -> Markup {
    html! {
        table {
            thead {
                tr {
                    th scope="col" { "Capture" }
                    th scope="col" { "Verdict" }
                    @for rule in rules { th.rule scope="col" { span { (rule) } } }
                }
            }
            tbody {
                @for row in &index.rows {
                    tr {
                        th scope="row" {
                            @match &row.page {
                                Some(page) => a href=(relative_address(page)) { (row.capture) },
                                None => (row.capture),
                            }
                        }
                        td.remark { (row.remark) }
                        @for rule in rules { td { (render_cell(row, rule)) } }
                    }
                }
            }
        }
    }
}

fn render_cell(row: &IndexRow, rule: &str) -> Markup {
    let found = row.rules.iter().find(|count| count.rule == rule);
    html! {
        @if let Some(found) = found {
            @match found.severity {
                Severity::Error => span.severity.error { "E " (found.count) },
                Severity::Warning => span.severity.warning { "W " (found.count) },
                Severity::Note => span.severity.note { "N " (found.count) },
            }
        }
    }
}

/// A file name as a relative address: bytes other than letters, digits, `.`, `-` and `_` are encoded.
fn relative_address(name: &str) -> String {
    let mut address = String::from("./");
    for byte in name.bytes() {
        if byte.is_ascii_alphanumeric() || matches!(byte, b'.' | b'-' | b'_') {
            address.push(char::from(byte));
        } else {
            let _ = write!(address, "%{byte:02X}");
        }
    }
    address
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_of_files_are_relative_addresses() {
        assert_eq!(relative_address("a.html"), "./a.html");
        assert_eq!(relative_address("javascript:x\"#?.html"), "./javascript%3Ax%22%23%3F.html");
    }
}
