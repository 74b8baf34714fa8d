//! Files next to the captures: bus file, device files, databases.

use std::sync::Arc;

use cobscope_decoder::bus_file::BusFile;
use cobscope_decoder::profile::dbc::{self, Database};
use cobscope_decoder::profile::{Catalogue, DeviceProfile, device_file, imported};
use cobscope_decoder::rules::RuleSetup;
use cobscope_decoder::session::{AssignedBy, Assignment, SessionOptions};
use cobscope_decoder::wire::NodeId;

use crate::files::ContentAccess;
use crate::request::{NamedFile, OpenRequest};

/// Maximum size of a file next to a capture.
const MOST_BYTES: u64 = 64 << 20;

/// Maximum number of problems reported per file.
const MOST_PROBLEMS: usize = 5;

/// Options of the decoder and the rules.
pub struct PageOptions {
    /// Options of the decoder.
    pub session: SessionOptions,
    /// Selection and tolerances of the rules.
    pub setup: Arc<RuleSetup>,
    /// Problems inside readable files.
    pub problems: Vec<String>,
}

/// Kind of a file next to a capture.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum BesideKind {
    /// TOML with names, devices and expectations.
    BusFile,
    /// EDS, DCF, XDD or XDC.
    DeviceFile,
    /// DBC, or JSON of pretty_j1939.
    Database,
}

impl BesideKind {
    /// Kind by the suffix of the name; `None` for a capture.
    pub fn kind_of(name: &str) -> Option<Self> {
        let (_, suffix) = name.rsplit_once('.')?;
        match suffix.to_ascii_lowercase().as_str() {
            "toml" => Some(Self::BusFile),
            "eds" | "dcf" | "xdd" | "xdc" => Some(Self::DeviceFile),
            "dbc" | "json" => Some(Self::Database),
            _ => None,
        }
    }
}

struct OptionReader<'a> {
    files: &'a dyn ContentAccess,
    beside: &'a [NamedFile],
    problems: Vec<String>,
}

impl OptionReader<'_> {
    fn of_kind(&self, kind: BesideKind) -> impl Iterator<Item = &NamedFile> {
        self.beside.iter().filter(move |file| BesideKind::kind_of(&file.name) == Some(kind))
    }

    fn read_bytes(&self, file: &NamedFile) -> Result<Vec<u8>, String> {
        let name = &file.name;
        if file.size > MOST_BYTES {
            return Err(format!("{name}: {} MB; max {} MB", file.size >> 20, MOST_BYTES >> 20));
        }
        let mut bytes = vec![0; usize::try_from(file.size).unwrap_or(0)];
        let mut place = 0;
        while let Some(room) = bytes.get_mut(place..).filter(|room| !room.is_empty()) {
            match self
                .files
                .read(file.file, place as u64, room)
                .map_err(|error| format!("{name}: {error}"))?
            {
                0 => break,
                count => place = place.saturating_add(count),
            }
        }
        bytes.truncate(place);
        Ok(bytes)
    }

    /// A file by the name in a bus file, which may contain a folder.
    fn find_named(&self, path: &str) -> Result<&NamedFile, String> {
        let name = path.rsplit(['/', '\\']).next().unwrap_or(path);
        let found = self.beside.iter().find(|file| file.name.eq_ignore_ascii_case(name));
        found.ok_or_else(|| format!("{name}: named in the bus file; drop it together with the capture"))
    }

    fn read_device(&mut self, file: &NamedFile) -> Result<DeviceProfile, String> {
        let parsed = device_file::parse_device_file(&self.read_bytes(file)?);
        let parsed = Arc::new(parsed.map_err(|error| format!("{}: {error}", file.name))?);
        let shown = parsed.problems.iter().take(MOST_PROBLEMS);
        let shown = shown.map(|problem| format!("{}:{}: {}", file.name, problem.line, problem.reason));
        self.problems.extend(shown);
        Ok(imported::describe_device(&parsed, &file.name))
    }

    fn read_database(&mut self, file: &NamedFile) -> Result<dbc::DatabaseFile, String> {
        let parsed = dbc::parse_database(&self.read_bytes(file)?)
            .map_err(|problem| format!("{}:{problem}", file.name))?;
        let shown = parsed.problems.iter().take(MOST_PROBLEMS);
        self.problems.extend(shown.map(|problem| format!("{}:{problem}", file.name)));
        Ok(parsed)
    }
}

/// Reads the files next to the captures.
///
/// # Errors
/// If a file is unreadable or invalid, or a profile is unknown.
pub fn read_options(files: &dyn ContentAccess, request: &OpenRequest) -> Result<PageOptions, String> {
    let mut reader = OptionReader { files, beside: &request.beside, problems: Vec::new() };
    let bus_files: Vec<NamedFile> = reader.of_kind(BesideKind::BusFile).cloned().collect();
    let (name, text) = match bus_files.as_slice() {
        [] => (String::new(), String::new()),
        [file] => {
            let bytes = reader.read_bytes(file)?;
            let text = String::from_utf8(bytes).map_err(|_| format!("{}: not UTF-8", file.name))?;
            (file.name.clone(), text)
        }
        [one, other, ..] => return Err(format!("{}, {}: two bus files; drop one", one.name, other.name)),
    };
    let bus_file = BusFile::parse(&text).map_err(|error| error.show_in_file(&name))?;
    let mut catalogue = Catalogue::default();
    for (profile, rule, key, value) in bus_file.device_tolerances() {
        catalogue.set_tolerance(profile, rule, key, value);
    }
    let mut assignments = Vec::new();
    add_device_files(&mut reader, &bus_file, &mut catalogue, &mut assignments)?;
    for (bus, node, profile) in bus_file.devices() {
        let device = catalogue.device(&profile.text).map_err(|error| format!("{name}: {error}"))?;
        assignments.push(Assignment { bus: bus.map(Into::into), node, device, by: AssignedBy::BusFile });
    }
    for chosen in &request.nodes {
        let device = catalogue.device(&chosen.profile).map_err(|error| error.to_string())?;
        let (bus, node) = (chosen.bus.clone(), chosen.node.into());
        assignments.push(Assignment { bus, node, device, by: AssignedBy::Option });
    }
    let setup =
        RuleSetup::new(&bus_file, &text, request.today.clone()).map_err(|error| error.show_in_file(&name))?;
    setup.check_devices(&bus_file, &text, &catalogue).map_err(|error| error.show_in_file(&name))?;
    let (database, bus_databases) = read_databases(&mut reader, &bus_file)?;
    let session = SessionOptions {
        assignments,
        database,
        bus_databases,
        catalogue: Arc::new(catalogue),
        bus_file,
        ..SessionOptions::default()
    };
    Ok(PageOptions { session, setup: Arc::new(setup), problems: reader.problems })
}

/// Adds the device files to the profiles, and assigns those whose node is known.
fn add_device_files(
    reader: &mut OptionReader<'_>,
    bus_file: &BusFile,
    catalogue: &mut Catalogue,
    assignments: &mut Vec<Assignment>,
) -> Result<(), String> {
    for (bus, node, path) in bus_file.device_files() {
        let file = reader.find_named(path)?.clone();
        let device = Arc::new(reader.read_device(&file)?);
        assignments.push(Assignment { bus: bus.map(Into::into), node, device, by: AssignedBy::DeviceFile });
    }
    let all: Vec<NamedFile> = reader.of_kind(BesideKind::DeviceFile).cloned().collect();
    for file in all {
        let device = reader.read_device(&file)?;
        let own = device.file.as_ref().and_then(|import| import.file.node_id);
        if let Some(id) = file.node.or(own) {
            let (node, device) = (NodeId::Canopen(id), Arc::new(device));
            assignments.push(Assignment { bus: None, node, device, by: AssignedBy::DeviceFile });
        } else {
            catalogue.add_device(&file.name, device);
        }
    }
    Ok(())
}

type BusDatabases = Vec<(String, Arc<Database>)>;

/// Databases for all buses, and for buses with their own.
fn read_databases(
    reader: &mut OptionReader<'_>,
    bus_file: &BusFile,
) -> Result<(Arc<Database>, BusDatabases), String> {
    let of_buses = bus_file.buses.iter().flat_map(|(_, settings)| &settings.databases);
    let is_of_bus = |file: &NamedFile| of_buses.clone().any(|path| path.ends_with(&file.name));
    let all: Vec<NamedFile> =
        reader.of_kind(BesideKind::Database).filter(|file| !is_of_bus(file)).cloned().collect();
    let mut everywhere = Database::default();
    for file in &all {
        everywhere.add_file(reader.read_database(file)?);
    }
    for path in &bus_file.everywhere.databases {
        reader.find_named(path)?;
    }
    let mut buses = Vec::new();
    for (bus, settings) in &bus_file.buses {
        if settings.databases.is_empty() {
            continue;
        }
        let mut own = Database::default();
        for path in &settings.databases {
            let file = reader.find_named(path)?.clone();
            own.add_file(reader.read_database(&file)?);
        }
        for file in &all {
            own.add_file(reader.read_database(file)?);
        }
        buses.push((bus.clone(), Arc::new(own)));
    }
    Ok((Arc::new(everywhere), buses))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::files::MemoryFiles;

    fn read_texts(texts: &[(&str, &str)]) -> Result<PageOptions, String> {
        let files = MemoryFiles(texts.iter().map(|(_, text)| text.as_bytes().to_vec()).collect());
        let beside = (0..).zip(texts).map(|(file, (name, text))| NamedFile {
            file,
            name: (*name).to_owned(),
            size: text.len() as u64,
            node: None,
        });
        read_options(&files, &OpenRequest { beside: beside.collect(), ..OpenRequest::default() })
    }

    #[test]
    fn a_bus_file_and_a_database_are_used() {
        let database = "VERSION \"\"\nBU_: A\nBO_ 291 Speed: 8 A\n SG_ rpm : 0|16@1+ (1,0) [0|0] \"rpm\" A\n";
        let bus_file = "[node.5]\nname = \"boom\"\ndevice = \"rexroth-sydfec\"\n";
        let input = read_texts(&[("m.toml", bus_file), ("a.DBC", database)]).unwrap();
        assert_eq!(input.session.assignments.len(), 1);
        assert!(input.problems.is_empty(), "{:?}", input.problems);
    }

    #[test]
    fn wrong_files_are_named() {
        let fails = |texts: &[(&str, &str)]| read_texts(texts).err().unwrap_or_default();
        assert!(fails(&[("m.toml", "nodes = 1")]).starts_with("m.toml:1:1: "));
        assert_eq!(fails(&[("a.toml", ""), ("b.toml", "")]), "a.toml, b.toml: two bus files; drop one");
        let absent = fails(&[("m.toml", "[node.5]\neds = \"sub/pump.eds\"\n")]);
        assert_eq!(absent, "pump.eds: named in the bus file; drop it together with the capture");
    }
}
