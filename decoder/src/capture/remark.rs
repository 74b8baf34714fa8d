//! What this program says in comments of captures whose format has no place for it.
//!
//! ```text
//! cobscope: link up 250000      the way to the bus is open, at this bit rate
//! cobscope: link up             … at a bit rate that is not known
//! cobscope: link down           the interface was switched off
//! cobscope: link gone           it was taken away
//! cobscope: quiet               nothing came up to this time
//! cobscope: lost 3              so many frames were lost before this one; "lost" where it is not known how many
//! ```

use crate::frame::LinkState;

const PREFIX: &str = "cobscope: ";
const LINK: &str = "link ";
const QUIET: &str = "quiet";
const LOST: &str = "lost";

/// Such a comment.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Remark {
    /// How the way to the bus is from here on, and the bit rate in bit/s.
    Link(LinkState, Option<u32>),
    /// Nothing came until now.
    Quiet,
    /// Frames were lost, so many where it is known.
    Lost(Option<u64>),
}

impl Remark {
    /// What a comment says, if it is one of these.
    pub(super) fn parse(comment: &[u8]) -> Option<Self> {
        let text = std::str::from_utf8(comment).ok()?.strip_prefix(PREFIX)?;
        if text == QUIET {
            return Some(Self::Quiet);
        }
        if let Some(count) = text.strip_prefix(LOST) {
            return Some(Self::Lost(count.strip_prefix(' ').and_then(|count| count.parse().ok())));
        }
        let mut words = text.strip_prefix(LINK)?.split(' ');
        let name = words.next()?;
        let state = LinkState::ALL.into_iter().find(|state| state.name() == name)?;
        Some(Self::Link(state, words.next().and_then(|rate| rate.parse().ok())))
    }

    /// The comment.
    pub(super) fn text(self) -> String {
        match self {
            Self::Quiet => format!("{PREFIX}{QUIET}"),
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
            assert_eq!(Remark::parse(comment), None);
        }
        assert_eq!(
            Remark::parse(b"cobscope: link up 250000"),
            Some(Remark::Link(LinkState::Up, Some(250_000)))
        );
        assert_eq!(Remark::parse(b"cobscope: link gone"), Some(Remark::Link(LinkState::Gone, None)));
        for remark in [Remark::Quiet, Remark::Lost(None), Remark::Lost(Some(7))] {
            assert_eq!(Remark::parse(remark.text().as_bytes()), Some(remark));
        }
    }
}
