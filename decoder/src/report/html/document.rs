//! A whole page: head, style and body.

use maud::{DOCTYPE, Markup, PreEscaped, html};

use crate::escape::escape;

/// Style of all pages, also of those that embed parts of a report.
pub const STYLE: &str = include_str!("style.css");

/// Element that each page about captures contains; an output replaces only pages with its own mark.
pub const MARK: &str = "<meta name=\"generator\" content=\"cobscope\">";

/// Element that each page about a comparison contains in place of [`MARK`].
pub const COMPARISON_MARK: &str = "<meta name=\"generator\" content=\"cobscope diff\">";

/// A whole page; `class` selects the paper of its print.
pub(super) fn render_page(title: &str, class: &str, body: &Markup) -> String {
    marked_page(title, class, MARK, body)
}

/// A whole page with a mark.
pub(super) fn marked_page(title: &str, class: &str, mark: &'static str, body: &Markup) -> String {
    let page = html! {
        (DOCTYPE)
        html lang="en" {
            head {
                meta charset="utf-8";
                meta name="viewport" content="width=device-width, initial-scale=1";
                (PreEscaped(mark))
                meta name="color-scheme" content="light dark";
                meta http-equiv="Content-Security-Policy"
                    content="default-src 'none'; style-src 'unsafe-inline'; base-uri 'none'; form-action 'none'";
                title { (title) }
                style { (PreEscaped(STYLE)) }
            }
            body class=(class) { (body) }
        }
    };
    without_controls(&page.into_string())
}

/// The page with control characters and bidirectional formatting of captured texts shown as escapes.
fn without_controls(page: &str) -> String {
    let mut clean = String::with_capacity(page.len());
    for line in page.split('\n') {
        clean.push_str(&escape(line));
        clean.push('\n');
    }
    clean
}
