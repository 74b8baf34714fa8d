//! Name of the machine of a capture, and its form in paths.

use std::fmt::Write as _;
use std::path::Path;

use anyhow::{Context as _, bail, ensure};
use cobscope_decoder::sink::escape;
use sha2::{Digest as _, Sha256};

use super::arguments::LakeAddArgs;
use crate::exit_code::ExitStatus;
use crate::path_text::path_text;
use crate::run::messages::Refusal;

/// Name of a machine without a name, and of an unknown day.
pub(super) const UNKNOWN: &str = "unknown";

/// Longest name, in characters; escaped it fits into a path component of every file system.
const LONGEST: usize = 64;

/// Longest path component of a message, in bytes; file systems permit 255.
const LONGEST_COMPONENT: usize = 120;

/// Bytes of the digest at the end of a component that was cut.
const DIGEST_BYTES: usize = 4;

/// Partition of missing values in Hive, which no machine may have.
const HIVE_NULL: &str = "__HIVE_DEFAULT_PARTITION__";

/// Checks the names that hold for all captures, before the first one is read: those of the option and of the bus file.
///
/// # Errors
/// One of them is no name of a machine.
pub(super) fn check_names(arguments: &LakeAddArgs, of_bus_file: Option<&str>) -> Result<(), Refusal> {
    let check = |name: &str| partition_value(name).map(|_| ());
    arguments.machine.as_deref().map_or(Ok(()), check).map_err(|error| (ExitStatus::Usage, error))?;
    let file = arguments.input.bus.as_deref().map_or_else(String::new, path_text);
    of_bus_file.map_or(Ok(()), check).with_context(|| file).map_err(|error| (ExitStatus::Profile, error))
}

/// Name of the machine of a capture: of the option, of the path, or of the bus file.
///
/// # Errors
/// The path does not match the pattern, or its part is no name of a machine.
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
        let Some(name) = pattern.name(&text) else {
            bail!("{}: no match of --machine-from {}", path_text(path), escape(pattern.text()));
        };
        return partition_value(name).map(|_| name.to_owned()).with_context(|| path_text(path));
    }
    Ok(of_bus_file.unwrap_or(UNKNOWN).to_owned())
}

/// Any name as a path component of bounded length. Letters and digits of all scripts stay; a cut name
/// ends with a digest, which tells it from others.
pub(super) fn path_value(name: &str) -> String {
    let mut value = String::new();
    for letter in name.chars() {
        match letter {
            '-' | '_' | '.' => value.push(letter),
            _ if letter.is_alphanumeric() => value.push(letter),
            _ => {
                for byte in letter.encode_utf8(&mut [0; 4]).bytes() {
                    let _ = write!(value, "%{byte:02X}");
                }
            }
        }
    }
    if value.len() > LONGEST_COMPONENT || value.ends_with('.') || value.is_empty() {
        let end = (0..=LONGEST_COMPONENT.min(value.len())).rev().find(|end| value.is_char_boundary(*end));
        value.truncate(end.unwrap_or(0));
        value.push('-');
        for byte in Sha256::digest(name).iter().take(DIGEST_BYTES) {
            let _ = write!(value, "{byte:02x}");
        }
    }
    value
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
    fn any_name_of_a_message_is_one_short_component() {
        assert_eq!(path_value("can0_node_2_tpdo1"), "can0_node_2_tpdo1");
        assert_eq!(path_value("CAN – left_ÄÖ 1"), "CAN%20%E2%80%93%20left_ÄÖ%201");
        assert_eq!(path_value("a/../b%"), "a%2F..%2Fb%25");
        let names = ["", ".", "..", "a.", &"x".repeat(121), &"x".repeat(122), &"ä".repeat(100)];
        let values: Vec<_> = names.iter().map(|name| path_value(name)).collect();
        for (place, value) in values.iter().enumerate() {
            assert!((1..=129).contains(&value.len()) && !value.ends_with('.'), "{value}");
            assert!(!values[..place].contains(value), "{value}");
        }
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
