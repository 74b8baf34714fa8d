//! Requests of a pane to the application.

use crate::state::{JumpPlace, NodeKey};
use crate::timeline::SignalKey;

/// A request of a pane or of the user to the application.
#[derive(Debug, Clone, PartialEq)]
pub enum PaneRequest {
    /// Move the cursor.
    Go(JumpPlace),
    /// Show the Events pane.
    ShowEvents,
    /// Show the Detail pane.
    ShowDetail,
    /// Show the Signals pane.
    ShowSignals,
    /// Set the filter.
    Filter(String),
    /// Select the node that all panes show.
    Node(NodeKey),
    /// Add a signal to the plot.
    Plot(SignalKey),
    /// Show a message in the status line.
    Say(String),
    /// Show in the status line that something is not possible.
    Refuse(String),
    /// Copy a text to the clipboard.
    Copy(String),
}
