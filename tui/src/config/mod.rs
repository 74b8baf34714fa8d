//! The config file of the terminal UI, and the view that is remembered from run to run.
//!
//! ```text
//! $XDG_CONFIG_HOME/cobscope/config.toml   written by the user: theme, ascii, pane, layout, split, strip, [parse_columns],
//!                                         [keys_for]
//! $XDG_STATE_HOME/cobscope/view.toml      written by the program: theme, layout, split, strip, [parse_columns]
//! ```
//!
//! An option of the command line overrides the remembered view, which overrides the config file.

mod folders;

use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::io::ErrorKind;
use std::path::{Path, PathBuf};

use anyhow::Context as _;
use clap::ValueEnum;
use serde::Deserialize;
use toml::Spanned;

use crate::keymap::Keymap;
use crate::output_file::{self, ExistingFile};
use crate::panes::{PaneId, PaneLayout, Panes};
use crate::path_text::path_text;
use crate::theme::ThemeName;

pub use folders::config_folder as folder;

/// Maximum size of a config file, in bytes.
const LARGEST: u64 = 64 * 1024;

/// Titles of columns by name of the pane; an empty list means all columns.
pub type PaneColumns = BTreeMap<String, Vec<String>>;

/// Settings of the terminal UI; `None`: not set.
#[derive(Debug, Clone, Default)]
pub struct Config {
    /// Colours for a dark or light background, or by the terminal.
    pub theme: Option<ThemeName>,
    /// Only ASCII characters.
    pub ascii: Option<bool>,
    /// Pane shown first.
    pub pane: Option<PaneId>,
    /// Panes shown together.
    pub layout: Option<PaneLayout>,
    /// Share of the left column of panes, in per cent.
    pub split: Option<u16>,
    /// The strip of time is shown.
    pub strip: Option<bool>,
    /// Titles of the columns that are shown, by name of the pane.
    pub columns: Option<PaneColumns>,
    /// Keys of actions.
    pub keymap: Keymap,
}

/// The file as it is written.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct ConfigFile {
    theme: Option<Spanned<String>>,
    ascii: Option<bool>,
    pane: Option<Spanned<String>>,
    layout: Option<Spanned<String>>,
    split: Option<u16>,
    strip: Option<bool>,
    columns: Option<BTreeMap<Spanned<String>, Vec<Spanned<String>>>>,
    #[serde(default)]
    keys: BTreeMap<Spanned<String>, Spanned<KeyNames>>,
}

/// One key or several.
#[derive(Deserialize)]
#[serde(untagged, expecting = "expected a key, or a list of keys")]
enum KeyNames {
    One(String),
    Several(Vec<String>),
}

impl Config {
    /// Reads the config file of the user; without a file nothing is set.
    ///
    /// # Errors
    /// The file cannot be read or is invalid; the message names file, line and column.
    pub fn of_user() -> anyhow::Result<Self> {
        folders::config_folder()
            .map_or_else(|| Ok(Self::default()), |folder| Self::read(&folder.join("config.toml")))
    }

    /// Reads a file; without it nothing is set.
    fn read(path: &Path) -> anyhow::Result<Self> {
        let name = path_text(path);
        let size = match path.metadata() {
            Ok(metadata) => metadata.len(),
            Err(error) if error.kind() == ErrorKind::NotFound => return Ok(Self::default()),
            Err(error) => return Err(error).with_context(|| format!("{name}: cannot be read")),
        };
        anyhow::ensure!(size <= LARGEST, "{name}: {size} bytes; a config file has at most {LARGEST}");
        let text = std::fs::read_to_string(path).with_context(|| format!("{name}: cannot be read"))?;
        Self::parse(&text).map_err(|(offset, reason)| {
            let (line, column) = line_and_column(&text, offset);
            anyhow::anyhow!("{name}:{line}:{column}: {reason}")
        })
    }

    /// Parses the text of a file; an error has a byte offset and a message.
    fn parse(text: &str) -> Result<Self, (usize, String)> {
        let file: ConfigFile = toml::from_str(text).map_err(|error| {
            let at = error.span().map_or(0, |span| span.start);
            (at, error.message().trim().replace('\n', "; "))
        })?;
        let mut keymap = Keymap::default();
        for (action, names) in &file.keys {
            let keys = match names.get_ref() {
                KeyNames::One(name) => vec![name.clone()],
                KeyNames::Several(names) => names.clone(),
            };
            keymap.bind_action(action.get_ref(), &keys).map_err(|reason| (action.span().start, reason))?;
        }
        Ok(Self {
            theme: parse_choice("theme", file.theme)?,
            ascii: file.ascii,
            pane: parse_choice("pane", file.pane)?,
            layout: parse_choice("layout", file.layout)?,
            split: file.split,
            strip: file.strip,
            columns: file.columns.map(parse_columns).transpose()?,
            keymap,
        })
    }

    /// The remembered view; nothing is set if there is none or if it is damaged.
    pub fn remembered_view() -> Self {
        memory_path().and_then(|path| Self::read(&path).ok()).unwrap_or_default()
    }

    /// The settings of another file where this one has none.
    #[must_use]
    pub fn or_else_from(self, other: Self) -> Self {
        Self {
            theme: self.theme.or(other.theme),
            ascii: self.ascii.or(other.ascii),
            pane: self.pane.or(other.pane),
            layout: self.layout.or(other.layout),
            split: self.split.or(other.split),
            strip: self.strip.or(other.strip),
            columns: merge_columns(self.columns, other.columns),
            keymap: other.keymap,
        }
    }

    /// Remembers the view for the next run.
    ///
    /// # Errors
    /// The file cannot be written.
    pub fn remember_view(&self) -> anyhow::Result<()> {
        let Some(path) = memory_path() else { return Ok(()) };
        if let Some(folder) = path.parent() {
            std::fs::create_dir_all(folder).with_context(|| path_text(folder))?;
        }
        output_file::write_file(&path, ExistingFile::Replace, self.settings_text().as_bytes())
            .with_context(|| path_text(&path))
    }

    /// Removes the remembered view.
    ///
    /// # Errors
    /// The file cannot be removed.
    pub fn forget_view() -> anyhow::Result<()> {
        match memory_path().map(|path| (std::fs::remove_file(&path), path)) {
            Some((Err(error), path)) if error.kind() != ErrorKind::NotFound => {
                Err(error).with_context(|| path_text(&path))
            }
            _ => Ok(()),
        }
    }

    /// The remembered settings as a file.
    fn settings_text(&self) -> String {
        let mut text = String::from("# The view of the last run; ctrl-r in the program discards it.\n");
        // Writing to a string cannot fail.
        if let Some(theme) = self.theme.and_then(|theme| theme.to_possible_value()) {
            let _ = writeln!(text, "theme = {:?}", theme.get_name());
        }
        if let Some(layout) = self.layout {
            let _ = writeln!(text, "layout = {:?}", layout.name());
        }
        if let Some(split) = self.split {
            let _ = writeln!(text, "split = {split}");
        }
        if let Some(strip) = self.strip {
            let _ = writeln!(text, "strip = {strip}");
        }
        if let Some(columns) = &self.columns {
            text.push_str("[columns]\n");
            for (pane, titles) in columns {
                let _ = writeln!(text, "{pane} = {titles:?}");
            }
        }
        text
    }
}

/// Chosen columns by name of the pane; `first` takes precedence.
fn merge_columns(first: Option<PaneColumns>, second: Option<PaneColumns>) -> Option<PaneColumns> {
    match (first, second) {
        (Some(first), Some(mut all)) => {
            all.extend(first);
            Some(all)
        }
        (first, second) => first.or(second),
    }
}

/// Columns of panes; both must exist.
fn parse_columns(
    found: BTreeMap<Spanned<String>, Vec<Spanned<String>>>,
) -> Result<PaneColumns, (usize, String)> {
    let panes = Panes::default();
    let mut all = BTreeMap::new();
    for (name, titles) in found {
        let at = name.span().start;
        let id = PaneId::ALL.iter().find(|id| id.name() == name.get_ref());
        let pane =
            id.and_then(|id| panes.get(*id)).ok_or_else(|| (at, format!("no pane {:?}", name.get_ref())))?;
        let known: Vec<String> = pane.table_heads().into_iter().map(|head| head.title.into_owned()).collect();
        if let Some(title) = titles.iter().find(|title| !known.contains(title.get_ref())) {
            let known: Vec<&str> =
                known.iter().map(String::as_str).filter(|known| !known.is_empty()).collect();
            let text = format!("no column {:?}; columns: {}", title.get_ref(), known.join(", "));
            return Err((title.span().start, text));
        }
        all.insert(name.into_inner(), titles.into_iter().map(Spanned::into_inner).collect());
    }
    Ok(all)
}

/// File of the remembered view.
fn memory_path() -> Option<PathBuf> {
    Some(folders::state_folder()?.join("view.toml"))
}

/// One of the values that the command line has too.
fn parse_choice<T: ValueEnum>(
    key: &str,
    found: Option<Spanned<String>>,
) -> Result<Option<T>, (usize, String)> {
    let Some(found) = found else { return Ok(None) };
    T::from_str(found.get_ref(), false).map(Some).map_err(|_| {
        let known = T::value_variants()
            .iter()
            .filter_map(|value| Some(value.to_possible_value()?.get_name().to_owned()));
        let known: Vec<_> = known.collect();
        (found.span().start, format!("{key} = {:?}: expected {}", found.get_ref(), known.join(", ")))
    })
}

/// Line and column of a byte offset, both from 1.
fn line_and_column(text: &str, offset: usize) -> (usize, usize) {
    let before = text.get(..offset).unwrap_or(text);
    let line = before.bytes().filter(|byte| *byte == b'\n').count() + 1;
    (line, before.chars().rev().take_while(|letter| *letter != '\n').count() + 1)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::action::Action;

    #[test]
    fn a_file_sets_what_it_names() {
        let text = "theme = \"light\"\nlayout = \"list\"\nsplit = 70\nstrip = false\n[columns]\nframes = [\"ID\", \"Data\"]\n[keys]\nplot = \"P\"\nfilter = [\"F\", \"f3\"]\n";
        let config = Config::parse(text).unwrap();
        assert_eq!((config.theme, config.layout), (Some(ThemeName::Light), Some(PaneLayout::List)));
        assert_eq!((config.split, config.strip, config.ascii), (Some(70), Some(false), None));
        assert_eq!(config.keymap.keys_for(Action::Filter), ["F", "f3"]);
        // The remembered settings can be read again and go first.
        let remembered = Config::parse(&config.settings_text()).unwrap();
        assert_eq!(remembered.layout, Some(PaneLayout::List));
        assert_eq!(remembered.columns.unwrap().get("frames").unwrap(), &["ID", "Data"]);
        let both = Config { layout: Some(PaneLayout::One), ..Config::default() }.or_else_from(config);
        assert_eq!((both.layout, both.theme), (Some(PaneLayout::One), Some(ThemeName::Light)));
        assert_eq!(both.keymap.keys_for(Action::Plot), ["P"]);
    }

    #[test]
    fn the_documented_file_is_valid_and_names_everything() {
        let path = concat!(env!("CARGO_MANIFEST_DIR"), "/../docs/config.toml");
        let config = Config::read(Path::new(path)).unwrap();
        assert!(config.theme.is_some() && config.ascii.is_some() && config.pane.is_some());
        assert!(config.layout.is_some() && config.split.is_some() && config.strip.is_some());
        assert!(config.columns.is_some());
    }

    #[test]
    fn errors_name_the_place() {
        let wrong = |text: &str| Config::parse(text).map(|_| ()).unwrap_err();
        let (at, reason) = wrong("theme = \"drak\"");
        assert_eq!((at, reason.as_str()), (8, "theme = \"drak\": expected auto, dark, light"));
        let (at, reason) = wrong("\nlayuot = \"one\"");
        assert!(at == 1 && reason.contains("unknown field `layuot`"), "{at} {reason}");
        assert_eq!(wrong("[keys]\nplod = \"P\""), (7, "no action \"plod\"; did you mean plot?".to_owned()));
        assert_eq!(wrong("[keys]\nplot = 5").1, "expected a key, or a list of keys");
        assert_eq!(wrong("split = \"wide\"").0, 8);
        let (at, reason) = wrong("[columns]\nnodes = [\"Nod\"]");
        assert!(at == 19 && reason.starts_with("no column \"Nod\"; columns: ID/hex"), "{at} {reason}");
        assert_eq!(wrong("[columns]\nnods = []").1, "no pane \"nods\"");
        assert_eq!(line_and_column("a\nbc\n", 3), (2, 2));
    }

    #[test]
    fn a_missing_file_is_no_error_and_a_wrong_one_names_its_line() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("config.toml");
        assert!(Config::read(&path).unwrap().theme.is_none());
        std::fs::write(&path, "strip = true\npane = \"evnts\"\n").unwrap();
        let error = Config::read(&path).unwrap_err().to_string();
        assert!(error.contains("config.toml:2:8: pane = \"evnts\": expected why, nodes, events"), "{error}");
    }
}
