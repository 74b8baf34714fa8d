//! What the options common to all captures say: buses, nodes, profiles.

mod databases;
pub(super) mod device_files;

use std::path::{Path, PathBuf};
use std::sync::Arc;

use anyhow::{Context as _, anyhow};
use cobscope_decoder::bus_file::{BusFile, Written};
use cobscope_decoder::capture::{BusNames, ReadOptions, TimeStyle};
use cobscope_decoder::profile::{Catalogue, ProfileError, TextError, is_bus_file};
use cobscope_decoder::query::Filter;
use cobscope_decoder::rules::Setup;
use cobscope_decoder::session::{AssignedBy, Assignment, ProtocolChoice, SessionOptions};

use super::messages::warn;
use crate::cli::{InputArgs, NodeArg, Protocol, StampStyle};
use crate::words::unknown_bus;
use databases::databases;

/// Captures to read: those named, else standard input.
pub(super) fn captures(input: &InputArgs) -> Vec<PathBuf> {
    if input.captures.is_empty() { vec!["-".into()] } else { input.captures.clone() }
}

pub(super) fn read_options(input: &InputArgs) -> ReadOptions {
    ReadOptions {
        time_style: input.time.map(|style| match style {
            StampStyle::Absolute => TimeStyle::Absolute,
            StampStyle::Delta => TimeStyle::Delta,
        }),
    }
}

/// What the options say of the buses.
///
/// # Errors
/// A bus file, profile, device file or database that cannot be read, is broken or does not exist.
pub(super) fn session_options(input: &InputArgs) -> anyhow::Result<SessionOptions> {
    options_of(input, catalogue(&input.profiles))
}

/// The same by the profiles of `catalogue`.
///
/// # Errors
/// As [`session_options`].
pub(super) fn options_of(input: &InputArgs, mut catalogue: Catalogue) -> anyhow::Result<SessionOptions> {
    #[expect(clippy::cast_possible_truncation, reason = "saturates")]
    let sdo_silence = (input.sdo_timeout * 1e9) as i64;
    let bus_file = input.bus.as_deref().map(bus_file).transpose()?.unwrap_or_default();
    for (profile, rule, key, value) in bus_file.device_tolerances() {
        catalogue.set_tolerance(profile, rule, key, value);
    }
    let mut assignments = assignments(input, &bus_file, &mut catalogue)?;
    assignments.extend(device_files::assignments(input, &bus_file)?);
    let databases = databases(input, &bus_file)?;
    Ok(SessionOptions {
        protocol: match input.protocol {
            Protocol::Auto => ProtocolChoice::Auto,
            Protocol::Canopen => ProtocolChoice::Canopen,
            Protocol::J1939 => ProtocolChoice::J1939,
            Protocol::None => ProtocolChoice::None,
        },
        sdo_silence,
        bus_file,
        catalogue: Arc::new(catalogue),
        assignments,
        database: databases.everywhere,
        bus_databases: databases.buses,
        ..SessionOptions::default()
    })
}

fn bus_file(path: &Path) -> anyhow::Result<BusFile> {
    let (name, text) = bus_file_text(path)?;
    BusFile::parse(&text).map_err(|error| anyhow::anyhow!(error.show(&name)))
}

/// Device files and databases that a bus file names; none of one that is broken, which is told where it is used.
pub(super) fn files_named(path: &Path) -> Vec<PathBuf> {
    // What a pipe holds is read once only.
    let file = path.is_file().then(|| bus_file(path).ok()).flatten().unwrap_or_default();
    let folder = path.parent().unwrap_or(Path::new(""));
    let devices = file.device_files().map(|(_, _, name)| folder.join(name));
    let all = std::iter::once(&file.everywhere).chain(file.buses.iter().map(|(_, settings)| settings));
    devices.chain(all.flat_map(|settings| &settings.databases).map(|name| folder.join(name))).collect()
}

fn bus_file_text(path: &Path) -> anyhow::Result<(String, String)> {
    let name = path.display().to_string();
    let text = std::fs::read_to_string(path).with_context(|| format!("{name}: cannot be read"))?;
    Ok((name, text))
}

/// What is judged, as the bus file says; `today`, by default the day it is, ends suppressions that ran out.
///
/// # Errors
/// A bus file that cannot be read, or that names rules and tolerances that do not exist.
pub(super) fn setup(
    input: &InputArgs,
    catalogue: &Catalogue,
    today: Option<jiff::civil::Date>,
) -> anyhow::Result<Setup> {
    let Some(path) = &input.bus else { return Ok(Setup::default()) };
    let (name, text) = bus_file_text(path)?;
    let file = BusFile::parse(&text).map_err(|error| anyhow::anyhow!(error.show(&name)))?;
    let shown = |error: TextError| anyhow::anyhow!(error.show(&name));
    // Which day it is takes most of a millisecond to find out: the zones of the system are looked through.
    let is_dated = file.judgement.suppressions.iter().any(|suppression| suppression.until.is_some());
    let today = is_dated.then(|| today.unwrap_or_else(|| jiff::Zoned::now().date()).to_string());
    let setup = Setup::new(&file, &text, today).map_err(shown)?;
    setup.check_devices(&file, &text, catalogue).map_err(shown)?;
    Ok(setup)
}

/// Holds the rules that a filter names to those there are.
///
/// # Errors
/// A rule that does not exist: it could match nothing, or all.
pub(super) fn check_rules_of(filter: Option<&Filter>, setup: &Setup) -> anyhow::Result<()> {
    let rules = filter.map(|filter| filter.compared("rule")).unwrap_or_default();
    for rule in rules {
        setup.check_name(rule).map_err(anyhow::Error::msg).context("--filter")?;
    }
    Ok(())
}

/// Devices of nodes: of the bus file, then of the options, which go before it.
fn assignments(
    input: &InputArgs,
    file: &BusFile,
    catalogue: &mut Catalogue,
) -> anyhow::Result<Vec<Assignment>> {
    let mut all = Vec::new();
    for (bus, node, profile) in file.devices() {
        let device = catalogue.device(&profile.text).map_err(|error| misnamed(input, profile, error))?;
        all.push(Assignment { bus: bus.map(Into::into), node, device, by: AssignedBy::BusFile });
    }
    for NodeArg { bus, id, profile } in &input.node {
        let Some(profile) = profile else { continue };
        let device = catalogue.device(profile).map_err(|error| {
            let list =
                if matches!(error, ProfileError::Unknown { .. }) { " (cobscope profiles list)" } else { "" };
            anyhow!("--node {id}={profile}: {error}{list}")
        })?;
        all.push(Assignment { bus: bus.clone(), node: *id, device, by: AssignedBy::Option });
    }
    Ok(all)
}

/// What is wrong with a profile that the bus file names: where it names it, unless the profile itself is broken.
fn misnamed(input: &InputArgs, profile: &Written, error: ProfileError) -> anyhow::Error {
    let text = input.bus.as_deref().map(bus_file_text);
    match (&error, text) {
        (ProfileError::Unknown { .. } | ProfileError::NoVariant { .. }, Some(Ok((name, text)))) => {
            anyhow!(TextError::at(&text, profile.span.clone(), error.to_string()).show(&name))
        }
        _ => error.into(),
    }
}

/// All profiles: those of this program, of the user's folder, of the folders named.
pub(super) fn catalogue(folders: &[PathBuf]) -> Catalogue {
    let mut catalogue = Catalogue::default();
    if let Some(folder) = user_folder().filter(|folder| folder.is_dir()) {
        add_folder(&mut catalogue, &folder);
    }
    add_folders(&mut catalogue, folders);
    catalogue
}

/// All profiles that are the same on every machine: those of this program and of the folders named.
pub(super) fn common_catalogue(folders: &[PathBuf]) -> Catalogue {
    let mut catalogue = Catalogue::default();
    add_folders(&mut catalogue, folders);
    catalogue
}

fn add_folders(catalogue: &mut Catalogue, folders: &[PathBuf]) {
    for folder in folders {
        if !folder.is_dir() {
            warn(&format!("{}: is no folder", folder.display()));
        }
        add_folder(catalogue, folder);
    }
}

/// `$XDG_CONFIG_HOME/cobscope/profiles`.
fn user_folder() -> Option<PathBuf> {
    let config = std::env::var_os("XDG_CONFIG_HOME").map(PathBuf::from).filter(|path| path.is_absolute());
    let config = config.or_else(|| std::env::var_os("HOME").map(|home| PathBuf::from(home).join(".config")));
    Some(config?.join("cobscope").join("profiles"))
}

/// Adds the profiles of a folder. A broken one is said, and stops the program only where a node
/// uses it.
fn add_folder(catalogue: &mut Catalogue, folder: &Path) {
    for path in files_in(folder, is_profile) {
        add_file(catalogue, &path);
    }
    for path in files_in(folder, device_files::is_device_file) {
        device_files::add_to(catalogue, &path);
    }
}

/// Adds the other profiles of a folder, which one of them may extend.
pub(super) fn add_siblings(catalogue: &mut Catalogue, folder: &Path, but: &Path) {
    for path in files_in(folder, is_profile).iter().filter(|path| path.as_path() != but) {
        let text = std::fs::read_to_string(path).unwrap_or_default();
        // What is wrong with one of them matters only to a profile that extends it, which says so.
        let _ = catalogue.add_text(&path.display().to_string(), &text);
    }
}

fn is_profile(path: &Path) -> bool {
    path.extension().is_some_and(|extension| extension == "toml")
}

fn files_in(folder: &Path, picks: fn(&Path) -> bool) -> Vec<PathBuf> {
    let Ok(entries) = std::fs::read_dir(folder) else { return Vec::new() };
    let all = entries.flatten().map(|entry| entry.path());
    let mut paths: Vec<PathBuf> = all.filter(|path| picks(path)).collect();
    paths.sort();
    paths
}

fn add_file(catalogue: &mut Catalogue, path: &Path) {
    let name = path.display().to_string();
    let stem = path.file_stem().map_or(String::new(), |stem| stem.to_string_lossy().into_owned());
    let Ok(text) = std::fs::read_to_string(path) else {
        return warn(&format!("{name}: cannot be read"));
    };
    if is_bus_file(&text) {
        return;
    }
    match catalogue.add_text(&name, &text) {
        Ok(id) => {
            if let Some(other) = catalogue.replaced(&id) {
                let other = if other.is_empty() { "this program's own" } else { other };
                warn(&format!("{name}: is used for {id} instead of {other}"));
            }
        }
        Err(error) => {
            warn(&error.to_string());
            catalogue.add_broken(&stem, error);
        }
    }
}

/// Names of buses the user gave, and by what.
pub(super) fn named_buses(input: &InputArgs, options: &SessionOptions) -> Vec<(String, &'static str)> {
    let of_file = options.bus_file.buses.iter().map(|(name, _)| (name, "the bus file"));
    let of_nodes = input.node.iter().filter_map(|node| Some((node.bus.as_ref()?, "--node")));
    let of_files = input.eds.iter().filter_map(|file| Some((file.node.bus.as_ref()?, "--eds")));
    let all = of_file.chain(of_nodes).chain(of_files);
    all.map(|(name, by)| (name.clone(), by)).collect()
}

/// What is said of buses that are named and that a capture does not have.
pub(super) fn unknown_buses(
    path: &Path,
    input: &InputArgs,
    options: &SessionOptions,
    names: &BusNames,
) -> Vec<String> {
    let capture = path.display().to_string();
    let has: Vec<&str> = names.names().iter().map(String::as_str).collect();
    let wanted = named_buses(input, options);
    wanted.iter().filter_map(|(name, by)| unknown_bus(&capture, name, by, &has)).collect()
}
