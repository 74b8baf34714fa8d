//! Requests of a pane to the application.

use crate::state::{NodeKey, Place};
use crate::timeline::SignalKey;

/// What a pane, or the user, wants of the application.
#[derive(Debug, Clone, PartialEq)]
pub enum Effect {
    /// Move the cursor in time.
    Go(Place),
    /// Show the pane of events.
    ShowEvents,
    /// Show the pane with all of the event at the cursor.
    ShowDetail,
    /// Show the pane of signals.
    ShowSignals,
    /// Filter events.
    Filter(String),
    /// Make a node the one that panes tell of.
    Node(NodeKey),
    /// Put a signal on the plot.
    Plot(SignalKey),
    /// Say something below.
    Say(String),
    /// Say that something is not possible.
    Refuse(String),
    /// Put a text on the user's clipboard.
    Copy(String),
}
