//! `cobscope profiles`: lists, shows, checks and imports profiles.

mod counts;
mod markdown;
mod page;

use std::fmt::Write as _;
use std::path::{Path, PathBuf};

use clap::{Args, Subcommand, ValueEnum};
use cobscope_decoder::profile::device::ProfileFile;
use cobscope_decoder::profile::{Catalogue, DeviceProfile, ProfileError, check_device, check_ids, imported};
use cobscope_decoder::rules::check_names;
use cobscope_decoder::samples::check_samples;
use cobscope_decoder::sink::escape;
use cobscope_decoder::words::count_noun;

use crate::exit_code::ExitStatus;
use crate::path_text;
use crate::run::arguments::examples;
use crate::run::input::{add_siblings, device_files, limited, load_catalogue};
use crate::run::messages::print_warning;
use crate::run::output::print_text;
use counts::entry_counts;
use markdown::profile_markdown;
use page::profile_page;

/// Examples in the help.
const EXAMPLES: &str = examples![
    "cobscope profiles show rexroth-sydfec",
    "cobscope profiles import pump.eds > devices/pump.toml",
    "cobscope profiles check devices/pump.toml",
];

/// List, show, check and import device profiles
#[derive(Debug, Args)]
#[command(after_help = EXAMPLES)]
pub struct ProfilesArgs {
    /// Command to run
    #[command(subcommand)]
    pub command: ProfilesCommand,
    /// Add a folder with profiles and device files (repeatable)
    #[arg(long, value_name = "DIR", global = true)]
    pub profiles: Vec<PathBuf>,
}

/// Commands of `profiles`.
#[derive(Debug, Subcommand)]
pub enum ProfilesCommand {
    /// List all devices and variants
    List,
    /// Print the contents of a profile
    Show {
        /// Profile, with optional variant: rexroth-sydfec, wandfluh-md2:controller
        profile: String,
        /// Print only the number of entries
        #[arg(long)]
        count: bool,
        /// Output format
        #[arg(short, long, value_name = "FORMAT", default_value = "text")]
        format: PageFormat,
    },
    /// Check the syntax, ranges, references and samples of profiles, and report defects of device files
    Check {
        /// Profiles (TOML) and device files (EDS, DCF, XDD, XDC)
        #[arg(required = true, value_name = "FILE")]
        files: Vec<PathBuf>,
    },
    /// Print the profile generated from a device file
    Import {
        /// EDS, DCF, XDD or XDC file
        file: PathBuf,
    },
}

/// Formats of a profile page.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum PageFormat {
    /// Complete text, wrapped for a terminal
    Text,
    /// Tables for a document, without the objects
    Markdown,
}

/// Runs the command.
pub fn run(arguments: &ProfilesArgs) -> ExitStatus {
    let catalogue = &load_catalogue(&arguments.profiles);
    match &arguments.command {
        ProfilesCommand::List => list_devices(catalogue),
        ProfilesCommand::Show { profile, count: true, .. } => show_profile(catalogue, profile, counts_text),
        ProfilesCommand::Show { profile, format: PageFormat::Text, .. } => {
            show_profile(catalogue, profile, profile_page)
        }
        ProfilesCommand::Show { profile, format: PageFormat::Markdown, .. } => {
            show_profile(catalogue, profile, profile_markdown)
        }
        ProfilesCommand::Check { files } => check_files(files),
        ProfilesCommand::Import { file } => import_file(file),
    }
}

/// Prints one line per device and variant.
fn list_devices(catalogue: &Catalogue) -> ExitStatus {
    let mut text = String::new();
    let mut exit = ExitStatus::Clean;
    for id in catalogue.ids() {
        match catalogue.device(&id) {
            Ok(device) => {
                let line = format!("{id:<24} {:<10} {}", device.title, device.description);
                let _ = writeln!(text, "{}", escape(line.trim_end()));
                for (place, variant) in device.variants.iter().enumerate() {
                    let title = if variant.title.is_empty() { &device.title } else { &variant.title };
                    let name = format!("{id}:{}", variant.id);
                    let default = if place == 0 { " (default)" } else { "" };
                    let _ = writeln!(text, "  {name:<24} {}{default}", escape(title));
                }
                if let Some(origin) = catalogue.content_of(&id) {
                    let _ = writeln!(text, "  from {}", escape(origin));
                }
            }
            Err(error) => {
                // An unreadable file has no content and was already reported.
                if catalogue.content_of(&id).is_none_or(|origin| !origin.is_empty()) {
                    print_warning(&error.to_string());
                }
                let _ = writeln!(text, "{:<24} invalid", escape(&id));
                exit = ExitStatus::Profile;
            }
        }
    }
    exit.max(print_text(text.as_bytes()))
}

fn show_profile(
    catalogue: &Catalogue,
    profile: &str,
    shown: impl Fn(&DeviceProfile) -> String,
) -> ExitStatus {
    match catalogue.device(profile) {
        Ok(device) => print_text(shown(&device).as_bytes()),
        Err(error @ ProfileError::Broken { .. }) => {
            print_warning(&error.to_string());
            ExitStatus::Profile
        }
        Err(error) => {
            print_warning(&format!("{error} (cobscope profiles list)"));
            ExitStatus::Usage
        }
    }
}

fn counts_text(device: &DeviceProfile) -> String {
    let mut text = format!("{}\n", device.full_id);
    for (name, number) in entry_counts(device) {
        let _ = writeln!(text, "  {name:<16} {number}");
    }
    text
}

fn check_files(files: &[PathBuf]) -> ExitStatus {
    let mut exit = ExitStatus::Clean;
    for path in files {
        let name = path.display().to_string();
        if device_files::is_device_file(path) {
            exit = exit.max(check_device_file(path));
            continue;
        }
        match limited::read_text(path) {
            Ok(text) => exit = exit.max(check_one(path, &name, &text)),
            Err(error) => {
                print_warning(&format!("{error:#}"));
                exit = ExitStatus::Profile;
            }
        }
    }
    exit
}

/// Prints the problems of a device file.
fn check_device_file(path: &Path) -> ExitStatus {
    let file = match device_files::read_device_file(path) {
        Ok(file) => file,
        Err(error) => {
            print_warning(&format!("{error:#}"));
            return ExitStatus::Profile;
        }
    };
    let lines = device_files::problem_lines(path, &file);
    for line in &lines {
        print_warning(line);
    }
    if !lines.is_empty() {
        return ExitStatus::Profile;
    }
    let shown = path_text::path_text(path);
    print_text(format!("{shown}: ok, {}\n", count_noun(file.objects.len(), "object")).as_bytes())
}

/// Prints the profile generated from a device file.
fn import_file(path: &Path) -> ExitStatus {
    match device_files::read_device_file(path) {
        Ok(file) => print_text(imported::write_profile(&file, &device_files::file_name(path)).as_bytes()),
        Err(error) => {
            print_warning(&format!("{error:#}"));
            ExitStatus::Profile
        }
    }
}

/// Checks all variants of a profile and its samples; standards are built in or in the folder of the file.
fn check_one(path: &Path, name: &str, text: &str) -> ExitStatus {
    let mut catalogue = Catalogue::default();
    let folder = path.parent().unwrap_or(Path::new("."));
    add_siblings(&mut catalogue, folder, path);
    if let Err(error) = catalogue.add_text(name, text) {
        print_warning(&error.to_string());
        return ExitStatus::Profile;
    }
    let Ok(file) = ProfileFile::parse(text) else { return ExitStatus::Profile };
    let ids = check_ids(text);
    if !ids.is_empty() {
        for error in &ids {
            print_warning(&error.show_in_file(name));
        }
        return ExitStatus::Profile;
    }
    let variants: Vec<Option<&str>> = match file.variants() {
        [] => vec![None],
        variants => variants.iter().map(|variant| Some(variant.id.as_str())).collect(),
    };
    let mut problems: Vec<String> =
        check_names(text, &file).iter().map(|error| error.show_in_file(name)).collect();
    let mut samples = 0;
    for variant in variants {
        let id = variant.map_or(file.id().to_owned(), |variant| format!("{}:{variant}", file.id()));
        match catalogue.device(&id) {
            Ok(device) => {
                samples += device.samples.len();
                let wrong = [check_device(text, &file, &device), check_samples(text, &device)].concat();
                problems.extend(wrong.iter().map(|error| error.show_in_file(name)));
            }
            Err(error) => problems.push(error.to_string()),
        }
    }
    problems.dedup();
    for error in &problems {
        print_warning(error);
    }
    if !problems.is_empty() {
        return ExitStatus::Profile;
    }
    let hint = if samples == 0 { "; values not verified" } else { "" };
    print_text(format!("{}: ok, {}{hint}\n", escape(name), count_noun(samples, "sample")).as_bytes())
}
