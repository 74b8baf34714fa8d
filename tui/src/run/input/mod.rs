//! Evaluation of the input options: buses, nodes, profiles.

mod databases;
pub mod device_files;
pub mod limited;

use std::path::{Path, PathBuf};
use std::sync::Arc;

use anyhow::{Context as _, anyhow};
use cobscope_decoder::bus_file::{BusFile, SpannedText};
use cobscope_decoder::capture::{BusNames, ReadOptions, RecorderZones, TimeStyle, TimeUnit};
use cobscope_decoder::profile::{Catalogue, ProfileError, TextError, is_bus_file};
use cobscope_decoder::query::Filter;
use cobscope_decoder::rules::RuleSetup;
use cobscope_decoder::series::JoinOptions;
use cobscope_decoder::session::{AssignedBy, Assignment, ProtocolChoice, SessionOptions};
use cobscope_decoder::wire::NodeId;

use super::messages::{collect_messages, print_note, print_warning};
use crate::run::arguments::{InputArgs, NodeArg, ProtocolOption, StampStyle, TimeUnitOption, find_zone};
use crate::source::{CaptureFile, CaptureSeries, relate_files, siblings_note};
use crate::words::unknown_bus;

use databases::read_databases;

/// Captures to read; stdin without arguments.
pub fn capture_paths(input: &InputArgs) -> Vec<PathBuf> {
    if input.captures.is_empty() { vec!["-".into()] } else { input.captures.clone() }
}

/// Captures to read, each a file or the parts of a series, which are reported.
pub fn capture_series(input: &InputArgs) -> Vec<CaptureSeries> {
    join_files(&CaptureFile::files_named(&capture_paths(input)), input)
}

/// The series among `files`; joined and rejected parts are reported.
pub fn join_files(files: &[CaptureFile], input: &InputArgs) -> Vec<CaptureSeries> {
    let relations = relate_files(files, &read_options(input), join_options(input));
    let all = relations.series();
    if let Some(text) = missing_parts(files, input) {
        print_note(&text);
    }
    let joined = all.iter().filter_map(CaptureSeries::parts_note);
    joined.chain(relations.separation_notes()).for_each(|text| print_note(&text));
    all
}

/// Note on a single file that is one of several parts in its folder.
pub fn missing_parts(files: &[CaptureFile], input: &InputArgs) -> Option<String> {
    let [file] = files else { return None };
    siblings_note(&file.path).filter(|_| file.is_listed && !input.separate)
}

/// Conditions for joining files.
pub fn join_options(input: &InputArgs) -> JoinOptions {
    #[expect(clippy::cast_possible_truncation, reason = "saturates")]
    let max_gap = (input.part_gap * 1e9) as i64;
    JoinOptions { is_off: input.separate, is_requested: input.join, max_gap }
}

pub fn read_options(input: &InputArgs) -> ReadOptions {
    ReadOptions {
        time_style: input.time.map(|style| match style {
            StampStyle::Absolute => TimeStyle::Absolute,
            StampStyle::Delta => TimeStyle::Delta,
        }),
        columns: input.columns,
        time_unit: input.time_unit.map(|unit| match unit {
            TimeUnitOption::S => TimeUnit::Second,
            TimeUnitOption::Ms => TimeUnit::Millisecond,
            TimeUnitOption::Us => TimeUnit::Microsecond,
            TimeUnitOption::Ns => TimeUnit::Nanosecond,
        }),
        time_zones: recorder_zones(input),
    }
}

/// Time zones of the command line and the bus file; an invalid bus file is reported elsewhere.
fn recorder_zones(input: &InputArgs) -> RecorderZones {
    // A pipe can be read only once.
    let path = input.bus.as_deref().filter(|path| input.time_zone.is_none() && path.is_file());
    let file = path.and_then(|path| bus_file(path).ok()).unwrap_or_default();
    let zone = |(bus, zone): (&str, &SpannedText)| Some((bus.to_owned(), find_zone(&zone.text).ok()?));
    RecorderZones::new(input.time_zone.clone(), file.time_zones().filter_map(zone).collect())
}

/// Session options from the command line and the bus file.
///
/// # Errors
/// If a bus file, profile, device file or database is missing, unreadable or invalid.
pub fn session_options(input: &InputArgs) -> anyhow::Result<SessionOptions> {
    options_of(input, load_catalogue(&input.profiles))
}

/// Session options with the profiles of `catalogue`; problems in readable files are printed.
///
/// # Errors
/// As for [`session_options`].
pub fn options_of(input: &InputArgs, mut catalogue: Catalogue) -> anyhow::Result<SessionOptions> {
    let bus_file = input.bus.as_deref().map(bus_file).transpose()?.unwrap_or_default();
    for (profile, rule, key, value) in bus_file.device_tolerances() {
        catalogue.set_tolerance(profile, rule, key, value);
    }
    let mut problems = Vec::new();
    let options = options_with(input, bus_file, Arc::new(catalogue), &mut problems)?;
    for problem in &problems {
        print_warning(problem);
    }
    Ok(options)
}

/// Session options with a bus file and profiles that were read before. Problems in readable files are added to
/// `problems`.
///
/// # Errors
/// As for [`session_options`].
pub fn options_with(
    input: &InputArgs,
    bus_file: BusFile,
    catalogue: Arc<Catalogue>,
    problems: &mut Vec<String>,
) -> anyhow::Result<SessionOptions> {
    #[expect(clippy::cast_possible_truncation, reason = "saturates")]
    let sdo_silence = (input.sdo_timeout * 1e9) as i64;
    let mut assignments = node_assignments(input, &bus_file, &catalogue)?;
    assignments.extend(device_files::device_assignments(input, &bus_file, problems)?);
    let databases = read_databases(input, &bus_file, problems)?;
    Ok(SessionOptions {
        protocol: match input.protocol {
            ProtocolOption::Auto => ProtocolChoice::Auto,
            ProtocolOption::Canopen => ProtocolChoice::Canopen,
            ProtocolOption::J1939 => ProtocolChoice::J1939,
            ProtocolOption::None => ProtocolChoice::None,
        },
        sdo_silence,
        bus_file,
        catalogue,
        assignments,
        named: named_nodes(input),
        database: databases.everywhere,
        bus_databases: databases.buses,
        ..SessionOptions::default()
    })
}

/// Nodes selected by `--node` without a profile.
fn named_nodes(input: &InputArgs) -> Vec<(Option<String>, NodeId)> {
    let selected = input.node.iter().filter(|node| node.profile.is_none());
    selected.map(|node| (node.bus.clone(), node.id)).collect()
}

fn bus_file(path: &Path) -> anyhow::Result<BusFile> {
    let (name, text) = bus_file_text(path)?;
    let file = BusFile::parse(&text).map_err(|error| anyhow::anyhow!(error.show_in_file(&name)))?;
    for (_, zone) in file.time_zones() {
        let wrong = |reason: &'static str| TextError::at_place(&text, zone.span.clone(), reason.to_owned());
        find_zone(&zone.text).map_err(|reason| anyhow::anyhow!(wrong(reason).show_in_file(&name)))?;
    }
    Ok(file)
}

/// Device files and databases named in a bus file; empty for an invalid one, which is reported elsewhere.
pub fn files_named(path: &Path) -> Vec<PathBuf> {
    // A pipe can be read only once.
    let file = path.is_file().then(|| bus_file(path).ok()).flatten().unwrap_or_default();
    let folder = path.parent().unwrap_or(Path::new(""));
    let devices = file.device_files().map(|(_, _, name)| folder.join(name));
    let all = std::iter::once(&file.everywhere).chain(file.buses.iter().map(|(_, settings)| settings));
    devices.chain(all.flat_map(|settings| &settings.databases).map(|name| folder.join(name))).collect()
}

/// Name and text of a bus file.
///
/// # Errors
/// If the file cannot be read.
pub fn bus_file_text(path: &Path) -> anyhow::Result<(String, String)> {
    Ok((path.display().to_string(), limited::read_text(path)?))
}

/// Configuration of rules from the bus file; `today` is the reference date for expired suppressions (default:
/// today).
///
/// # Errors
/// If the bus file is unreadable, or contains unknown rules or tolerances.
pub fn build_setup(
    input: &InputArgs,
    catalogue: &Catalogue,
    today: Option<jiff::civil::Date>,
) -> anyhow::Result<RuleSetup> {
    let Some(path) = &input.bus else { return Ok(RuleSetup::default()) };
    let (name, text) = bus_file_text(path)?;
    let file = BusFile::parse(&text).map_err(|error| anyhow::anyhow!(error.show_in_file(&name)))?;
    let shown = |error: TextError| anyhow::anyhow!(error.show_in_file(&name));
    // Reading the system time zone takes most of a millisecond, so the date is determined only if needed.
    let is_dated = file.judgement.suppressions.iter().any(|suppression| suppression.until.is_some());
    let today = is_dated.then(|| today.unwrap_or_else(|| jiff::Zoned::now().date()).to_string());
    let setup = RuleSetup::new(&file, &text, today).map_err(shown)?;
    setup.check_devices(&file, &text, catalogue).map_err(shown)?;
    Ok(setup)
}

/// Checks the rule names in a filter.
///
/// # Errors
/// If a rule is unknown; a comparison with it would match no event or all events.
pub fn check_rules_of(filter: Option<&Filter>, setup: &RuleSetup) -> anyhow::Result<()> {
    filter.map_or(Ok(()), |filter| check_rules_in(filter, setup, "--filter"))
}

/// Checks the rules named in the filter of an option.
///
/// # Errors
/// As for `check_rules_of`.
pub fn check_rules_in(filter: &Filter, setup: &RuleSetup, option: &'static str) -> anyhow::Result<()> {
    for rule in filter.compared_with("rule") {
        setup.check_name(rule).map_err(anyhow::Error::msg).context(option)?;
    }
    Ok(())
}

/// Profiles of nodes: those of the bus file, then those of the options, which take precedence.
fn node_assignments(
    input: &InputArgs,
    file: &BusFile,
    catalogue: &Catalogue,
) -> anyhow::Result<Vec<Assignment>> {
    let mut all = Vec::new();
    for (bus, node, profile) in file.devices() {
        let device =
            catalogue.device(&profile.text).map_err(|error| misnamed_profile(input, profile, error))?;
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

/// Error for a profile named in the bus file, with its position there, unless the profile itself is invalid.
fn misnamed_profile(input: &InputArgs, profile: &SpannedText, error: ProfileError) -> anyhow::Error {
    let text = input.bus.as_deref().map(bus_file_text);
    match (&error, text) {
        (ProfileError::Unknown { .. } | ProfileError::NoVariant { .. }, Some(Ok((name, text)))) => {
            anyhow!(TextError::at_place(&text, profile.span.clone(), error.to_string()).show_in_file(&name))
        }
        _ => error.into(),
    }
}

/// All profiles: built-in, from the user's folder, and from `folders`.
pub fn load_catalogue(folders: &[PathBuf]) -> Catalogue {
    let mut catalogue = Catalogue::default();
    if let Some(folder) = user_folder().filter(|folder| folder.is_dir()) {
        add_folder(&mut catalogue, &folder);
    }
    add_folders(&mut catalogue, folders);
    catalogue
}

/// Profiles that are equal on every computer: built-in and from `folders`.
pub fn common_catalogue(folders: &[PathBuf]) -> Catalogue {
    let mut catalogue = Catalogue::default();
    add_folders(&mut catalogue, folders);
    catalogue
}

/// Names `--user-profiles` in an error about a profile that only the user's folder has.
pub fn with_user_folder(error: anyhow::Error, folders: &[PathBuf]) -> anyhow::Error {
    let Some(folder) = user_folder().filter(|folder| folder.is_dir()) else { return error };
    // The position in a bus file follows in further lines.
    let text = format!("{error:#}");
    let (first, place) = text.split_at(text.find('\n').unwrap_or(text.len()));
    // Problems of other profiles do not concern the command.
    let ((own, common), _) = collect_messages(|| (load_catalogue(&[]), common_catalogue(folders)));
    let common = common.ids();
    let mut missing = own.ids().into_iter().filter(|id| !common.contains(id));
    if !missing.any(|id| first.contains(&format!("unknown profile '{id}'"))) {
        return error;
    }
    anyhow!("{first}; --user-profiles reads it from {}{place}", folder.display())
}

fn add_folders(catalogue: &mut Catalogue, folders: &[PathBuf]) {
    for folder in folders {
        add_folder(catalogue, folder);
    }
}

/// `$XDG_CONFIG_HOME/cobscope/profiles`.
fn user_folder() -> Option<PathBuf> {
    Some(crate::config::folder()?.join("profiles"))
}

/// Adds the profiles of a folder. Invalid ones are reported; they are an error only if a node uses them.
fn add_folder(catalogue: &mut Catalogue, folder: &Path) {
    for path in files_in(folder, is_profile) {
        add_file(catalogue, &path);
    }
    for path in files_in(folder, device_files::is_device_file) {
        device_files::add_to(catalogue, &path);
    }
}

/// Adds the other profiles of a folder, because the profile `but` may extend them.
pub fn add_siblings(catalogue: &mut Catalogue, folder: &Path, but: &Path) {
    for path in files_in(folder, is_profile).iter().filter(|path| path.as_path() != but) {
        let text = limited::read_text(path).unwrap_or_default();
        // Errors in them are reported only if a profile extends them.
        let _ = catalogue.add_text(&path.display().to_string(), &text);
    }
}

fn is_profile(path: &Path) -> bool {
    let is_statements = path.file_stem().is_some_and(|stem| stem.to_string_lossy().ends_with(".statements"));
    path.extension().is_some_and(|extension| extension == "toml") && !is_statements
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
    let text = match limited::read_text(path) {
        Ok(text) => text,
        Err(error) => return print_warning(&format!("{error:#}")),
    };
    if is_bus_file(&text) {
        return;
    }
    match catalogue.add_text(&name, &text) {
        Ok(id) => {
            if let Some(other) = catalogue.replaced_origin(&id) {
                let other = if other.is_empty() { "the built-in profile" } else { other };
                print_warning(&format!("{name}: overrides {other} for {id}"));
            }
        }
        Err(error) => {
            print_warning(&error.to_string());
            catalogue.add_broken(&stem, error);
        }
    }
}

/// Bus names in the bus file and the options, each with its origin.
pub fn named_buses(input: &InputArgs, options: &SessionOptions) -> Vec<(String, &'static str)> {
    let of_file = options.bus_file.buses.iter().map(|(name, _)| (name, "the bus file"));
    let of_nodes = input.node.iter().filter_map(|node| Some((node.bus.as_ref()?, "--node")));
    let of_files = input.eds.iter().filter_map(|file| Some((file.node.bus.as_ref()?, "--eds")));
    let all = of_file.chain(of_nodes).chain(of_files);
    all.map(|(name, by)| (name.clone(), by)).collect()
}

/// Warnings for bus names that do not occur in a capture.
pub fn unknown_buses(
    capture: &str,
    input: &InputArgs,
    options: &SessionOptions,
    names: &BusNames,
) -> Vec<String> {
    let has: Vec<&str> = names.names().iter().map(String::as_str).collect();
    let wanted = named_buses(input, options);
    wanted.iter().filter_map(|(name, by)| unknown_bus(capture, name, by, &has)).collect()
}
