//! One line of the detail pane.

use cobscope_decoder::sink::escape;
use ratatui::text::{Line, Span};

use crate::state::Place;
use crate::theme::{Role, Theme};

/// What an item leads to.
#[derive(Debug, Clone, PartialEq)]
pub(super) enum Leads {
    /// Nowhere: it is only read.
    Nowhere,
    /// A part of the payload.
    Part(usize),
    /// A place in time.
    Place(Place),
    /// A frame of the exchange, whose bits it shows.
    Frame(usize),
}

/// One thing said.
#[derive(Debug, Clone)]
pub(super) struct Item {
    /// Words before the text, in the look of a heading.
    label: String,
    text: String,
    role: Role,
    /// Lines below it while the cursor is on it.
    pub(super) notes: Vec<String>,
    /// What Enter does on it.
    pub(super) leads: Leads,
    /// The filter that wants what it says.
    pub(super) filter: Option<String>,
    is_heading: bool,
}

impl Item {
    /// A line.
    pub(super) fn new(text: &str, role: Role) -> Self {
        Self {
            label: String::new(),
            text: escape(text).into_owned(),
            role,
            notes: Vec::new(),
            leads: Leads::Nowhere,
            filter: None,
            is_heading: false,
        }
    }

    /// A line beside the point.
    pub(super) fn quiet(text: &str) -> Self {
        Self::new(text, Role::Quiet)
    }

    /// A heading, which the cursor passes over.
    pub(super) fn heading(text: &str) -> Self {
        Self { is_heading: true, ..Self::new(text, Role::Title) }
    }

    /// A paragraph with its heading before it.
    pub(super) fn headed(label: &str, text: &str) -> Self {
        Self { label: escape(label).into_owned(), ..Self::new(text, Role::Text) }
    }

    /// The same with a place to go to.
    pub(super) fn leading(self, leads: Leads) -> Self {
        Self { leads, ..self }
    }

    /// The same with a frame to go to.
    pub(super) fn at(self, frame: u64) -> Self {
        self.leading(Leads::Place(Place::Frame(frame)))
    }

    /// The same with a filter.
    pub(super) fn filtered(self, filter: Option<String>) -> Self {
        Self { filter, ..self }
    }

    /// Whether the cursor can be on it.
    pub(super) fn can_be_selected(&self) -> bool {
        !self.is_heading
    }

    /// The text as it is copied.
    pub(super) fn text(&self) -> String {
        format!("{}{}", self.label, self.text).trim().to_owned()
    }

    /// How it is drawn.
    pub(super) fn lines(&self, theme: &Theme, is_selected: bool) -> Vec<Line<'static>> {
        let mut style = theme.style(self.role);
        if is_selected {
            style = style.patch(theme.selection(true));
        }
        let label = Span::styled(self.label.clone(), theme.style(Role::Title));
        let text = Span::styled(self.text.clone(), style);
        let first = if self.label.is_empty() { Line::from(text) } else { Line::from(vec![label, text]) };
        let notes = self.notes.iter().filter(|_| is_selected);
        let note = |note: &String| Line::styled(format!("    {note}"), theme.style(Role::Quiet));
        std::iter::once(first).chain(notes.map(note)).collect()
    }
}
