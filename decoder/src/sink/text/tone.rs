//! How serious a line looks.

/// How serious a line looks.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Tone {
    /// A fact like others.
    #[default]
    Plain,
    /// A repetition.
    Quiet,
    /// Something wanted.
    Good,
    /// Something to look at.
    Caution,
    /// Something wrong.
    Bad,
}

impl Tone {
    pub(super) const fn ansi(self) -> &'static str {
        match self {
            Self::Plain => "",
            Self::Quiet => "\x1b[2m",
            Self::Good => "\x1b[32m",
            Self::Caution => "\x1b[33m",
            Self::Bad => "\x1b[31m",
        }
    }
}
