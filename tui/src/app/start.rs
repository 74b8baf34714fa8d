//! Start of a view.

use std::fmt::Write as _;

use cobscope_decoder::query::Filter;

use super::added::{Reassign, quote_word};
use super::application::{App, InputMode};
use super::candidates::PromptRow;
use super::history::ViewHistory;
use super::jumps::ResultJumps;
use super::preferences::{Preferences, RememberedView};
use super::requests::{Compare, ReportOrders, WriteReport};
use super::shown_panes::ShownPanes;
use crate::keymap::Keymap;
use crate::panes::{PaneArrangement, PaneId};
use crate::select::RangeBound;
use crate::state::{CaptureDifferences, JumpPlace, OtherCapture, UiState};
use crate::theme::Theme;
use crate::timeline::{RowMatcher, Timeline};

/// Settings of a view from the command line and the config file.
pub struct ViewSettings {
    /// Command with its captures, without the settings of the view.
    pub command: String,
    /// Pane shown first.
    pub pane: PaneId,
    /// Layout, strip and colours of this run.
    pub preferences: Preferences,
    /// The same without a remembered view.
    pub defaults: Preferences,
    /// Keys of actions.
    pub keymap: Keymap,
    /// Evaluates options that are added while the program runs.
    pub reassign: Reassign,
    /// Starts writing report pages.
    pub write_report: WriteReport,
    /// Initial position of the cursor.
    pub at: Option<RangeBound>,
    /// Filter as text and parsed.
    pub filter: Option<(String, Filter)>,
    /// Show all events, not only changes.
    pub all: bool,
    /// Move the cursor to the end as the capture grows.
    pub follows: bool,
    /// Buses named by the user, with the option that names them; the captures may not contain them.
    pub named: Vec<(String, &'static str)>,
    /// File name of the capture that is compared with these captures, and the start of the comparison.
    pub against: Option<(String, Compare)>,
}

impl App {
    /// Shows a message in the status line.
    pub fn show_message(&mut self, text: &str) {
        self.core.show_message(text);
    }

    /// Opens a view of captures.
    pub fn new(timeline: Timeline, theme: Theme, start: ViewSettings) -> Self {
        let mut core = UiState::new(timeline, theme);
        let (text, filter) =
            start.filter.map_or((String::new(), None), |(text, filter)| (text, Some(filter)));
        core.filter = text;
        core.matcher = RowMatcher { filter, only_news: !start.all, text: None };
        core.timeline.start_search(core.matcher.clone());
        core.named = start.named;
        let (against, compare) = start.against.unzip();
        core.against = CaptureDifferences(against.as_deref().map(OtherCapture::new));
        core.columns = start.preferences.columns;
        let arrangement = PaneArrangement::new(start.preferences.layout, start.preferences.split);
        let mut app = Self {
            core,
            panes: ShownPanes::new(start.pane, arrangement, start.preferences.has_strip),
            keymap: start.keymap,
            remembered: RememberedView::new(start.defaults),
            reassign: start.reassign,
            assigning: None,
            reports: ReportOrders::new(start.write_report),
            compare,
            is_dragging: false,
            mode: InputMode::Panes,
            history: ViewHistory::default(),
            prompt_row: PromptRow::default(),
            filter_before: String::new(),
            typed: Vec::new(),
            outputs: Vec::new(),
            command: start.command,
            clicked: None,
            early: Vec::new(),
            jumps: ResultJumps {
                opens_at_story: start.at.is_none() && !start.follows,
                ..ResultJumps::default()
            },
        };
        app.history = ViewHistory::starting_with(app.panes.row_selection(&app.core));
        app.start_comparison();
        if start.follows {
            app.core.show_message("cobscope sends no frames; space pauses or resumes following");
            app.core.is_following = true;
            app.core.jump_to(JumpPlace::End);
        } else {
            // A requested time may not exist in a capture without timestamps; then the view starts here.
            app.core.jump_to(JumpPlace::Start);
            if let Some(bound) = start.at {
                app.core.go_to(bound);
            }
        }
        app
    }

    /// The command that opens this view again.
    pub(super) fn view_command(&self) -> String {
        // Writing to a string cannot fail.
        let mut command = format!("{} --pane {}", self.command, self.panes.focus.name());
        if let Some(layout) = self.panes.arrangement.chosen {
            let _ = write!(command, " --layout {}", layout.name());
        }
        // A live position does not exist in another run.
        if self.core.cursor.frame > 0 && self.core.timeline.live().is_none() {
            let _ = write!(command, " --at '#{}'", self.core.cursor.frame);
        }
        if !self.core.filter.is_empty() {
            let _ = write!(command, " --filter {}", quote_word(&self.core.filter));
        }
        if !self.core.matcher.only_news {
            command.push_str(" --all");
        }
        command
    }
}
