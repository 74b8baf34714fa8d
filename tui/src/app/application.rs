//! The application: state, panes, and what keys mean at the moment.

use ratatui::crossterm::event::KeyEvent;
use ratatui::layout::Rect;

use super::output::Output;
use crate::panes::{PaneId, Panes};
use crate::state::Core;
use crate::timeline::News;
use crate::widgets::prompt::Prompt;

/// The application.
pub struct App {
    pub(super) core: Core,
    pub(super) panes: Panes,
    pub(super) pane: PaneId,
    /// Panes to go back to.
    pub(super) trail: Vec<PaneId>,
    pub(super) mode: Mode,
    /// Filter in force when another one began to be typed.
    pub(super) filter_before: String,
    /// Texts typed earlier, by what was asked.
    pub(super) typed: Vec<(Asking, String)>,
    pub(super) outputs: Vec<Output>,
    pub(super) area: Rect,
    /// Captures as the command line has them, to say how this view is had again.
    pub(super) command: String,
    /// Line clicked last, to tell a second click on it.
    pub(super) clicked: Option<(u16, u16)>,
    /// Keys pressed before anything was on the screen to which they could mean something.
    pub(super) early: Vec<KeyEvent>,
    /// The survey told that it is complete.
    pub(super) is_surveyed: bool,
}

/// What keys mean at the moment.
pub(super) enum Mode {
    /// Actions.
    Panes,
    /// A text is typed.
    Asking(Asking, Prompt),
    /// A letter is wanted: of a new mark, or of one to go to.
    Letter { is_new: bool },
    /// The help is shown from this line on.
    Help(usize),
}

/// What a text is typed for.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Asking {
    Filter,
    Search,
    GoTo,
    Export,
}

impl App {
    /// Takes what the background has found.
    pub fn news(&mut self, news: News) {
        match news {
            News::Window(window) => {
                self.core.answer(*window);
                for key in std::mem::take(&mut self.early) {
                    self.key(key);
                }
                // It may be from just before the index was complete, and come behind the news of that.
                if self.core.is_pending() && self.is_indexed() {
                    self.core.refresh();
                }
            }
            News::Exported(told) => self.core.exported(told),
            News::Failed(text) => self.core.refuse(&text),
            News::Filtered => self.core.refresh(),
            News::Grew => self.core.timeline.see_growth(),
            News::Indexed if self.core.is_pending() => self.core.refresh(),
            News::Surveyed => {
                self.is_surveyed = true;
                self.core.tell_unknown_buses();
            }
            News::Indexed | News::Traced => {}
        }
        self.refresh_panes();
    }

    pub(super) fn refresh_panes(&mut self) {
        for pane in self.panes.all_mut() {
            pane.refresh(&self.core);
        }
    }

    /// Time passed: follows what comes, if that is wanted.
    pub fn tick(&mut self) {
        self.core.follow();
    }

    /// What the terminal is to do, besides drawing.
    pub fn outputs(&mut self) -> Vec<Output> {
        std::mem::take(&mut self.outputs)
    }

    /// Whether what is at the place gone to is still on its way.
    pub fn is_seeking(&self) -> bool {
        self.core.is_waiting()
    }

    /// Whether the captures are read to their end.
    pub fn is_indexed(&self) -> bool {
        self.core.timeline.progress().is_complete()
    }

    /// Frames read so far.
    pub fn frames(&self) -> u64 {
        self.core.timeline.progress().frames()
    }

    /// Whether the buses are live, so that how they are may change without anything being read.
    pub fn is_live(&self) -> bool {
        self.core.timeline.live().is_some_and(|live| !live.get().has_ended)
    }

    /// Whether more is on its way without anything being done; growth is told.
    pub fn is_busy(&self) -> bool {
        let timeline = &self.core.timeline;
        let is_searching = timeline.matches().is_some_and(|matches| !matches.is_complete());
        self.core.is_waiting()
            || self.core.is_pending()
            || is_searching
            || timeline.is_tracing()
            || !(timeline.grows() || timeline.progress().is_complete() && self.is_surveyed)
    }
}
