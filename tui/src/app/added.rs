//! Options that are added while the program runs.

use cobscope_decoder::session::SessionOptions;

/// Suffixes of device files and of databases.
const DEVICE_FILES: [&str; 4] = ["eds", "dcf", "xdd", "xdc"];
const DATABASES: [&str; 2] = ["dbc", "json"];

/// An option that is added while the program runs.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum AddedOption {
    /// `--node`.
    Profile {
        /// Node as in the option: `5`, `can0:5`.
        place: String,
        /// Name of the profile.
        profile: String,
    },
    /// `--eds`.
    DeviceFile {
        /// Node as in the option.
        place: String,
        /// Path of an EDS, DCF, XDD or XDC.
        file: String,
    },
    /// `--dbc`, for all nodes.
    Database {
        /// Path of the file.
        file: String,
    },
}

/// Options of the decoder with an added one.
pub struct ReassignedOptions {
    /// All options.
    pub options: SessionOptions,
    /// Problems in files that are used nevertheless.
    pub problems: Vec<String>,
}

/// Evaluates an added option; the second argument are the present options.
pub type Reassign = Box<dyn FnMut(&AddedOption, &SessionOptions) -> anyhow::Result<ReassignedOptions>>;

/// Whether a name has the suffix of a device file or database.
pub(super) fn is_file(name: &str) -> bool {
    let suffix = lower_suffix(name);
    DEVICE_FILES.iter().chain(&DATABASES).any(|known| *known == suffix)
}

/// Suffix in lower case.
fn lower_suffix(name: &str) -> String {
    name.rsplit_once('.').map_or(String::new(), |(_, suffix)| suffix.to_ascii_lowercase())
}

impl AddedOption {
    /// The option for a text of the user: a file by its suffix, else the name of a profile.
    pub(super) fn option_for(text: &str, place: &str) -> Self {
        let suffix = lower_suffix(text);
        let (place, text) = (place.to_owned(), text.to_owned());
        if DEVICE_FILES.contains(&suffix.as_str()) {
            Self::DeviceFile { place, file: text }
        } else if DATABASES.contains(&suffix.as_str()) {
            Self::Database { file: text }
        } else {
            Self::Profile { place, profile: text }
        }
    }

    /// Option and value for a shell.
    pub(super) fn option_text(&self) -> String {
        match self {
            Self::Profile { place, profile } => {
                format!("--node {}", quote_word(&format!("{place}={profile}")))
            }
            Self::DeviceFile { place, file } => format!("--eds {}", quote_word(&format!("{place}={file}"))),
            Self::Database { file } => format!("--dbc {}", quote_word(file)),
        }
    }

    /// Node of the option.
    pub(super) fn option_node(&self) -> Option<&str> {
        match self {
            Self::Profile { place, .. } | Self::DeviceFile { place, .. } => Some(place),
            Self::Database { .. } => None,
        }
    }
}

/// Quotes a word for a shell.
pub fn quote_word(text: &str) -> String {
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
        assert_eq!(quote_word("a/b-c.log"), "a/b-c.log");
        assert_eq!(quote_word("kind == \"emcy\""), "'kind == \"emcy\"'");
        assert_eq!(quote_word("it's"), "'it'\\''s'");
        assert_eq!(quote_word(""), "''");
    }

    #[test]
    fn the_suffix_decides_what_is_assigned() {
        let words = |text: &str| AddedOption::option_for(text, "can0:5").option_text();
        assert_eq!(words("rexroth-sydfec"), "--node can0:5=rexroth-sydfec");
        assert_eq!(words("a b/pump.EDS"), "--eds 'can0:5=a b/pump.EDS'");
        assert_eq!(words("bus.dbc"), "--dbc bus.dbc");
    }
}
