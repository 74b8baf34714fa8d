//! Folders of the user, by the XDG Base Directory Specification; on Windows below `AppData`.

use std::ffi::OsString;
use std::path::PathBuf;

/// Folder of the config file.
pub fn config_folder() -> Option<PathBuf> {
    program_folder("XDG_CONFIG_HOME", "APPDATA", ".config", &|name| std::env::var_os(name))
}

/// Folder of files that the program remembers.
pub(super) fn state_folder() -> Option<PathBuf> {
    program_folder("XDG_STATE_HOME", "LOCALAPPDATA", ".local/state", &|name| std::env::var_os(name))
}

/// The folder of the program in that of a variable, or below the home folder.
fn program_folder(
    variable: &str,
    on_windows: &str,
    below_home: &str,
    value: &dyn Fn(&str) -> Option<OsString>,
) -> Option<PathBuf> {
    // The specification: a relative path is invalid and ignored.
    let absolute = |name: &str| value(name).map(PathBuf::from).filter(|path| path.is_absolute());
    let named = absolute(variable).or_else(|| if cfg!(windows) { absolute(on_windows) } else { None });
    let base = named.or_else(|| Some(absolute("HOME")?.join(below_home)))?;
    Some(base.join("cobscope"))
}

#[cfg(all(test, unix))]
mod tests {
    use super::*;

    #[test]
    fn a_variable_goes_before_the_home_folder() {
        let of = |xdg: &str, home: &str| {
            let value = |name: &str| match name {
                "XDG_CONFIG_HOME" => Some(xdg.into()),
                "HOME" => Some(home.into()),
                _ => None,
            };
            program_folder("XDG_CONFIG_HOME", "APPDATA", ".config", &value)
        };
        assert_eq!(of("/etc/xdg", "/home/a").unwrap().to_str(), Some("/etc/xdg/cobscope"));
        assert_eq!(of("relative", "/home/a").unwrap().to_str(), Some("/home/a/.config/cobscope"));
        assert_eq!(of("", ""), None);
    }
}
