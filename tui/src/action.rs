//! Actions of the user, independent of keys.

/// An action of the user.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Action {
    /// Go up one line.
    Up,
    /// Go down one line.
    Down,
    /// Previous column, or earlier in time.
    Left,
    /// Next column, or later in time.
    Right,
    /// Go up one page.
    PageUp,
    /// Go down one page.
    PageDown,
    /// Go to the start.
    Top,
    /// Go to the end.
    Bottom,
    /// Open the selected item.
    Open,
    /// Close the open item, or go to the previous pane.
    Back,
    /// Expand, collapse or choose the selected item.
    Toggle,
    /// Show the pane with this number, from 0.
    Pane(u8),
    /// Show the next pane.
    NextPane,
    /// Show the previous pane.
    PreviousPane,
    /// Choose the next layout.
    Layout,
    /// Show only the focused pane, or all panes of the layout again.
    Zoom,
    /// Move the border between the columns of panes to the left.
    SplitLeft,
    /// Move the border between the columns of panes to the right.
    SplitRight,
    /// Show or hide the strip of time.
    Strip,
    /// Choose the columns of the pane.
    Columns,
    /// Open the filter prompt.
    Filter,
    /// Clear filter, search and highlight.
    Clear,
    /// Filter by the value of the selected cell.
    FilterCell,
    /// Undo the last change of filter, search, sort order or only changes.
    Undo,
    /// Redo it.
    Redo,
    /// Toggle between all events and changes only.
    News,
    /// Open the search prompt.
    Search,
    /// Go to the next match.
    SearchNext,
    /// Go to the previous match.
    SearchPrevious,
    /// Go to the next finding.
    NextFinding,
    /// Go to the previous finding.
    PreviousFinding,
    /// Go to the next story of the diagnosis.
    NextStory,
    /// Go to the previous story of the diagnosis.
    PreviousStory,
    /// Go to the next error event.
    NextError,
    /// Go to the previous error event.
    PreviousError,
    /// Open the prompt for a time or frame.
    GoTo,
    /// Switch times between seconds, UTC and local time.
    Clock,
    /// Set a mark at the cursor.
    SetMark,
    /// Go to a mark.
    ToMark,
    /// Pause or resume following new frames.
    Pause,
    /// Start or clear a selection of frames.
    Select,
    /// Sort by the selected column.
    Sort,
    /// Highlight the selected value.
    Highlight,
    /// Plot the signals of the selected item.
    Plot,
    /// Show half the time range.
    ZoomIn,
    /// Show twice the time range.
    ZoomOut,
    /// Set or remove cursor B of the plot.
    SetCursor,
    /// Assign the suggested profile to the selected node.
    Assign,
    /// Copy the selected line.
    Copy,
    /// Export the selection, or everything, to a file.
    Export,
    /// Write a report page of the selected finding or story.
    Report,
    /// Switch to the next theme.
    Theme,
    /// Discard the remembered view: layout, split, strip, theme.
    Forget,
    /// Show the legend of the pane and all keys.
    Help,
    /// Quit the program.
    Quit,
}
