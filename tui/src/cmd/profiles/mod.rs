//! `cobscope profiles`: lists, shows, checks and imports profiles.

mod counts;
mod markdown;
mod page;

use std::fmt::Write as _;
use std::path::Path;

use cobscope_decoder::profile::device::ProfileFile;
use cobscope_decoder::profile::{Catalogue, Device, ProfileError, check, check_ids, imported};
use cobscope_decoder::rules::check_names;
use cobscope_decoder::samples::check_samples;
use cobscope_decoder::sink::escape;
use cobscope_decoder::words::plural;

use super::input::{add_siblings, device_files, limited};
use super::messages::warn;
use super::output::print;
use crate::cli::{PageFormat, ProfilesCommand};
use crate::exit_code::Exit;
use crate::path_text;
use counts::counts;
use markdown::markdown;
use page::page;

/// Runs the command.
pub fn run(command: &ProfilesCommand, catalogue: &Catalogue) -> Exit {
    match command {
        ProfilesCommand::List => list(catalogue),
        ProfilesCommand::Show { profile, count: true, .. } => show(catalogue, profile, counted),
        ProfilesCommand::Show { profile, format: PageFormat::Text, .. } => show(catalogue, profile, page),
        ProfilesCommand::Show { profile, format: PageFormat::Markdown, .. } => {
            show(catalogue, profile, markdown)
        }
        ProfilesCommand::Check { files } => check_files(files),
        ProfilesCommand::Import { file } => import(file),
    }
}

/// Prints one line per device and variant.
fn list(catalogue: &Catalogue) -> Exit {
    let mut text = String::new();
    let mut exit = Exit::Clean;
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
                    warn(&error.to_string());
                }
                let _ = writeln!(text, "{:<24} invalid", escape(&id));
                exit = Exit::Profile;
            }
        }
    }
    exit.max(print(text.as_bytes()))
}

fn show(catalogue: &Catalogue, profile: &str, shown: impl Fn(&Device) -> String) -> Exit {
    match catalogue.device(profile) {
        Ok(device) => print(shown(&device).as_bytes()),
        Err(error @ ProfileError::Broken { .. }) => {
            warn(&error.to_string());
            Exit::Profile
        }
        Err(error) => {
            warn(&format!("{error} (cobscope profiles list)"));
            Exit::Usage
        }
    }
}

fn counted(device: &Device) -> String {
    let mut text = format!("{}\n", device.full_id);
    for (name, number) in counts(device) {
        let _ = writeln!(text, "  {name:<16} {number}");
    }
    text
}

fn check_files(files: &[std::path::PathBuf]) -> Exit {
    let mut exit = Exit::Clean;
    for path in files {
        let name = path.display().to_string();
        if device_files::is_device_file(path) {
            exit = exit.max(check_device_file(path));
            continue;
        }
        match limited::text(path) {
            Ok(text) => exit = exit.max(check_one(path, &name, &text)),
            Err(error) => {
                warn(&format!("{error:#}"));
                exit = Exit::Profile;
            }
        }
    }
    exit
}

/// Prints the problems of a device file.
fn check_device_file(path: &Path) -> Exit {
    let file = match device_files::read(path) {
        Ok(file) => file,
        Err(error) => {
            warn(&format!("{error:#}"));
            return Exit::Profile;
        }
    };
    let lines = device_files::problem_lines(path, &file);
    for line in &lines {
        warn(line);
    }
    if !lines.is_empty() {
        return Exit::Profile;
    }
    let shown = path_text::shown(path);
    print(format!("{shown}: ok, {}\n", plural(file.objects.len(), "object")).as_bytes())
}

/// Prints the profile generated from a device file.
fn import(path: &Path) -> Exit {
    match device_files::read(path) {
        Ok(file) => print(imported::toml(&file, &device_files::name(path)).as_bytes()),
        Err(error) => {
            warn(&format!("{error:#}"));
            Exit::Profile
        }
    }
}

/// Checks all variants of a profile and its samples; standards are built in or in the folder of the file.
fn check_one(path: &Path, name: &str, text: &str) -> Exit {
    let mut catalogue = Catalogue::default();
    let folder = path.parent().unwrap_or(Path::new("."));
    add_siblings(&mut catalogue, folder, path);
    if let Err(error) = catalogue.add_text(name, text) {
        warn(&error.to_string());
        return Exit::Profile;
    }
    let Ok(file) = ProfileFile::parse(text) else { return Exit::Profile };
    let ids = check_ids(text);
    if !ids.is_empty() {
        for error in &ids {
            warn(&error.show(name));
        }
        return Exit::Profile;
    }
    let variants: Vec<Option<&str>> = match file.variants() {
        [] => vec![None],
        variants => variants.iter().map(|variant| Some(variant.id.as_str())).collect(),
    };
    let mut problems: Vec<String> = check_names(text, &file).iter().map(|error| error.show(name)).collect();
    let mut samples = 0;
    for variant in variants {
        let id = variant.map_or(file.id().to_owned(), |variant| format!("{}:{variant}", file.id()));
        match catalogue.device(&id) {
            Ok(device) => {
                samples += device.samples.len();
                let wrong = [check(text, &file, &device), check_samples(text, &device)].concat();
                problems.extend(wrong.iter().map(|error| error.show(name)));
            }
            Err(error) => problems.push(error.to_string()),
        }
    }
    problems.dedup();
    for error in &problems {
        warn(error);
    }
    if !problems.is_empty() {
        return Exit::Profile;
    }
    let hint = if samples == 0 { "; values not verified" } else { "" };
    print(format!("{}: ok, {}{hint}\n", escape(name), plural(samples, "sample")).as_bytes())
}
