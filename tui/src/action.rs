//! What a user can want, apart from the keys for it.

/// One thing to do.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Action {
    /// One line up.
    Up,
    /// One line down.
    Down,
    /// To the left: a column, or back in time.
    Left,
    /// To the right: a column, or on in time.
    Right,
    /// A screen up.
    PageUp,
    /// A screen down.
    PageDown,
    /// To the beginning.
    Top,
    /// To the end.
    Bottom,
    /// Into what is selected.
    Open,
    /// Back out of it.
    Back,
    /// Unfold or fold what is selected; choose it.
    Toggle,
    /// Show the pane with this place in the row of panes.
    Pane(u8),
    /// The pane behind.
    NextPane,
    /// The pane before.
    PreviousPane,
    /// Type a filter.
    Filter,
    /// Show everything again.
    Clear,
    /// Show only what has the value of the selected cell.
    FilterCell,
    /// All events, or only what says something new.
    News,
    /// Type what to look for.
    Search,
    /// The next place that has it.
    SearchNext,
    /// The one before.
    SearchPrevious,
    /// The next finding.
    NextFinding,
    /// The one before.
    PreviousFinding,
    /// The next event that tells of an error.
    NextError,
    /// The one before.
    PreviousError,
    /// Type a time or a frame to go to.
    GoTo,
    /// Give this place a letter.
    SetMark,
    /// Go to the place of a letter.
    ToMark,
    /// Stay here, or follow what comes.
    Pause,
    /// Begin a selection here, or give it up.
    Select,
    /// Sort by the selected column.
    Sort,
    /// Highlight what is like the selected.
    Highlight,
    /// Plot what is selected over time.
    Plot,
    /// Look closer.
    ZoomIn,
    /// Look from further away.
    ZoomOut,
    /// Set the second cursor here.
    SetCursor,
    /// Copy the selected line.
    Copy,
    /// Write what is shown to a file.
    Export,
    /// The next theme.
    Theme,
    /// All keys.
    Help,
    /// Leave the program.
    Quit,
}
