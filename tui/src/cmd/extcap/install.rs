//! Link of this program in Wireshark's folder for extcap programs.

use std::path::{Path, PathBuf};
use std::sync::OnceLock;

use anyhow::{Context as _, bail, ensure};

use crate::exit_code::ExitStatus;
use crate::path_text::path_text;
use crate::run::messages::print_note;
use crate::run::output::ensure_folder;

/// Name of the link. Wireshark calls every program in the folder.
const NAME: &str = if cfg!(windows) { "cobscope.exe" } else { "cobscope" };

/// Path of the command, if its process runs another program.
static PROGRAM: OnceLock<PathBuf> = OnceLock::new();

/// Sets the path of the command; without it, that is the program of the process.
pub fn set_program(path: PathBuf) {
    let _ = PROGRAM.set(path);
}

/// Links this program in `folder`, or in the user's own folders for extcap programs. A link to another file is replaced.
/// Only the user's own folders are created: a `folder` that does not exist may be misspelt.
///
/// # Errors
/// If the folder is unknown or cannot be written, or a file that is no link has the name.
pub(super) fn install_link(folder: Option<&Path>) -> anyhow::Result<ExitStatus> {
    let folders = match folder {
        Some(folder) => {
            ensure_folder(&folder.join(NAME))?;
            vec![folder.to_owned()]
        }
        None => own_folders(),
    };
    ensure!(!folders.is_empty(), "the home folder is unknown; name the folder with --dir");
    let own = || std::env::current_exe().context("the path of this program is unknown");
    let program = PROGRAM.get().map_or_else(own, |program| Ok(program.clone()))?;
    for folder in folders {
        let link = link_in(&folder, &program)?;
        print_note(&format!("{}: linked", path_text(&link)));
    }
    print_note(
        "Wireshark lists the interfaces after a restart, tshark with -D; else use --dir with the folder of Help, About, Folders",
    );
    Ok(ExitStatus::Clean)
}

fn link_in(folder: &Path, program: &Path) -> anyhow::Result<PathBuf> {
    std::fs::create_dir_all(folder).with_context(|| format!("{}: cannot be created", path_text(folder)))?;
    let link = folder.join(NAME);
    match link.symlink_metadata() {
        Ok(found) if found.is_symlink() => {
            std::fs::remove_file(&link)
                .with_context(|| format!("{}: cannot be replaced", path_text(&link)))?;
        }
        Ok(_) => bail!("{}: file exists; remove it first", path_text(&link)),
        Err(_) => {}
    }
    place(program, &link).with_context(|| format!("{}: cannot be created", path_text(&link)))?;
    Ok(link)
}

#[cfg(unix)]
fn place(program: &Path, link: &Path) -> std::io::Result<()> {
    std::os::unix::fs::symlink(program, link)
}

/// Links need a privilege on Windows.
#[cfg(not(unix))]
fn place(program: &Path, link: &Path) -> std::io::Result<()> {
    std::fs::hard_link(program, link).or_else(|_| std::fs::copy(program, link).map(|_| ()))
}

/// Personal extcap folders: of present versions of Wireshark, and of versions up to 4.0.
fn own_folders() -> Vec<PathBuf> {
    let folder = |variable: &str, rest: &str| Some(PathBuf::from(std::env::var_os(variable)?).join(rest));
    let all = if cfg!(windows) {
        [folder("APPDATA", "Wireshark/extcap"), None]
    } else {
        let config = folder("XDG_CONFIG_HOME", "wireshark/extcap");
        [
            folder("HOME", ".local/lib/wireshark/extcap"),
            config.or_else(|| folder("HOME", ".config/wireshark/extcap")),
        ]
    };
    all.into_iter().flatten().collect()
}
