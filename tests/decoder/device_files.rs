//! Device files: those of other projects, against canopen-python and each other, and ours with their defects.

#![expect(clippy::disallowed_methods, reason = "the rule is for the decoder, not for what tests it")]

use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::fs;
use std::path::PathBuf;
use std::process::Command;

use cobscope_decoder::profile::device_file::{self, DeviceFile, DeviceObject, Given, Kind};

use crate::support::{corpus, python, skip, workspace};

fn corpus_files() -> Vec<PathBuf> {
    let folder = corpus().join("eds");
    let Ok(entries) = fs::read_dir(&folder) else {
        skip("corpus", &format!("{} is not there", folder.display()));
        return Vec::new();
    };
    let mut found: Vec<_> = entries.map(|entry| entry.unwrap().path()).collect();
    found.sort();
    found
}

fn name(path: &std::path::Path) -> String {
    path.file_name().unwrap().to_string_lossy().into_owned()
}

#[test]
fn survey() {
    for path in corpus_files() {
        let file = device_file::parse(&fs::read(&path).unwrap());
        match file {
            Ok(file) => {
                println!("{} {:?} {} {}", name(&path), file.kind, file.objects.len(), file.problems.len());
                for problem in file.problems.iter().take(400) {
                    println!("    {problem}");
                }
            }
            Err(error) => println!("{} {error}", name(&path)),
        }
    }
}
