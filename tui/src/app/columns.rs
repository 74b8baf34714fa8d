//! Choice of the columns of a pane.

use super::application::{App, InputMode, PromptPurpose};
use super::candidates::Candidate;

impl App {
    /// Opens the prompt for the columns of the pane.
    pub(super) fn ask_columns(&mut self) {
        let titles = self.panes.column_titles();
        if titles.is_empty() {
            return self.core.show_refusal("this pane has no columns");
        }
        self.open_prompt(PromptPurpose::Columns, "columns");
        let chosen = self.core.columns.get(self.panes.focus.name()).unwrap_or(&titles).join(", ");
        if let InputMode::Prompt(_, prompt) = &mut self.mode {
            prompt.set_text(&chosen);
        }
        self.refresh_prompt_row();
    }

    /// Chooses columns by their titles; all without a title.
    ///
    /// # Errors
    /// A title that the pane does not have.
    pub(super) fn choose_columns(&mut self, text: &str) -> Result<(), String> {
        let titles = self.panes.column_titles();
        let chosen = titles_of(text, &titles)?;
        let name = self.panes.focus.name().to_owned();
        if chosen.is_empty() || chosen.len() == titles.len() {
            self.core.columns.remove(&name);
        } else {
            self.core.columns.insert(name, chosen);
        }
        Ok(())
    }
}

/// The titles in a text with commas, in the order of the columns.
fn titles_of(text: &str, titles: &[String]) -> Result<Vec<String>, String> {
    let named: Vec<&str> = text.split(',').map(str::trim).filter(|title| !title.is_empty()).collect();
    let is = |title: &String, name: &str| title.to_lowercase() == name.to_lowercase();
    if let Some(unknown) = named.iter().find(|name| !titles.iter().any(|title| is(title, name))) {
        return Err(format!("no column {unknown}; columns: {}", titles.join(", ")));
    }
    let chosen = titles.iter().filter(|title| named.iter().any(|name| is(title, name)));
    Ok(chosen.cloned().collect())
}

/// Offset of the title at the end of `before`, and the titles that complete it.
pub(super) fn columns_left(titles: &[String], before: &str) -> (usize, Vec<Candidate>) {
    let list = before.rfind(',').map_or(0, |comma| comma + 1);
    let typed = before.get(list..).unwrap_or_default();
    let start = before.len() - typed.trim_start().len();
    let typed = typed.trim_start().to_lowercase();
    let is_open = |title: &&String| title.to_lowercase().starts_with(&typed) && title.to_lowercase() != typed;
    (start, titles.iter().filter(is_open).map(|title| Candidate::new(title, None)).collect())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn columns_are_named_in_any_order() {
        let titles = ["No", "Time", "Set → actual"].map(str::to_owned);
        assert_eq!(titles_of("set → ACTUAL, no,", &titles).unwrap(), ["No", "Set → actual"]);
        assert_eq!(titles_of("", &titles).unwrap(), [""; 0]);
        assert_eq!(titles_of("Tim", &titles).unwrap_err(), "no column Tim; columns: No, Time, Set → actual");
        let (start, left) = columns_left(&titles, "No, t");
        assert_eq!((start, left), (4, vec![Candidate::new("Time", None)]));
        assert_eq!(columns_left(&titles, "No, Time").1, []);
    }
}
