//! `report --lake`: the page of a fleet, from the index of a lake.

use std::io::Write as _;
use std::path::Path;

use cobscope_decoder::report::fleet::Fleet;
use cobscope_decoder::report::html::{FleetPage, write_fleet};

use super::provenance::command;
use crate::exit_code::ExitStatus;
use crate::run::lake_index;
use crate::run::messages::Refusal;
use crate::run::output::write_result;
use crate::run::replaced::{OwnFile, open_replacing};

/// Writes the page to a file, else to stdout.
///
/// # Errors
/// The folder is not a lake, or the file cannot be created.
pub(super) fn write(lake: &Path, path: Option<&Path>) -> Result<ExitStatus, Refusal> {
    let usage = |error| (ExitStatus::Usage, error);
    let page = FleetPage {
        name: lake.display().to_string(),
        fleet: Fleet::sort_captures(lake_index::read_all(lake).map_err(usage)?),
        command: command(),
        version: env!("CARGO_PKG_VERSION").to_owned(),
    };
    let text = write_fleet(&page);
    let mut output = open_replacing(path, OwnFile::Page, []).map_err(usage)?;
    Ok(write_result(output.write_all(text.as_bytes()).and_then(|()| output.finish())))
}
