//! A line of the Detail pane.

use cobscope_decoder::sink::escape;
use ratatui::text::{Line, Span};

use crate::state::JumpPlace;
use crate::theme::{TextRole, Theme};

/// Target of an item.
#[derive(Debug, Clone, PartialEq)]
pub(super) enum ItemTarget {
    /// No target.
    Nowhere,
    /// Index of a part of the payload.
    Part(usize),
    /// A position in time.
    Place(JumpPlace),
    /// Index of a frame of the transfer; its bits are shown.
    Frame(usize),
}

/// A line with its target and filter.
#[derive(Debug, Clone)]
pub(super) struct DetailItem {
    /// Words before the text, styled like a heading.
    label: String,
    text: String,
    role: TextRole,
    /// Lines shown below while the item is selected.
    pub(super) notes: Vec<String>,
    /// Target of Enter.
    pub(super) leads: ItemTarget,
    /// Filter for the field and value of this item.
    pub(super) filter: Option<String>,
    is_heading: bool,
}

impl DetailItem {
    /// An item without a target.
    pub(super) fn new(text: &str, role: TextRole) -> Self {
        Self {
            label: String::new(),
            text: escape(text).into_owned(),
            role,
            notes: Vec::new(),
            leads: ItemTarget::Nowhere,
            filter: None,
            is_heading: false,
        }
    }

    /// An item of minor importance.
    pub(super) fn minor_item(text: &str) -> Self {
        Self::new(text, TextRole::Quiet)
    }

    /// A heading; it cannot be selected.
    pub(super) fn heading_item(text: &str) -> Self {
        Self { is_heading: true, ..Self::new(text, TextRole::Title) }
    }

    /// A paragraph with its heading in front.
    pub(super) fn headed_item(label: &str, text: &str) -> Self {
        Self { label: escape(label).into_owned(), ..Self::new(text, TextRole::Text) }
    }

    /// Sets the target.
    pub(super) fn with_target(self, leads: ItemTarget) -> Self {
        Self { leads, ..self }
    }

    /// Sets a frame as the target.
    pub(super) fn at_frame(self, frame: u64) -> Self {
        self.with_target(ItemTarget::Place(JumpPlace::Frame(frame)))
    }

    /// Sets the filter.
    pub(super) fn with_filter(self, filter: Option<String>) -> Self {
        Self { filter, ..self }
    }

    /// Whether the item can be selected.
    pub(super) fn can_be_selected(&self) -> bool {
        !self.is_heading
    }

    /// Text for the clipboard.
    pub(super) fn clipboard_text(&self) -> String {
        format!("{}{}", self.label, self.text).trim().to_owned()
    }

    /// The item as styled lines; with its notes if it is selected.
    pub(super) fn styled_lines(&self, theme: &Theme, is_selected: bool) -> Vec<Line<'static>> {
        let mut style = theme.role_style(self.role);
        if is_selected {
            style = style.patch(theme.selection_style(true));
        }
        let label = Span::styled(self.label.clone(), theme.role_style(TextRole::Title));
        let text = Span::styled(self.text.clone(), style);
        let first = if self.label.is_empty() { Line::from(text) } else { Line::from(vec![label, text]) };
        let notes = self.notes.iter().filter(|_| is_selected);
        let note = |note: &String| Line::styled(format!("    {note}"), theme.role_style(TextRole::Quiet));
        std::iter::once(first).chain(notes.map(note)).collect()
    }
}
