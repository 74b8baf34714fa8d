//! Display of times: seconds from the first frame, or wall-clock time.

/// Display of times.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum TimeDisplay {
    /// Seconds from the first frame.
    #[default]
    Relative,
    /// Wall-clock time in UTC.
    Utc,
    /// Wall-clock time in the time zone of the computer.
    Local,
}

impl TimeDisplay {
    /// The next display.
    #[must_use]
    pub const fn next(self) -> Self {
        match self {
            Self::Relative => Self::Utc,
            Self::Utc => Self::Local,
            Self::Local => Self::Relative,
        }
    }

    /// Head of a column of times.
    pub const fn column_title(self) -> &'static str {
        match self {
            Self::Relative => "Time",
            Self::Utc => "UTC",
            Self::Local => "Local",
        }
    }

    /// Message after a change.
    pub const fn change_text(self) -> &'static str {
        match self {
            Self::Relative => "times in seconds since the first frame",
            Self::Utc => "times in UTC",
            Self::Local => "times in the time zone of this computer",
        }
    }
}
