//! Names like one that was never seen: it is most likely a slip.

use std::cell::RefCell;

use crate::profile::Layout;
use crate::query::fields::distance;

/// Letters that a slip changes at most.
const MOST_SLIPS: usize = 3;

/// Letters of a name from which on it is compared: each name of a layout is, once a layout.
const LONGEST: usize = 100;

/// The name most like the one looked for.
#[derive(Debug, Default)]
pub(super) struct Nearest(RefCell<Option<(usize, String)>>);

impl Nearest {
    /// Looks at the signals of a layout.
    pub(super) fn see_all(&self, wanted: &str, layout: &Layout) {
        layout.fields.iter().filter_map(|field| field.name()).for_each(|name| self.see(wanted, name));
    }

    /// Looks at a name.
    pub(super) fn see(&self, wanted: &str, name: &str) {
        let most = (wanted.chars().count() / 3).min(MOST_SLIPS);
        if wanted.len() > LONGEST || name.len() > LONGEST {
            return;
        }
        let slips = distance(&wanted.to_lowercase(), &name.to_lowercase());
        let mut best = self.0.borrow_mut();
        if slips <= most && best.as_ref().is_none_or(|(known, _)| slips < *known) {
            *best = Some((slips, name.to_owned()));
        }
    }

    /// What is said of it: nothing where none is like it.
    pub(super) fn hint(&self) -> String {
        let best = self.0.borrow();
        best.as_ref().map_or_else(String::new, |(_, name)| format!("; did you mean '{name}'?"))
    }
}
