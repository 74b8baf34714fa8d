//! Settings of the terminal UI: options, then the remembered view, then the config file.

use std::collections::BTreeSet;

use clap::Args;

use crate::app::{App, Preferences};
use crate::config::{Config, PaneColumns};
use crate::keymap::Keymap;
use crate::panes::{PaneArrangement, PaneId, PaneLayout};
use crate::run::arguments::Color;
use crate::run::output::enable_colors;
use crate::terminal::{BackgroundAnswer, background};
use crate::theme::{ColorDepth, LineCharacters, Theme, ThemeName, ThemePalette};

/// Options for the screen.
#[derive(Debug, Args)]
pub struct ScreenArgs {
    /// Show PANE first (default: events)
    #[arg(long, value_name = "PANE")]
    pub pane: Option<PaneId>,
    /// Show the panes of LAYOUT together (default: one; in a large terminal diagnose)
    #[arg(long, value_name = "LAYOUT")]
    pub layout: Option<PaneLayout>,
    /// Use colours for a dark or light background (default: auto)
    #[arg(long, value_name = "THEME")]
    pub theme: Option<ThemeName>,
    /// Show only ASCII characters; others become their substitute or ?
    #[arg(long)]
    pub ascii: bool,
}

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
        let (config, remembered) = (Config::of_user()?, Config::remembered_view());
        let is_plain = color_depth(color) == ColorDepth::None;
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
        answer: Option<&BackgroundAnswer>,
    ) -> Self {
        let asked = answer.and_then(|answer| answer.palette).unwrap_or_default();
        let preferences = |config: &Config| Preferences {
            layout: config.layout,
            // As the panes are drawn: a share beyond the limits is not a change of the user.
            split: config.split.map(|split| PaneArrangement::new(None, Some(split)).split_share()),
            has_strip: config.strip.unwrap_or(true),
            palette: match config.theme {
                Some(ThemeName::Light) => ThemePalette::Light,
                Some(ThemeName::Dark) => ThemePalette::Dark,
                Some(ThemeName::Auto) | None => asked,
            },
            columns: chosen_columns(config.columns.clone().unwrap_or_default()),
        };
        let options = Config { theme: arguments.theme, layout: arguments.layout, ..Config::default() };
        let defaults = preferences(&options.clone().or_else_from(config.clone()));
        let config = options.or_else_from(remembered.or_else_from(config));
        let preferences = preferences(&config);
        let is_ascii = arguments.ascii || config.ascii.unwrap_or(false);
        let borders = if is_ascii { LineCharacters::Ascii } else { LineCharacters::Unicode };
        Self {
            theme: Theme::new(preferences.palette, color_depth(color), borders),
            pane: arguments.pane.or(config.pane).unwrap_or(PaneId::Events),
            preferences,
            defaults,
            keymap: config.keymap,
            may_answer: answer.is_some_and(|answer| answer.may_come),
        }
    }
}

/// Remembers the settings that the user changed, or removes the remembered choice.
///
/// # Errors
/// The file cannot be written or removed.
pub fn remember_settings(app: &App, settings: &ScreenSettings) -> anyhow::Result<()> {
    let Some(now) = app.changed_preferences() else { return Config::forget_view() };
    // After ctrl-r the view started again without a remembered choice.
    let (opened, kept) = if app.is_forgotten() {
        (&settings.defaults, Config::default())
    } else {
        (&settings.preferences, Config::remembered_view())
    };
    if now == *opened {
        return Ok(());
    }
    changed_settings(&now, opened, kept).remember_view()
}

/// The settings that changed since `opened`; all others stay as they were remembered. A setting of the command
/// line or of the config file is not remembered.
fn changed_settings(now: &Preferences, opened: &Preferences, kept: Config) -> Config {
    let palette = match now.palette {
        ThemePalette::Dark => ThemeName::Dark,
        ThemePalette::Light => ThemeName::Light,
    };
    let mut columns = kept.columns.unwrap_or_default();
    let panes: BTreeSet<&String> = now.columns.keys().chain(opened.columns.keys()).collect();
    for pane in panes.into_iter().filter(|pane| now.columns.get(*pane) != opened.columns.get(*pane)) {
        // An empty list means all columns, also if the config file chooses some.
        columns.insert(pane.clone(), now.columns.get(pane).cloned().unwrap_or_default());
    }
    Config {
        theme: if now.palette == opened.palette { kept.theme } else { Some(palette) },
        layout: if now.layout == opened.layout { kept.layout } else { now.layout },
        split: if now.split == opened.split { kept.split } else { now.split },
        columns: Some(columns).filter(|columns| !columns.is_empty()),
        strip: if now.has_strip == opened.has_strip { kept.strip } else { Some(now.has_strip) },
        ..Config::default()
    }
}

/// Columns without the empty lists, which mean all columns.
fn chosen_columns(columns: PaneColumns) -> PaneColumns {
    columns.into_iter().filter(|(_, titles)| !titles.is_empty()).collect()
}

/// Colours of the terminal.
fn color_depth(color: Color) -> ColorDepth {
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
        (true, _) => ColorDepth::None,
        (_, true) => ColorDepth::Full,
        _ => ColorDepth::Sixteen,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::panes::PaneLayout;

    fn columns(pane: &str, titles: &[&str]) -> (String, Vec<String>) {
        (pane.to_owned(), titles.iter().map(|title| (*title).to_owned()).collect())
    }

    /// Layout and split by the command line, columns by the config file; the user hides the strip.
    #[test]
    fn only_settings_that_a_key_changed_are_remembered() {
        let opened = Preferences {
            layout: Some(PaneLayout::One),
            split: Some(40),
            columns: [columns("events", &["No"])].into(),
            ..Preferences::default()
        };
        let now = Preferences { has_strip: false, ..opened.clone() };
        let found = changed_settings(&now, &opened, Config::default());
        assert_eq!((found.layout, found.split, found.strip), (None, None, Some(false)));
        assert!(found.columns.is_none() && found.theme.is_none());
        // The remembered settings stay.
        let kept = Config { layout: Some(PaneLayout::List), split: Some(62), ..Config::default() };
        let now = Preferences { palette: ThemePalette::Light, ..opened.clone() };
        let found = changed_settings(&now, &opened, kept);
        assert_eq!((found.layout, found.split, found.strip), (Some(PaneLayout::List), Some(62), None));
        assert_eq!(found.theme, Some(ThemeName::Light));
    }

    #[test]
    fn a_setting_changed_back_to_its_default_replaces_the_remembered_one() {
        let opened = Preferences { split: Some(62), ..Preferences::default() };
        let kept = Config { split: Some(62), ..Config::default() };
        assert_eq!(changed_settings(&Preferences::default(), &opened, kept).split, None);
    }

    #[test]
    fn columns_are_remembered_by_pane() {
        let opened = Preferences {
            columns: [columns("events", &["No"]), columns("nodes", &["Name"])].into(),
            ..Preferences::default()
        };
        // The user shows all columns of the nodes again, and chooses those of the frames.
        let now = Preferences {
            columns: [columns("events", &["No"]), columns("frames", &["ID"])].into(),
            ..Preferences::default()
        };
        let found = changed_settings(&now, &opened, Config::default()).columns.unwrap();
        assert_eq!(found, [columns("frames", &["ID"]), columns("nodes", &[])].into());
        // The config file still chooses those of the events.
        let file = Config { columns: Some(opened.columns.clone()), ..Config::default() };
        let read = Config { columns: Some(found), ..Config::default() }.or_else_from(file);
        let expected = [columns("events", &["No"]), columns("frames", &["ID"])];
        assert_eq!(chosen_columns(read.columns.unwrap()), expected.into());
    }
}
