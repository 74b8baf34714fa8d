//! Name of the machine of a capture, and its form in paths.

use std::fmt::Write as _;
use std::path::Path;

use anyhow::{bail, ensure};
use cobscope_decoder::sink::escape;

use crate::cli::LakeAddArgs;
use crate::path_text::shown;

/// Name of a machine that nothing names.
const UNKNOWN: &str = "unknown";

/// Longest name, in characters; escaped it fits into a path component of every file system.
const LONGEST: usize = 64;

/// Partition of missing values in Hive, which no machine may have.
const HIVE_NULL: &str = "__HIVE_DEFAULT_PARTITION__";

/// Name of the machine of a capture: of the option, of the path, or of the bus file.
///
/// # Errors
/// The path does not match the pattern.
pub(super) fn machine_of(
    path: &Path,
    arguments: &LakeAddArgs,
    of_bus_file: Option<&str>,
) -> anyhow::Result<String> {
    if let Some(name) = &arguments.machine {
        return Ok(name.clone());
    }
    if let Some(pattern) = &arguments.machine_from {
        let text = path.display().to_string();
        let text = if cfg!(windows) { text.replace('\\', "/") } else { text };
        return match pattern.name(&text) {
            Some(name) => Ok(name.to_owned()),
            None => bail!("{}: no match of --machine-from {}", shown(path), escape(pattern.text())),
        };
    }
    Ok(of_bus_file.unwrap_or(UNKNOWN).to_owned())
}

/// Name as a value in a path component, as Hive and Spark escape it: `a/b` is `a%2Fb`. Letters and digits of all scripts
/// stay.
///
/// # Errors
/// The name is empty, too long, reserved, or has characters that no path shows.
pub(super) fn partition_value(name: &str) -> anyhow::Result<String> {
    ensure!(!name.is_empty(), "name of the machine: empty; expected letters and digits");
    ensure!(name.chars().count() <= LONGEST, "name of the machine: longer than {LONGEST} characters");
    ensure!(name != HIVE_NULL, "name of the machine: {HIVE_NULL} is reserved by Hive");
    let mut value = String::new();
    for letter in name.chars() {
        match letter {
            'a'..='z' | 'A'..='Z' | '0'..='9' | '-' | '_' | '.' => value.push(letter),
            // Hive escapes single bytes only.
            _ if letter.is_ascii() => {
                let _ = write!(value, "%{:02X}", u32::from(letter));
            }
            _ if letter.is_alphanumeric() => value.push(letter),
            _ => bail!("name of the machine: {}; expected letters, digits and ASCII", escape(name)),
        }
    }
    // Windows drops a dot at the end of a name.
    if let Some(start) = value.strip_suffix('.') {
        value = format!("{start}%2E");
    }
    Ok(value)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn no_name_leaves_its_folder() {
        let value = |name: &str| partition_value(name).unwrap();
        assert_eq!(value("excavator-7"), "excavator-7");
        assert_eq!(value("../../etc"), "..%2F..%2Fetc");
        assert_eq!(value(".."), ".%2E");
        assert_eq!(value("a\\b:c*d"), "a%5Cb%3Ac%2Ad");
        assert_eq!(value("C=1 %"), "C%3D1%20%25");
        assert_eq!(value("\0\n\x1b"), "%00%0A%1B");
        assert_eq!(value("Bagger Süd 挖"), "Bagger%20Süd%20挖");
    }

    #[test]
    fn names_that_no_path_shows_are_refused() {
        let error = |name: &str| partition_value(name).unwrap_err().to_string();
        assert_eq!(error(""), "name of the machine: empty; expected letters and digits");
        assert_eq!(error(&"x".repeat(65)), "name of the machine: longer than 64 characters");
        assert_eq!(
            error("a\u{202e}b"),
            "name of the machine: a\\u{202e}b; expected letters, digits and ASCII"
        );
        assert!(error("__HIVE_DEFAULT_PARTITION__").ends_with("is reserved by Hive"));
    }
}
