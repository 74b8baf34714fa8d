//! Settings of the terminal UI: options, then the remembered view, then the config file.

use super::output::enable_colors;
use crate::app::{App, Preferences};
use crate::cli::{Color, ScreenArgs};
use crate::config::Config;
use crate::keymap::Keymap;
use crate::panes::PaneId;
use crate::terminal::{Background, background};
use crate::theme::{Borders, Depth, Palette, Theme, ThemeName};

/// Settings of the terminal UI.
pub struct ScreenSettings {
    /// Colours and characters.
    pub theme: Theme,
    /// Pane shown first.
    pub pane: PaneId,
    /// Layout, strip and colours of this run.
    pub preferences: Preferences,
    /// The same without a remembered view.
    pub defaults: Preferences,
    /// Keys of actions.
    pub keymap: Keymap,
    /// The terminal was asked for its background and may still answer.
    pub may_answer: bool,
}

impl ScreenSettings {
    /// Settings of the user of a terminal.
    ///
    /// # Errors
    /// The config file is invalid.
    pub fn of_user(arguments: &ScreenArgs, color: Color) -> anyhow::Result<Self> {
        let (config, remembered) = (Config::of_user()?, Config::remembered());
        let is_plain = depth(color) == Depth::None;
        let theme = arguments.theme.or(remembered.theme).or(config.theme).unwrap_or(ThemeName::Auto);
        let answer = (theme == ThemeName::Auto && !is_plain).then(background);
        Ok(Self::new(arguments, color, config, remembered, answer.as_ref()))
    }

    /// Settings of the command line alone.
    pub fn of_options(arguments: &ScreenArgs, color: Color) -> Self {
        Self::new(arguments, color, Config::default(), Config::default(), None)
    }

    fn new(
        arguments: &ScreenArgs,
        color: Color,
        config: Config,
        remembered: Config,
        answer: Option<&Background>,
    ) -> Self {
        let asked = answer.and_then(|answer| answer.palette).unwrap_or_default();
        let preferences = |config: &Config| Preferences {
            layout: config.layout,
            split: config.split,
            has_strip: config.strip.unwrap_or(true),
            palette: match config.theme {
                Some(ThemeName::Light) => Palette::Light,
                Some(ThemeName::Dark) => Palette::Dark,
                Some(ThemeName::Auto) | None => asked,
            },
            columns: config.columns.clone().unwrap_or_default(),
        };
        let options = Config { theme: arguments.theme, layout: arguments.layout, ..Config::default() };
        let defaults = preferences(&options.clone().or(config.clone()));
        let config = options.or(remembered.or(config));
        let preferences = preferences(&config);
        let is_ascii = arguments.ascii || config.ascii.unwrap_or(false);
        let borders = if is_ascii { Borders::Ascii } else { Borders::Unicode };
        Self {
            theme: Theme::new(preferences.palette, depth(color), borders),
            pane: arguments.pane.or(config.pane).unwrap_or(PaneId::Events),
            preferences,
            defaults,
            keymap: config.keymap,
            may_answer: answer.is_some_and(|answer| answer.may_come),
        }
    }
}

/// Remembers layout, strip and colours if the user changed them, or removes the remembered choice.
///
/// # Errors
/// The file cannot be written or removed.
pub fn remember(app: &App, opened: &Preferences) -> anyhow::Result<()> {
    let Some(now) = app.preferences() else { return Config::forget() };
    if now == *opened {
        return Ok(());
    }
    let theme = (now.palette != opened.palette).then_some(match now.palette {
        Palette::Dark => ThemeName::Dark,
        Palette::Light => ThemeName::Light,
    });
    // Unchanged settings stay as they were remembered.
    let kept = Config::remembered();
    let config = Config {
        theme: theme.or(kept.theme),
        layout: now.layout,
        split: now.split,
        columns: Some(now.columns),
        strip: Some(now.has_strip).filter(|shown| *shown != opened.has_strip).or(kept.strip),
        ..Config::default()
    };
    config.remember()
}

/// Colours of the terminal.
fn depth(color: Color) -> Depth {
    let is_plain = match color {
        Color::Always => false,
        Color::Never => true,
        Color::Auto => std::env::var_os("NO_COLOR").is_some_and(|value| !value.is_empty()),
    };
    let has_many = std::env::var("COLORTERM").is_ok_and(|value| !value.is_empty())
        || std::env::var("TERM").is_ok_and(|value| value.contains("256") || value.contains("direct"))
        // Consoles of Windows with escape sequences have 256 colours and set no variable.
        || (cfg!(windows) && enable_colors());
    match (is_plain, has_many) {
        (true, _) => Depth::None,
        (_, true) => Depth::Full,
        _ => Depth::Sixteen,
    }
}
