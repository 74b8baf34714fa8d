//! The folder of a lake: its files, and the list of captures in it.
//!
//! ```text
//! _staging/HASH/findings/machine=…/day=…/HASH.parquet      while a capture is read
//! _staging/HASH/commit.json                                all files are whole
//! findings/machine=…/day=…/HASH.parquet … captures/…       renamed, captures last
//! _index/ba/HASH.json                                      the capture and its files
//! ```
//!
//! Engines ignore folders that start with an underscore.

use std::fs::{self, File, TryLockError};
use std::io::{self, BufWriter, ErrorKind};
use std::path::{Path, PathBuf};

use anyhow::{Context as _, anyhow, ensure};
use cobscope_decoder::sink::Output;
use cobscope_decoder::sink::lake::{LakeFiles, TABLES, empty_table};

use super::machine::{UNKNOWN, partition_value, path_value};
use crate::output_file::{self, ExistingFile};
use crate::path_text::path_text;
use crate::run::lake_index::{EntrySummary, FOLDER as INDEX, LakeEntry, WIDE, file_stem};

/// Size of output buffers, in bytes.
const BUFFER: usize = 64 * 1024;

/// File of a staging folder that contains all files of its capture.
const COMMIT: &str = "commit.json";

/// File without rows of each table.
const EMPTY: &str = "empty.parquet";

/// A lake.
pub(super) struct LakeFolder {
    root: PathBuf,
}

impl LakeFolder {
    /// Opens or creates a lake, and completes or discards what interrupted runs left.
    ///
    /// # Errors
    /// The folder cannot be created or written.
    pub(super) fn open(root: &Path) -> anyhow::Result<Self> {
        let lake = Self { root: root.to_owned() };
        for folder in [INDEX, "_staging"] {
            let folder = root.join(folder);
            fs::create_dir_all(&folder)
                .with_context(|| format!("{}: cannot create the folder", path_text(&folder)))?;
        }
        lake.recover()?;
        lake.create_tables()?;
        Ok(lake)
    }

    /// Creates all tables, each with a file without rows: queries can name a table before its first row, and engines read
    /// machine and day as texts in every lake.
    fn create_tables(&self) -> anyhow::Result<()> {
        for table in TABLES {
            let path = self.path(&format!("{table}/machine={UNKNOWN}/day={UNKNOWN}/{EMPTY}"));
            if path.is_file() {
                continue;
            }
            // Other runs may do the same.
            let staged = self.root.join("_staging").join(format!("{table}-{}", std::process::id()));
            let write = || {
                path.parent().map_or(Ok(()), fs::create_dir_all)?;
                fs::write(&staged, empty_table(table)?)?;
                fs::rename(&staged, &path)
            };
            write().with_context(|| format!("{}: cannot be written", path_text(&path)))?;
        }
        Ok(())
    }

    fn recover(&self) -> anyhow::Result<()> {
        let staging = self.root.join("_staging");
        let entries = fs::read_dir(&staging).with_context(|| path_text(&staging))?;
        for entry in entries.flatten() {
            let name = entry.file_name().to_string_lossy().into_owned();
            let is_hash = name.len() == 64 && name.bytes().all(|byte| byte.is_ascii_hexdigit());
            if !is_hash || !entry.file_type().is_ok_and(|kind| kind.is_dir()) {
                continue;
            }
            // A locked one belongs to a run that is still at work.
            let Some(_lock) = self.try_lock(&name)? else { continue };
            self.complete(&name)?;
        }
        Ok(())
    }

    /// File whose lock covers all captures whose hashes start with the same two digits.
    fn lock_file(&self, hash: &str) -> anyhow::Result<File> {
        let folder = self.root.join(INDEX).join(hash.get(..2).unwrap_or("00"));
        let path = folder.join("lock");
        let open = || {
            fs::create_dir_all(&folder)?;
            File::options().create(true).truncate(false).write(true).open(&path)
        };
        open().with_context(|| format!("{}: cannot be written", path_text(&path)))
    }

    fn try_lock(&self, hash: &str) -> anyhow::Result<Option<File>> {
        let file = self.lock_file(hash)?;
        match file.try_lock() {
            Ok(()) => Ok(Some(file)),
            Err(TryLockError::WouldBlock) => Ok(None),
            Err(TryLockError::Error(error)) => Err(error).context("the lake cannot be locked"),
        }
    }

    /// Waits until no other run adds this capture.
    ///
    /// # Errors
    /// The file system has no locks.
    pub(super) fn lock(&self, hash: &str) -> anyhow::Result<CaptureLock> {
        let file = self.lock_file(hash)?;
        file.lock().context("the lake cannot be locked")?;
        self.complete(hash)?;
        Ok(CaptureLock { _file: file })
    }

    fn index_path(&self, hash: &str) -> PathBuf {
        self.root.join(INDEX).join(hash.get(..2).unwrap_or("00")).join(format!("{hash}.json"))
    }

    fn staging_path(&self, hash: &str) -> PathBuf {
        self.root.join("_staging").join(hash)
    }

    fn path(&self, file: &str) -> PathBuf {
        file.split('/').fold(self.root.clone(), |path, part| path.join(part))
    }

    /// Entry of a capture that is in the lake; its files exist.
    pub(super) fn entry(&self, hash: &str) -> Option<LakeEntry> {
        let entry = LakeEntry::read_entry(&self.index_path(hash), hash)?;
        let is_whole = !entry.files.is_empty() && entry.files.iter().all(|file| self.path(file).is_file());
        is_whole.then_some(entry)
    }

    /// Starts the files of a capture that is locked.
    ///
    /// # Errors
    /// The name of the machine is not valid, or the folder cannot be created.
    pub(super) fn stage(&self, hash: &str, machine: &str) -> anyhow::Result<CaptureStaging<'_>> {
        let partition = partition_value(machine)?;
        let folder = self.staging_path(hash);
        fs::create_dir_all(&folder)
            .with_context(|| format!("{}: cannot create the folder", path_text(&folder)))?;
        Ok(CaptureStaging {
            lake: self,
            hash: hash.to_owned(),
            machine: machine.to_owned(),
            partition,
            folder,
            files: Vec::new(),
        })
    }

    /// Renames the files of a staging folder if all of them are whole, and removes it.
    fn complete(&self, hash: &str) -> anyhow::Result<()> {
        let folder = self.staging_path(hash);
        if !folder.exists() {
            return Ok(());
        }
        if let Some(entry) = LakeEntry::read_entry(&folder.join(COMMIT), hash) {
            self.publish(&folder, hash, &entry)
                .with_context(|| format!("{}: cannot be completed", path_text(&folder)))?;
        }
        fs::remove_dir_all(&folder).with_context(|| format!("{}: cannot be removed", path_text(&folder)))
    }

    fn publish(&self, folder: &Path, hash: &str, entry: &LakeEntry) -> io::Result<()> {
        let before = LakeEntry::read_entry(&self.index_path(hash), hash);
        let before = before.into_iter().flat_map(|entry| entry.files);
        // A capture is not listed while its other files are replaced.
        for file in before.filter(|file| !entry.files.contains(file)).rev() {
            remove_if_present(&self.path(&file))?;
        }
        for file in &entry.files {
            let staged = file.split('/').fold(folder.to_owned(), |path, part| path.join(part));
            let place = self.path(file);
            if let Some(parent) = place.parent() {
                fs::create_dir_all(parent)?;
            }
            match fs::rename(&staged, &place) {
                // An interrupted run has renamed it.
                Err(error) if error.kind() == ErrorKind::NotFound && place.is_file() => {}
                renamed => renamed?,
            }
        }
        output_file::write_file(&self.index_path(hash), ExistingFile::Replace, entry.entry_json().as_bytes())
    }
}

fn remove_if_present(path: &Path) -> io::Result<()> {
    match fs::remove_file(path) {
        Err(error) if error.kind() != ErrorKind::NotFound => Err(error),
        _ => Ok(()),
    }
}

/// Right to add a capture, until it is dropped.
pub(super) struct CaptureLock {
    _file: File,
}

/// Files of a capture that is being read.
pub(super) struct CaptureStaging<'a> {
    lake: &'a LakeFolder,
    hash: String,
    machine: String,
    /// Name of the machine in paths.
    partition: String,
    folder: PathBuf,
    files: Vec<String>,
}

impl CaptureStaging<'_> {
    /// Makes all files part of the lake.
    ///
    /// # Errors
    /// A file cannot be written or renamed; the next run completes or discards them.
    pub(super) fn commit(mut self, capture: &str, summary: EntrySummary) -> anyhow::Result<usize> {
        let order = |file: &String| {
            let table = file.split('/').next().unwrap_or_default();
            TABLES.iter().position(|one| *one == table)
        };
        self.files.sort_by_key(order);
        let count = self.files.len();
        let write = |summary| -> io::Result<()> {
            for file in &self.files {
                let path = file.split('/').fold(self.folder.clone(), |path, part| path.join(part));
                File::options().write(true).open(path)?.sync_all()?;
            }
            let entry = LakeEntry {
                capture: capture.to_owned(),
                machine: self.machine.clone(),
                summary,
                files: self.files.clone(),
            };
            output_file::write_file(
                &self.folder.join(COMMIT),
                ExistingFile::Replace,
                entry.entry_json().as_bytes(),
            )
        };
        write(summary).with_context(|| format!("{}: cannot be written", path_text(&self.folder)))?;
        self.lake.complete(&self.hash)?;
        Ok(count)
    }

    /// Removes all files.
    pub(super) fn discard(self) {
        // What cannot be removed is discarded by the next run.
        let _ = fs::remove_dir_all(&self.folder);
    }
}

impl CaptureStaging<'_> {
    /// Creates a file in a folder of the lake.
    fn create_in(&mut self, place: &str, number: usize) -> io::Result<Output> {
        let stem = file_stem(&self.hash);
        let name = if number == 1 { format!("{stem}.parquet") } else { format!("{stem}-{number}.parquet") };
        let folder = place.split('/').fold(self.folder.clone(), |path, part| path.join(part));
        let path = folder.join(&name);
        let open = || {
            fs::create_dir_all(&folder)?;
            File::options().write(true).create_new(true).open(&path)
        };
        let file = open().map_err(|error| {
            io::Error::new(error.kind(), format!("{}: cannot be created: {error}", path_text(&path)))
        })?;
        self.files.push(format!("{place}/{name}"));
        Ok(Box::new(BufWriter::with_capacity(BUFFER, file)))
    }
}

impl LakeFiles for CaptureStaging<'_> {
    fn create_file(&mut self, table: &'static str, day: &str, number: usize) -> io::Result<Output> {
        self.create_in(&format!("{table}/machine={}/day={day}", self.partition), number)
    }

    fn create_wide(&mut self, message: &str, day: &str, number: usize) -> io::Result<Output> {
        // Names of buses and messages are of the capture, and may be any.
        let message = path_value(message);
        self.create_in(&format!("{WIDE}/{}/{message}/{}", self.partition, day.replace('-', "/")), number)
    }
}

/// Checks that a folder is a lake, or can become one: nothing else is written between the files of somebody.
///
/// # Errors
/// The folder contains other files.
pub(super) fn ensure_lake(root: &Path) -> anyhow::Result<()> {
    let Ok(entries) = fs::read_dir(root) else {
        ensure!(!root.exists(), "{}: expected a folder", path_text(root));
        return Ok(());
    };
    let names: Vec<_> = entries.flatten().map(|entry| entry.file_name()).collect();
    let is_lake = names.is_empty() || names.iter().any(|name| name == INDEX);
    is_lake.then_some(()).ok_or_else(|| {
        anyhow!(
            "{}: folder with other files; expected a lake, an empty folder or a new name",
            path_text(root)
        )
    })
}
