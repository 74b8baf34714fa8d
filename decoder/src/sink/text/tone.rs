//! Emphasis of event lines.

/// Emphasis of an event line.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum LineTone {
    /// Normal information.
    #[default]
    Plain,
    /// Repeated information.
    Quiet,
    /// Normal operation restored or confirmed.
    Good,
    /// Needs attention.
    Caution,
    /// Fault or loss.
    Bad,
}

impl LineTone {
    /// Name, the class of its colour on a page.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Plain => "plain",
            Self::Quiet => "quiet",
            Self::Good => "good",
            Self::Caution => "caution",
            Self::Bad => "bad",
        }
    }

    pub(super) const fn ansi_code(self) -> &'static str {
        match self {
            Self::Plain => "",
            Self::Quiet => "\x1b[2m",
            Self::Good => "\x1b[32m",
            Self::Caution => "\x1b[33m",
            Self::Bad => "\x1b[31m",
        }
    }
}
