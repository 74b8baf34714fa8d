//! Suggestion of a similar name for a name that did not occur.

use std::cell::RefCell;

use crate::profile::PayloadLayout;
use crate::query::fields::edit_distance;

/// Maximum edit distance of a suggestion.
const MOST_SLIPS: usize = 3;

/// Names longer than this are not compared, since each name of a layout is compared once per layout.
const LONGEST: usize = 100;

/// Most similar name so far, with its edit distance.
#[derive(Debug, Default)]
pub(super) struct NearestName(RefCell<Option<(usize, String)>>);

impl NearestName {
    /// Compares all signals of a layout.
    pub(super) fn see_all(&self, wanted: &str, layout: &PayloadLayout) {
        layout
            .fields
            .iter()
            .filter_map(|field| field.name())
            .for_each(|name| self.compare_name(wanted, name));
    }

    /// Compares one name.
    pub(super) fn compare_name(&self, wanted: &str, name: &str) {
        let most = (wanted.chars().count() / 3).min(MOST_SLIPS);
        if wanted.len() > LONGEST || name.len() > LONGEST {
            return;
        }
        let slips = edit_distance(&wanted.to_lowercase(), &name.to_lowercase());
        let mut best = self.0.borrow_mut();
        if slips <= most && best.as_ref().is_none_or(|(known, _)| slips < *known) {
            *best = Some((slips, name.to_owned()));
        }
    }

    /// Suggestion as text; empty if no similar name occurred.
    pub(super) fn hint_text(&self) -> String {
        let best = self.0.borrow();
        best.as_ref().map_or_else(String::new, |(_, name)| format!("; did you mean '{name}'?"))
    }
}
