//! Names that mean a device or a pipe on Windows, in any folder and with any suffix.

use std::path::Path;

/// Meaning of a name without a file.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum DeviceName {
    /// A device or pipe that an output may be written to: `NUL`, `\\.\pipe\name`.
    Intended,
    /// A device in place of a file: `con.log`, `AUX`.
    Reserved,
}

/// Devices that are outputs.
const OUTPUTS: [&str; 3] = ["NUL", "CON", "CONOUT$"];

/// Other devices, without the numbered ones.
const OTHERS: [&str; 3] = ["PRN", "AUX", "CONIN$"];

/// Devices with a number.
const NUMBERED: [&str; 2] = ["COM", "LPT"];

/// The device that a path names; `None` for files, and on other systems.
pub fn device_of(path: &Path) -> Option<DeviceName> {
    if cfg!(windows) { on_windows(&path.to_string_lossy()) } else { None }
}

/// Whether an output with this path is written to a device or a pipe. Such a path must not be opened for anything else: a pipe
/// accepts one program.
pub fn is_device(path: &Path) -> bool {
    device_of(path) == Some(DeviceName::Intended)
}

fn on_windows(path: &str) -> Option<DeviceName> {
    let path = path.replace('/', "\\");
    if path.starts_with(r"\\?\") {
        // A verbatim path is a file of this name.
        return None;
    }
    let is_remote_pipe = || path.split('\\').nth(3).is_some_and(|share| share.eq_ignore_ascii_case("pipe"));
    if path.starts_with(r"\\.\") || (path.starts_with(r"\\") && is_remote_pipe()) {
        return Some(DeviceName::Intended);
    }
    let path = path.trim_end_matches(':');
    let name = path.rsplit(['\\', ':']).next().unwrap_or(path).trim_end_matches([' ', '.']);
    let device = name.split('.').next().unwrap_or(name).trim_end_matches(' ').to_uppercase();
    if OUTPUTS.contains(&device.as_str()) {
        let is_whole = name.len() == device.len();
        return Some(if is_whole { DeviceName::Intended } else { DeviceName::Reserved });
    }
    let is_numbered = NUMBERED.iter().any(|kind| {
        let mut number = device.strip_prefix(kind).unwrap_or_default().chars();
        // Superscript digits are digits there.
        matches!((number.next(), number.next()), (Some('0'..='9' | '¹' | '²' | '³'), None))
    });
    (is_numbered || OTHERS.contains(&device.as_str())).then_some(DeviceName::Reserved)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn devices_are_found_in_every_spelling() {
        for path in
            ["NUL", "nul", "NUL:", r"C:\logs\nul", "logs/Nul", "C:NUL", "CON", "nul. ", r"\\.\pipe\wireshark"]
        {
            assert_eq!(on_windows(path), Some(DeviceName::Intended), "{path}");
        }
        for path in [r"\\server\pipe\name", "//./pipe/name", r"\\.\COM11"] {
            assert_eq!(on_windows(path), Some(DeviceName::Intended), "{path}");
        }
        for path in [
            "con.log",
            "NUL.part",
            "aux",
            "Aux.pcapng",
            "com1",
            r"D:\COM9.log",
            "lpt0.csv",
            "COM¹",
            "prn .log",
        ] {
            assert_eq!(on_windows(path), Some(DeviceName::Reserved), "{path}");
        }
    }

    #[test]
    fn other_names_are_files() {
        let files = [
            "null",
            "con1.log",
            "console.log",
            "COM",
            "COM10",
            r"C:\nul\run.log",
            r"\\?\C:\con.log",
            r"\\server\share\run.log",
            "run.con",
            "x.nul.log",
            "",
            "C:",
        ];
        assert_eq!(files.iter().filter(|path| on_windows(path).is_some()).collect::<Vec<_>>(), [&""; 0]);
    }
}
