//! Compiled TOML files of `decoder/profiles/`, embedded by the build script.

use super::compiled;

include!(concat!(env!("OUT_DIR"), "/profiles.rs"));

/// Loads an embedded file. The fallback to an empty table is unreachable: a test reads every file.
pub(super) fn parse_embedded<T: serde::de::DeserializeOwned + Default>(path: &str) -> T {
    let file = FILES.iter().find(|(name, ..)| *name == path);
    file.and_then(|(_, _, compiled)| compiled::read_compiled(compiled).ok()).unwrap_or_default()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn compiled_files_say_what_their_text_says() {
        assert!(FILES.len() >= 9);
        for (path, text, compiled) in FILES {
            let table: toml::Table = toml::from_str(text).unwrap();
            assert_eq!(compiled::read_compiled::<toml::Table>(compiled).unwrap(), table, "{path}");
        }
    }
}
