//! `cobscope convert`: the output contains the data of the input, as far as its format can store it.
#![expect(clippy::indexing_slicing, reason = "a test that cannot go on has failed")]

mod bus_file;
mod choice;
mod every_format;
mod files;
mod oracles;

use std::fs::{self, File};
use std::io::BufReader;
use std::path::{Path, PathBuf};

use cobscope_decoder::capture::{Batch, CaptureReader, Notice, ReadOptions, decompress};
use cobscope_decoder::frame::Frame;
use tempfile::TempDir;

use crate::cli::{Output, run};
use crate::support::workspace;

/// Everything that a reader returns for a capture.
#[derive(Debug, PartialEq)]
struct Content {
    format: &'static str,
    frames: Vec<Frame>,
    notices: Vec<Notice>,
    buses: Vec<String>,
    /// Error that ended it early.
    error: Option<String>,
}

impl Content {
    /// Content of a capture; `None` for other files.
    fn of(path: &Path) -> Option<Self> {
        let source = decompress(BufReader::new(File::open(path).unwrap())).ok()?;
        let mut reader = CaptureReader::open(source, &ReadOptions::default()).ok()?;
        let (mut batch, mut frames, mut notices) = (Batch::new(), Vec::new(), Vec::new());
        let error = loop {
            match reader.read(&mut batch) {
                Ok(true) => {
                    frames.extend_from_slice(batch.frames());
                    notices.extend(batch.notices().iter().map(|(_, notice)| notice.clone()));
                }
                Ok(false) => break None,
                Err(error) => break Some(error.to_string()),
            }
        };
        let (format, buses) = (reader.format().name, reader.buses().names().to_vec());
        Some(Self { format, frames, notices, buses, error })
    }

    fn read(path: &Path) -> Self {
        Self::of(path).unwrap()
    }

    fn ids(&self) -> Vec<String> {
        self.frames.iter().map(|frame| frame.id.to_string()).collect()
    }

    /// Bus and identifier of each frame.
    fn named(&self) -> Vec<String> {
        let named = |frame: &Frame| format!("{} {}", self.buses[usize::from(frame.bus.0)], frame.id);
        self.frames.iter().map(named).collect()
    }
}

/// A folder of a test.
struct Folder(TempDir);

impl Folder {
    fn new() -> Self {
        Self(tempfile::tempdir().unwrap())
    }

    fn path(&self, name: &str) -> PathBuf {
        self.0.path().join(name)
    }

    fn write(&self, name: &str, content: impl AsRef<[u8]>) -> PathBuf {
        let path = self.path(name);
        fs::write(&path, content).unwrap();
        path
    }

    /// Sorted names of the files in the folder.
    fn names(&self) -> Vec<String> {
        let entries = fs::read_dir(self.0.path()).unwrap();
        let mut names: Vec<_> =
            entries.map(|entry| entry.unwrap().file_name().to_string_lossy().into_owned()).collect();
        names.sort();
        names
    }

    /// Runs `convert` with these words; `@name` is a file in this folder.
    fn convert(&self, words: &[&str]) -> Output {
        let inside = |word: &&str| match word.strip_prefix('@') {
            Some(name) => self.path(name).to_str().unwrap().to_owned(),
            None => (*word).to_owned(),
        };
        let words: Vec<String> = words.iter().map(inside).collect();
        let mut arguments = vec!["convert"];
        arguments.extend(words.iter().map(String::as_str));
        let mut output = run(&arguments, "");
        // Messages must not depend on the folder of the run.
        output.stderr = output.stderr.replace(&format!("{}/", self.0.path().display()), "@");
        output
    }

    /// Converts without any message.
    fn converted(&self, words: &[&str]) -> Content {
        let output = self.convert(words);
        assert_eq!(output.code, 0, "{words:?}: {}", output.stderr);
        let out = words.last().unwrap().strip_prefix('@').unwrap();
        Content::read(&self.path(out))
    }
}

fn fixture(name: &str) -> PathBuf {
    workspace().join("fixtures").join(name)
}

/// Candump text with frames 1 ms apart.
fn log(frames: &[&str]) -> String {
    let line = |(at, frame): (usize, &&str)| format!("(1700000000.{at:03}000) can0 {frame}\n");
    frames.iter().enumerate().map(line).collect()
}
