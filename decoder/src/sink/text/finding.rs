//! Lines of findings.

use std::fmt::Write as _;

use super::Tone;
use crate::event::EventKind;
use crate::finding::Severity;

/// `1018:01: answered after 312 ms [sdo-no-response]`.
pub(super) fn words(kind: &EventKind) -> Option<(&'static str, String, Tone)> {
    let (news, is_over) = match kind {
        EventKind::FindingOpened(news) => (news, false),
        EventKind::FindingClosed(news) => (news, true),
        _ => return None,
    };
    let mut what = String::new();
    if is_over {
        what.push_str(if news.is_at_end { "still open at the end: " } else { "over: " });
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
    if let Some(reason) = &news.downgraded {
        let _ = write!(what, " ({}: {reason})", news.severity.name());
    }
    let _ = write!(what, " [{}]", news.rule);
    let tone = match news.severity {
        _ if is_over => Tone::Quiet,
        Severity::Error => Tone::Bad,
        Severity::Warning => Tone::Caution,
        Severity::Note => Tone::Plain,
    };
    Some((news.word, what, tone))
}
