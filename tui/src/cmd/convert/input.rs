//! The captures that are converted, as one.

use std::io::{self, Read};
use std::path::PathBuf;
use std::sync::Arc;

use anyhow::Context as _;
use cobscope_decoder::capture::{Batch, BusNames, Merged, MergedCapture, Reader};

use super::said::called;
use crate::cli::InputArgs;
use crate::cmd::input::read_options;
use crate::source::{self, Arranged, Frames, Progress, Store, StoreReader, arrange};

/// Captures being read.
pub(super) struct Input {
    reading: Reading,
    names: Vec<String>,
    /// What was read last.
    pub(super) batch: Batch,
    pub(super) progress: Progress,
}

enum Reading {
    One(Frames),
    Several(Merged<Box<dyn Read + Send>>),
}

impl Input {
    /// Opens captures. One alone is read as it comes; of several the first frames are looked at before.
    ///
    /// # Errors
    /// When one cannot be opened or recognised, or when they have no common line of time.
    pub(super) fn open(paths: &[PathBuf], input: &InputArgs, align: bool) -> anyhow::Result<Self> {
        let names: Vec<String> = paths.iter().map(|path| path.display().to_string()).collect();
        let (reading, progress) = match paths {
            [path] => {
                let (frames, progress) = source::open(path, &read_options(input))?.frames(true);
                (Reading::One(frames), progress)
            }
            paths => {
                let merged = Merged::new(several(paths, &names, input, align)?);
                (Reading::Several(merged), Progress::new(None, Arc::default()))
            }
        };
        Ok(Self { reading, names, batch: Batch::new(), progress })
    }

    /// Reads on; false at the end.
    ///
    /// # Errors
    /// When a capture cannot be read any further; the others can. It is told once.
    pub(super) fn read(&mut self) -> anyhow::Result<bool> {
        let (read, failed) = match &mut self.reading {
            Reading::One(frames) => (frames.read(&mut self.batch), 0),
            Reading::Several(merged) => (merged.read(&mut self.batch), merged.failed()),
        };
        read.with_context(|| self.names.get(failed).cloned().unwrap_or_default())
    }

    pub(super) fn buses(&self) -> &BusNames {
        match &self.reading {
            Reading::One(frames) => frames.buses(),
            Reading::Several(merged) => merged.buses(),
        }
    }

    /// Which capture a notice of the last batch is of, by its place among them.
    pub(super) fn teller(&self, notice: usize) -> usize {
        match &self.reading {
            Reading::One(_) => 0,
            Reading::Several(merged) => merged.teller(notice),
        }
    }

    /// What the captures are called, in their order.
    pub(super) fn names(&self) -> &[String] {
        &self.names
    }

    /// What one of them is called.
    pub(super) fn name(&self, capture: usize) -> &str {
        self.names.get(capture).map_or("", String::as_str)
    }

    /// What they are called together.
    pub(super) fn called(&self) -> String {
        called(&self.names, &(0..self.names.len()).collect())
    }
}

fn several(
    paths: &[PathBuf],
    names: &[String],
    input: &InputArgs,
    align: bool,
) -> anyhow::Result<Vec<MergedCapture<Box<dyn Read + Send>>>> {
    let options = read_options(input);
    let (mut stores, mut firsts) = (Vec::new(), Vec::new());
    for (path, name) in paths.iter().zip(names) {
        let store = Store::open(path)?;
        let mut reader = Reader::open(Whole(store.reader(0), Arc::clone(&store)), &options)
            .with_context(|| name.clone())?;
        let mut batch = Batch::new();
        while batch.frames().is_empty() && reader.read(&mut batch).with_context(|| name.clone())? {}
        firsts.push(batch.frames().first().and_then(|frame| frame.time));
        stores.push(store);
    }
    let arranged = arrange(names, &firsts, align)?;
    let captures =
        stores.iter().zip(arranged).zip(names).map(|((store, Arranged { group, shift }), name)| {
            let source: Box<dyn Read + Send> = Box::new(Whole(store.reader(0), Arc::clone(store)));
            let reader = Reader::open(source, &options).with_context(|| name.clone())?;
            Ok(MergedCapture { reader, group, shift })
        });
    captures.collect()
}

/// What a store holds, and why that is not all: where a source breaks off, what came last is no whole line or record.
struct Whole(StoreReader, Arc<Store>);

impl Read for Whole {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        match self.0.read(buffer)? {
            0 => self.1.error().map_or(Ok(0), Err),
            count => Ok(count),
        }
    }
}
