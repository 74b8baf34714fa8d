//! Text of finding events.

use std::fmt::Write as _;

use super::LineTone;
use super::parts::LineContent;
use crate::event::FindingNews;
use crate::finding::Severity;

pub(super) fn opened_line(news: &FindingNews) -> LineContent {
    finding_words(news, false)
}

pub(super) fn closed_line(news: &FindingNews) -> LineContent {
    finding_words(news, true)
}

/// Appends the reason for a lower severity, the manual and the rule.
pub(super) fn push_source(news: &FindingNews, what: &mut String) {
    if let Some(reason) = &news.downgraded {
        let _ = write!(what, " (severity lowered: {reason})");
    }
    if let Some(manual) = news.source.as_ref().filter(|_| news.is_manual) {
        let _ = write!(what, " ({manual})");
    }
    let _ = write!(what, " [{}]", news.rule);
}

/// `warning: 1018:01: answered after 312 ms [sdo-no-response]`.
fn finding_words(news: &FindingNews, is_over: bool) -> LineContent {
    let mut what = String::new();
    if is_over {
        what.push_str(if news.is_at_end { "still open at the end: " } else { "closed: " });
    } else {
        let _ = write!(what, "{}: ", news.severity.name());
    }
    let object = news.object.map(|object| object.to_string());
    let pgn = news.pgn.map(|pgn| format!("PGN {pgn}/{pgn:04X}"));
    let about = object.or(pgn).or_else(|| news.about.clone());
    if let Some(about) = about.filter(|about| !news.text.contains(about.as_str())) {
        let _ = write!(what, "{about}: ");
    }
    what.push_str(&news.text);
    if is_over && news.count > 1 {
        let _ = write!(what, ", {} times", news.count);
    }
    push_source(news, &mut what);
    let tone = match news.severity {
        _ if is_over => LineTone::Quiet,
        Severity::Error => LineTone::Bad,
        Severity::Warning => LineTone::Caution,
        Severity::Note => LineTone::Plain,
    };
    (news.word, what, tone)
}
