//! Comments in which cobscope stores notices in formats without records for them.
//!
//! ```text
//! cobscope: link up 250000      the link to the bus is up, at this bit rate
//! cobscope: link up             … at an unknown bit rate
//! cobscope: link down           the interface was switched off
//! cobscope: link gone           the interface was removed
//! cobscope: quiet               no frame was received up to this time
//! cobscope: clock 3600000000000 the clock of the timestamps was set forward by these nanoseconds
//! cobscope: lost 3              number of frames lost before this one; "lost" if unknown
//! ```

use crate::frame::LinkState;

const PREFIX: &str = "cobscope: ";
const LINK: &str = "link ";
const QUIET: &str = "quiet";
const LOST: &str = "lost";
const CLOCK: &str = "clock ";

/// Content of a comment of cobscope.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum CommentRemark {
    /// New state of the link to the bus, and the bit rate in bit/s.
    Link(LinkState, Option<u32>),
    /// No frame was received up to now.
    Quiet,
    /// Number of lost frames; `None` if unknown.
    Lost(Option<u64>),
    /// The clock was set forward by this time in ns.
    ClockSet(i64),
}

impl CommentRemark {
    /// Parses a comment; `None` if it is not a comment of cobscope.
    pub(super) fn parse(comment: &[u8]) -> Option<Self> {
        let text = std::str::from_utf8(comment).ok()?.strip_prefix(PREFIX)?;
        if text == QUIET {
            return Some(Self::Quiet);
        }
        if let Some(count) = text.strip_prefix(LOST) {
            return Some(Self::Lost(count.strip_prefix(' ').and_then(|count| count.parse().ok())));
        }
        if let Some(step) = text.strip_prefix(CLOCK) {
            return Some(Self::ClockSet(step.parse().ok().filter(|step| *step > 0)?));
        }
        let mut words = text.strip_prefix(LINK)?.split(' ');
        let name = words.next()?;
        let state = LinkState::ALL.into_iter().find(|state| state.name() == name)?;
        Some(Self::Link(state, words.next().and_then(|rate| rate.parse().ok())))
    }

    /// The text of the comment.
    pub(super) fn comment_text(self) -> String {
        match self {
            Self::Quiet => format!("{PREFIX}{QUIET}"),
            Self::ClockSet(step) => format!("{PREFIX}{CLOCK}{step}"),
            Self::Lost(None) => format!("{PREFIX}{LOST}"),
            Self::Lost(Some(count)) => format!("{PREFIX}{LOST} {count}"),
            Self::Link(state, None) => format!("{PREFIX}{LINK}{}", state.name()),
            Self::Link(state, Some(rate)) => format!("{PREFIX}{LINK}{} {rate}", state.name()),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn comments_of_others_say_nothing() {
        for comment in [&b"link up"[..], b"cobscope: link sideways", b"cobscope:", b"cobscope: \xFF", b""] {
            assert_eq!(CommentRemark::parse(comment), None);
        }
        assert_eq!(
            CommentRemark::parse(b"cobscope: link up 250000"),
            Some(CommentRemark::Link(LinkState::Up, Some(250_000)))
        );
        assert_eq!(
            CommentRemark::parse(b"cobscope: link gone"),
            Some(CommentRemark::Link(LinkState::Gone, None))
        );
        for remark in [
            CommentRemark::Quiet,
            CommentRemark::Lost(None),
            CommentRemark::Lost(Some(7)),
            CommentRemark::ClockSet(i64::MAX),
        ] {
            assert_eq!(CommentRemark::parse(remark.comment_text().as_bytes()), Some(remark));
        }
    }
}
