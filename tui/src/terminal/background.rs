//! Background of the terminal: dark or light, by its answer to OSC 11.
//!
//! A terminal that answers late, as over a slow line, would type its answer into the program:
//! `ESC ] 11 ; rgb : ffff / ffff / ffff BEL`. [`LateAnswer`] removes it from the keys.

use std::time::Duration;

use ratatui::crossterm::event::{KeyCode, KeyEvent, KeyModifiers};
use terminal_colorsaurus::{Error, QueryOptions, background_color};

use crate::theme::ThemePalette;

/// Time limit of the answer.
const LIMIT: Duration = Duration::from_millis(300);

/// Perceived lightness between black, 0, and white, 1, above which a background is light.
const MIDDLE: f32 = 0.5;

/// Maximum number of keys of an answer.
const LONGEST: usize = 40;

/// Answer of the terminal.
pub struct BackgroundAnswer {
    /// None: no answer, or an unknown one.
    pub palette: Option<ThemePalette>,
    /// An answer may still come.
    pub may_come: bool,
}

/// Asks the terminal. The terminal must not be in use by the UI yet.
pub fn ask_terminal() -> BackgroundAnswer {
    let mut options = QueryOptions::default();
    options.timeout = LIMIT;
    match background_color(options) {
        Ok(color) => {
            let is_light = color.perceived_lightness() > MIDDLE;
            let palette = if is_light { ThemePalette::Light } else { ThemePalette::Dark };
            BackgroundAnswer { palette: Some(palette), may_come: false }
        }
        Err(error) => BackgroundAnswer { palette: None, may_come: matches!(error, Error::Timeout(_)) },
    }
}

/// Removes a late answer from the keys.
#[derive(Debug, Default)]
pub struct LateAnswer {
    is_expected: bool,
    /// Number of keys removed so far; None outside an answer.
    removed: Option<usize>,
}

impl LateAnswer {
    /// `is_expected`: the terminal was asked and did not answer in time.
    pub fn new(is_expected: bool) -> Self {
        Self { is_expected, removed: None }
    }

    /// Whether a key belongs to the answer.
    pub fn takes_key(&mut self, key: &KeyEvent) -> bool {
        let is = |letter, modifiers| key.code == KeyCode::Char(letter) && key.modifiers == modifiers;
        match self.removed {
            None if self.is_expected && is(']', KeyModifiers::ALT) => {
                (self.is_expected, self.removed) = (false, Some(1));
                true
            }
            None => false,
            Some(count) => {
                // BEL, or ESC and a backslash.
                let is_end = is('g', KeyModifiers::CONTROL) || is('\\', KeyModifiers::ALT);
                self.removed = if is_end || count >= LONGEST { None } else { Some(count + 1) };
                true
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn typed(late: &mut LateAnswer, first: KeyModifiers, text: &str, last: KeyEvent) -> String {
        let letters = text.chars().map(|letter| KeyEvent::new(KeyCode::Char(letter), KeyModifiers::NONE));
        let keys = std::iter::once(KeyEvent::new(KeyCode::Char(']'), first)).chain(letters).chain([last]);
        let seen = keys.filter(|key| !late.takes_key(key)).filter_map(|key| key.code.as_char());
        seen.collect()
    }

    #[test]
    fn a_late_answer_is_removed_once() {
        let bell = KeyEvent::new(KeyCode::Char('g'), KeyModifiers::CONTROL);
        let end = KeyEvent::new(KeyCode::Char('\\'), KeyModifiers::ALT);
        let answer = "11;rgb:ffff/ffff/ffff";
        for last in [bell, end] {
            let mut late = LateAnswer::new(true);
            assert_eq!(typed(&mut late, KeyModifiers::NONE, "q", bell), "]qg");
            assert_eq!(typed(&mut late, KeyModifiers::ALT, answer, last), "");
            assert_eq!(typed(&mut late, KeyModifiers::ALT, "1", bell), "]1g");
        }
        // Without an end the keys of the user come through again.
        let mut late = LateAnswer::new(true);
        assert_eq!(typed(&mut late, KeyModifiers::ALT, &"x".repeat(60), bell).len(), 21);
        assert_eq!(typed(&mut LateAnswer::new(false), KeyModifiers::ALT, "1", bell), "]1g");
    }
}
