//! How a view begins.

use std::fmt::Write as _;

use cobscope_decoder::query::Filter;
use ratatui::layout::Rect;

use super::application::{App, Mode};
use crate::panes::{PaneId, Panes};
use crate::select::Bound;
use crate::state::{Core, Place};
use crate::theme::Theme;
use crate::timeline::{Matcher, Timeline};

/// What the command line says of a view.
#[derive(Debug, Clone)]
pub struct Start {
    /// The command with its captures, without what the view itself keeps.
    pub command: String,
    /// Pane shown first.
    pub pane: PaneId,
    /// Where the cursor is.
    pub at: Option<Bound>,
    /// Filter as typed, and what it means.
    pub filter: Option<(String, Filter)>,
    /// Repetitions too.
    pub all: bool,
    /// Goes to the end as more comes.
    pub follows: bool,
    /// Buses the user names, and by what: the captures may not have them.
    pub named: Vec<(String, &'static str)>,
}

impl App {
    /// Looks at captures.
    pub fn new(timeline: Timeline, theme: Theme, start: Start) -> Self {
        let mut core = Core::new(timeline, theme);
        let (text, filter) =
            start.filter.map_or((String::new(), None), |(text, filter)| (text, Some(filter)));
        core.filter = text;
        core.matcher = Matcher { filter, only_news: !start.all, text: None };
        core.timeline.search(core.matcher.clone());
        core.named = start.named;
        let mut app = Self {
            core,
            panes: Panes::default(),
            pane: start.pane,
            trail: Vec::new(),
            mode: Mode::Panes,
            filter_before: String::new(),
            typed: Vec::new(),
            outputs: Vec::new(),
            area: Rect::new(0, 0, 80, 24),
            command: start.command,
            clicked: None,
            early: Vec::new(),
            is_surveyed: false,
        };
        if start.follows {
            app.core.say("listening only: nothing is transmitted; space stops following, and follows again");
            app.core.is_following = true;
            app.core.go(Place::End);
        } else {
            // A time may be wanted of a capture without times: then this is where it begins.
            app.core.go(Place::Start);
            if let Some(bound) = start.at {
                app.core.go_to(bound);
            }
        }
        app
    }

    /// The command that shows this view again.
    pub(super) fn command(&self) -> String {
        // Writing to a string cannot fail.
        let mut command = format!("{} --pane {}", self.command, self.pane.name());
        // A bus cannot be gone back to by another run.
        if self.core.cursor.frame > 0 && self.core.timeline.live().is_none() {
            let _ = write!(command, " --at '#{}'", self.core.cursor.frame);
        }
        if !self.core.filter.is_empty() {
            let _ = write!(command, " --filter {}", quoted(&self.core.filter));
        }
        if !self.core.matcher.only_news {
            command.push_str(" --all");
        }
        command
    }
}

/// A word for a shell.
pub fn quoted(text: &str) -> String {
    let is_plain = |byte: u8| byte.is_ascii_alphanumeric() || b"-_./:@=+,%".contains(&byte);
    if !text.is_empty() && text.bytes().all(is_plain) {
        return text.to_owned();
    }
    format!("'{}'", text.replace('\'', "'\\''"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn words_are_quoted_for_a_shell() {
        assert_eq!(quoted("a/b-c.log"), "a/b-c.log");
        assert_eq!(quoted("kind == \"emcy\""), "'kind == \"emcy\"'");
        assert_eq!(quoted("it's"), "'it'\\''s'");
        assert_eq!(quoted(""), "''");
    }
}
