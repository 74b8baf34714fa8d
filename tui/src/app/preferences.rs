//! What the program remembers from run to run.

use std::collections::BTreeMap;

use super::shown_panes::ShownPanes;
use crate::panes::{PaneArrangement, PaneLayout, SPLIT};
use crate::state::UiState;
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

/// The view that is remembered, unless the user discards it.
pub(super) struct RememberedView {
    /// Layout, strip and colours without a remembered view.
    defaults: Preferences,
    /// The user discarded the remembered view.
    pub(super) is_forgotten: bool,
}

impl RememberedView {
    pub(super) fn new(defaults: Preferences) -> Self {
        Self { defaults, is_forgotten: false }
    }

    /// Layout, strip and colours as they are now; None if the user discarded the remembered view and changed
    /// nothing since.
    pub(super) fn changed_preferences(&self, panes: &ShownPanes, core: &UiState) -> Option<Preferences> {
        let split = panes.arrangement.split_share();
        let now = Preferences {
            layout: panes.arrangement.chosen,
            split: Some(split).filter(|split| *split != SPLIT || self.defaults.split.is_some()),
            has_strip: panes.has_strip,
            palette: core.theme.palette(),
            columns: core.columns.clone(),
        };
        if self.is_forgotten && now == self.defaults { None } else { Some(now) }
    }

    /// Discards the remembered view.
    pub(super) fn forget_view(&mut self, panes: &mut ShownPanes, core: &mut UiState) {
        self.is_forgotten = true;
        panes.arrangement = PaneArrangement::new(self.defaults.layout, self.defaults.split);
        panes.has_strip = self.defaults.has_strip;
        core.columns = self.defaults.columns.clone();
        core.theme = core.theme.with_colours(self.defaults.palette, core.theme.depth());
        panes.update_size(core);
        core.show_message("the remembered layout, split, strip, columns and colours are discarded");
    }
}
