//! DBC and pretty_j1939 files: reading, problems, and the buses for which they are used.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use cobscope_decoder::bus_file::BusFile;
use cobscope_decoder::profile::dbc::{self, Database, DatabaseFile};
use cobscope_decoder::words::count_noun;

use super::limited::read_bytes;
use crate::path_text::path_text;
use crate::run::arguments::InputArgs;

/// Maximum number of problems printed per file.
const REPORTED: usize = 5;

/// Databases for all buses, and for buses with their own databases.
pub(super) struct BusDatabases {
    pub(super) everywhere: Arc<Database>,
    pub(super) buses: Vec<(String, Arc<Database>)>,
}

/// Databases of the options, then those of the bus file: first of the bus, then of all buses. The first one
/// that defines a message takes precedence.
///
/// # Errors
/// If a file is unreadable or not a database; errors inside a readable file are added to `problems`.
pub(super) fn read_databases(
    input: &InputArgs,
    bus_file: &BusFile,
    problems: &mut Vec<String>,
) -> anyhow::Result<BusDatabases> {
    let folder = input.bus.as_deref().and_then(Path::parent).unwrap_or(Path::new(""));
    let mut reader = DatabaseReader { files: BTreeMap::new(), problems };
    let mut joined = |own: &[String]| {
        let mut database = Database::default();
        for path in &input.dbc {
            database.add_file(reader.read_file(path)?);
        }
        for name in own.iter().chain(&bus_file.everywhere.databases) {
            database.add_file(reader.read_file(&folder.join(name))?);
        }
        anyhow::Ok(Arc::new(database))
    };
    let everywhere = joined(&[])?;
    let own = bus_file.buses.iter().filter(|(_, settings)| !settings.databases.is_empty());
    let buses = own.map(|(name, settings)| Ok((name.clone(), joined(&settings.databases)?)));
    Ok(BusDatabases { everywhere, buses: buses.collect::<anyhow::Result<_>>()? })
}

/// Reads each file once and reports its problems once.
struct DatabaseReader<'a> {
    files: BTreeMap<PathBuf, DatabaseFile>,
    problems: &'a mut Vec<String>,
}

impl DatabaseReader<'_> {
    fn read_file(&mut self, path: &Path) -> anyhow::Result<DatabaseFile> {
        if let Some(file) = self.files.get(path) {
            return Ok(file.clone());
        }
        let shown = path_text(path);
        let file = dbc::parse_database(&read_bytes(path)?)
            .map_err(|problem| anyhow::anyhow!("{shown}:{problem}"))?;
        for problem in file.problems.iter().take(REPORTED) {
            self.problems.push(format!("{shown}:{problem}"));
        }
        if let Some(more) = file.problems.len().checked_sub(REPORTED).filter(|more| *more > 0) {
            self.problems.push(format!("{shown}: {}", count_noun(more, "more problem")));
        }
        self.files.insert(path.to_owned(), file.clone());
        Ok(file)
    }
}
