//! What the program remembers from run to run.

use std::collections::BTreeMap;

use crate::panes::PaneLayout;
use crate::theme::ThemePalette;

/// What the program remembers from run to run.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Preferences {
    /// Panes shown together; None: by the size of the terminal.
    pub layout: Option<PaneLayout>,
    /// Share of the left column of panes, in per cent.
    pub split: Option<u16>,
    /// The strip of time is shown.
    pub has_strip: bool,
    /// Colours for a dark or light background.
    pub palette: ThemePalette,
    /// Titles of the columns that are shown, by name of the pane.
    pub columns: BTreeMap<String, Vec<String>>,
}

impl Default for Preferences {
    fn default() -> Self {
        Self {
            layout: None,
            split: None,
            has_strip: true,
            palette: ThemePalette::default(),
            columns: BTreeMap::new(),
        }
    }
}
