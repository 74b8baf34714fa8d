//! The bus file of a cut: the user's settings, with the state before the first frame of the cut.

use std::path::{Path, PathBuf};

use anyhow::Context as _;
use cobscope_decoder::bus_file::BaseFile;
use cobscope_decoder::session::BusSnapshot;

use super::input::bus_file_text;
use crate::run::arguments::InputArgs;

/// Start of the first line of such a file.
pub const TITLE: &str = "# State before ";

/// Text of a bus file in the folder of `path`; `title` is its first comment line.
///
/// # Errors
/// If the bus file of the user cannot be read again.
pub fn snapshot_text(
    mut snapshot: BusSnapshot,
    input: &InputArgs,
    path: &Path,
    title: &str,
) -> anyhow::Result<String> {
    let (name, base) = input.bus.as_deref().map(bus_file_text).transpose()?.unwrap_or_default();
    let folder = input.bus.as_deref().and_then(Path::parent).unwrap_or(Path::new(""));
    let target = absolute_path(path.parent().unwrap_or(Path::new("")));
    let named = |file: &Path| named_from(&target, file);
    for file in &input.eds {
        let settings = match &file.node.bus {
            Some(bus) => snapshot.bus_mut(bus),
            None => &mut snapshot.everywhere,
        };
        settings.device_files.push((file.node.id, named(&file.file)));
    }
    snapshot.everywhere.databases.extend(input.dbc.iter().map(|file| named(file)));
    let rename = |file: &str| named(&folder.join(file));
    snapshot
        .bus_file_text(&BaseFile { text: &base, rename: &rename }, title)
        .map_err(|error| anyhow::anyhow!(error.show_in_file(&name)))
        .context("cannot extend the bus file")
}

/// Name of a file for a bus file in the folder `target`: relative if it is inside.
fn named_from(target: &Path, file: &Path) -> String {
    let file = absolute_path(file);
    match file.strip_prefix(target) {
        // A bus file of Windows can be read on other systems.
        Ok(inside) if cfg!(windows) => inside.display().to_string().replace('\\', "/"),
        Ok(inside) => inside.display().to_string(),
        Err(_) => file.display().to_string(),
    }
}

fn absolute_path(path: &Path) -> PathBuf {
    let path = if path.as_os_str().is_empty() { Path::new(".") } else { path };
    std::path::absolute(path).unwrap_or_else(|_| path.to_owned())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_of_files_are_relative_inside_the_folder() {
        // On Windows, a path without a drive is not absolute.
        let root = absolute_path(Path::new("/"));
        let target = root.join("case").join("7");
        assert_eq!(named_from(&target, &target.join("eds").join("pump.eds")), "eds/pump.eds");
        let outside = root.join("case").join("pump.eds");
        assert_eq!(named_from(&target, &outside), outside.to_str().unwrap());
        let here = absolute_path(Path::new(""));
        assert_eq!(named_from(&here, Path::new("pump.eds")), "pump.eds");
    }
}
