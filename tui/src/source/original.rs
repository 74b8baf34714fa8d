//! The file of a capture and its changes while it is open.
//!
//! ```text
//! first read of a block ─▶ checksum kept │ read again ─▶ compared
//! size, time, name      ─▶ compared by `check`; a new time alone is no change
//! ```
//!
//! A file that grows is not changed: bytes after its first length are not part of the capture.

use std::fmt;
use std::fs::{File, Metadata};
use std::io::{self, ErrorKind, Read, Seek as _};
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::SystemTime;

use cobscope_decoder::words::group_digits;

use super::positioned::read_at;
use crate::file_identity::StorageIdentity;

/// Bytes of a block: as many as a capture reader requests.
const BLOCK: u64 = 256 * 1024;

/// Maximum number of checksums kept; blocks of larger files are longer.
const MOST_BLOCKS: u64 = 65_536;

/// Number of blocks that one check reads again.
const CHECKED: usize = 64;

/// A difference between a file and its former content.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ContentChange {
    /// Its name now belongs to another file.
    Replaced,
    /// No file has its name.
    Gone,
    /// It is shorter than before.
    Shrunk {
        /// Length when it was opened.
        from: u64,
        /// Length found.
        to: u64,
    },
    /// The block at this byte differs from its first reading.
    Rewritten(u64),
}

impl ContentChange {
    /// Whether bytes that were read are lost; another name is harmless.
    pub fn is_content(self) -> bool {
        matches!(self, Self::Shrunk { .. } | Self::Rewritten(_))
    }

    fn to_io_error(self) -> io::Error {
        io::Error::other(format!("file changed: {self}"))
    }
}

impl fmt::Display for ContentChange {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Replaced => f.write_str("another file has its name"),
            Self::Gone => f.write_str("renamed or deleted"),
            Self::Shrunk { from, to } => {
                write!(f, "{} bytes are now {}", group_digits(*from), group_digits(*to))
            }
            Self::Rewritten(at) => {
                write!(f, "content at byte {} differs", group_digits(*at))
            }
        }
    }
}

/// An open file with the checksums of its blocks.
pub struct OriginalFile {
    path: PathBuf,
    file: File,
    length: u64,
    identity: StorageIdentity,
    block: u64,
    /// Checksum of each block; 0 before its first reading.
    sums: Vec<AtomicU64>,
    state: Mutex<OriginalChecks>,
}

/// Result of the checks so far.
struct OriginalChecks {
    /// Time of the last change that was checked.
    modified: Option<SystemTime>,
    /// Next block to read again, and number of blocks left since the time changed.
    next: usize,
    left: usize,
    change: Option<ContentChange>,
}

impl OriginalFile {
    /// `None` if the input is not a regular file: pipes and devices have no content to compare.
    pub fn for_path(path: &Path, file: &File) -> io::Result<Option<Self>> {
        let metadata = file.metadata()?;
        if !metadata.is_file() {
            return Ok(None);
        }
        let length = metadata.len();
        let block = BLOCK.max(length.div_ceil(MOST_BLOCKS).next_multiple_of(BLOCK));
        let count = usize::try_from(length.div_ceil(block)).unwrap_or(0);
        let modified = metadata.modified().ok();
        Ok(Some(Self {
            path: path.to_owned(),
            file: file.try_clone()?,
            length,
            identity: StorageIdentity::of_file(file)?,
            block,
            sums: (0..count).map(|_| AtomicU64::new(0)).collect(),
            state: Mutex::new(OriginalChecks { modified, next: 0, left: 0, change: None }),
        }))
    }

    /// Length when it was opened.
    pub fn length(&self) -> u64 {
        self.length
    }

    /// The change found so far; lost content takes precedence over another name.
    pub fn found_change(&self) -> Option<ContentChange> {
        self.lock().change
    }

    fn lock(&self) -> std::sync::MutexGuard<'_, OriginalChecks> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Notes a change and returns the one to report: the first change of content stays.
    fn note_change(&self, change: ContentChange) -> ContentChange {
        let mut state = self.lock();
        let known = state.change.filter(|known| known.is_content());
        *state.change.insert(known.unwrap_or(change))
    }

    /// Compares size, time and name with those at the start. After a new time, blocks that were read are
    /// compared, a limited number per call.
    pub fn check_file(&self) {
        let Ok(metadata) = self.file.metadata() else { return };
        if metadata.len() < self.length {
            self.note_change(ContentChange::Shrunk { from: self.length, to: metadata.len() });
        }
        match StorageIdentity::of_path(&self.path) {
            Ok(named) if named != self.identity => {
                self.note_change(ContentChange::Replaced);
            }
            // Its name is back.
            Ok(_) => self.forget_name(),
            Err(error) if error.kind() == ErrorKind::NotFound => {
                self.note_change(ContentChange::Gone);
            }
            Err(_) => {}
        }
        self.check_content(&metadata);
    }

    fn forget_name(&self) {
        self.lock().change.take_if(|change| !change.is_content());
    }

    /// Compares blocks that were read, after a new time.
    fn check_content(&self, metadata: &Metadata) {
        let mut state = self.lock();
        let modified = metadata.modified().ok();
        if modified != state.modified {
            (state.modified, state.left) = (modified, self.sums.len());
        }
        if state.left == 0 || state.change.is_some_and(ContentChange::is_content) {
            return;
        }
        let (from, count) = (state.next, state.left.min(CHECKED));
        state.left -= count;
        state.next = (from + count) % self.sums.len().max(1);
        drop(state);
        let mut bytes = Vec::new();
        // The first block differs after most changes.
        for index in
            std::iter::once(0).chain((from..from + count).map(|index| index % self.sums.len().max(1)))
        {
            let is_read = self.sums.get(index).is_some_and(|sum| sum.load(Ordering::Relaxed) != 0);
            if is_read && self.read_block(index as u64, &mut bytes).is_err() {
                return;
            }
        }
    }

    /// Reads a block and compares it with its first reading.
    fn read_block(&self, index: u64, bytes: &mut Vec<u8>) -> io::Result<()> {
        let start = index.saturating_mul(self.block);
        let length = self.length.saturating_sub(start).min(self.block);
        bytes.resize(usize::try_from(length).unwrap_or(0), 0);
        let mut filled = 0;
        while let Some(rest) = bytes.get_mut(filled..).filter(|rest| !rest.is_empty()) {
            match read_at(&self.file, rest, start.saturating_add(filled as u64)) {
                Ok(0) => {
                    let to = start.saturating_add(filled as u64);
                    return Err(self
                        .note_change(ContentChange::Shrunk { from: self.length, to })
                        .to_io_error());
                }
                Ok(count) => filled += count,
                Err(error) if error.kind() == ErrorKind::Interrupted => {}
                Err(error) => return Err(error),
            }
        }
        let Some(known) = usize::try_from(index).ok().and_then(|index| self.sums.get(index)) else {
            return Ok(());
        };
        let sum = block_checksum(bytes);
        // Content that nobody read before the change would mix two captures.
        if known.load(Ordering::Relaxed) == 0
            && let Some(change) = self.found_change().filter(|change| change.is_content())
        {
            return Err(change.to_io_error());
        }
        match known.compare_exchange(0, sum, Ordering::Relaxed, Ordering::Relaxed) {
            Err(first) if first != sum => {
                Err(self.note_change(ContentChange::Rewritten(start)).to_io_error())
            }
            _ => Ok(()),
        }
    }

    /// A reader of the content when it was opened, from `offset`.
    pub fn reader_at(self: &Arc<Self>, offset: u64) -> OriginalReader {
        OriginalReader { original: Arc::clone(self), offset, start: 0, bytes: Vec::new() }
    }

    /// A reader of the whole file, also of appended content. It makes no checksums, and checks the size at the
    /// end.
    ///
    /// # Errors
    /// The file cannot be opened a second time.
    pub fn single_reader(self: &Arc<Self>) -> io::Result<SingleReader> {
        let mut file = self.file.try_clone()?;
        // On Windows, reading at a position moves this one.
        file.rewind()?;
        Ok(SingleReader { original: Arc::clone(self), file })
    }
}

/// A reader of a file that is read once, from its start to its end.
pub struct SingleReader {
    original: Arc<OriginalFile>,
    file: File,
}

impl Read for SingleReader {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        let count = self.file.read(buffer)?;
        if count == 0 && !buffer.is_empty() {
            self.original.check_file();
            if let Some(change) = self.original.found_change().filter(|change| change.is_content()) {
                return Err(change.to_io_error());
            }
        }
        Ok(count)
    }
}

/// A reader of a file.
pub struct OriginalReader {
    original: Arc<OriginalFile>,
    offset: u64,
    /// Offset and content of the last block.
    start: u64,
    bytes: Vec<u8>,
}

impl Read for OriginalReader {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        if self.offset >= self.original.length {
            return Ok(0);
        }
        let end = self.start.saturating_add(self.bytes.len() as u64);
        if !(self.start..end).contains(&self.offset) {
            let index = self.offset / self.original.block;
            self.start = index.saturating_mul(self.original.block);
            if let Err(error) = self.original.read_block(index, &mut self.bytes) {
                self.bytes.clear();
                return Err(error);
            }
        }
        let place = usize::try_from(self.offset.saturating_sub(self.start)).unwrap_or(usize::MAX);
        let rest = self.bytes.get(place..).unwrap_or_default();
        let count = rest.len().min(buffer.len());
        if let (Some(target), Some(source)) = (buffer.get_mut(..count), rest.get(..count)) {
            target.copy_from_slice(source);
        }
        self.offset += count as u64;
        Ok(count)
    }
}

/// Checksum of a block, never 0. It detects changes, not forgeries.
fn block_checksum(bytes: &[u8]) -> u64 {
    const FACTOR: u64 = 0x9E37_79B9_7F4A_7C15;
    let mix = |sum: u64, word: u64| (sum.rotate_left(5) ^ word).wrapping_mul(FACTOR);
    let (words, rest) = bytes.as_chunks::<8>();
    let sum = words.iter().fold(bytes.len() as u64, |sum, word| mix(sum, u64::from_le_bytes(*word)));
    rest.iter().fold(sum, |sum, byte| mix(sum, u64::from(*byte))).max(1)
}

#[cfg(test)]
mod tests {
    use std::fs;
    use std::time::Duration;

    use super::*;

    /// A file of ten lines of 100 bytes with its reader.
    struct Opened {
        folder: tempfile::TempDir,
        original: Arc<OriginalFile>,
    }

    fn content(letter: char, lines: usize) -> String {
        format!("{}\n", letter.to_string().repeat(99)).repeat(lines)
    }

    impl Opened {
        fn new() -> Self {
            let folder = tempfile::tempdir().unwrap();
            let path = folder.path().join("a.log");
            fs::write(&path, content('a', 10)).unwrap();
            let original = OriginalFile::for_path(&path, &File::open(&path).unwrap()).unwrap().unwrap();
            let opened = Self { folder, original: Arc::new(original) };
            assert_eq!(opened.read(0).unwrap(), content('a', 10));
            opened
        }

        fn path(&self) -> PathBuf {
            self.folder.path().join("a.log")
        }

        fn read(&self, offset: u64) -> io::Result<String> {
            let mut text = String::new();
            self.original.reader_at(offset).read_to_string(&mut text)?;
            Ok(text)
        }

        /// Writes into the file itself and sets its time, so that the test needs no pause.
        fn write(&self, bytes: &[u8], at: u64, minutes: u64) {
            let file = fs::OpenOptions::new().write(true).open(self.path()).unwrap();
            crate::source::positioned::write_at(&file, bytes, at).unwrap();
            file.set_modified(SystemTime::now() + Duration::from_mins(minutes)).unwrap();
        }

        fn checked(&self) -> Option<ContentChange> {
            self.original.check_file();
            self.original.found_change()
        }
    }

    #[test]
    fn a_shorter_file_is_changed_and_not_read_again() {
        let opened = Opened::new();
        fs::OpenOptions::new().write(true).open(opened.path()).unwrap().set_len(800).unwrap();
        let error = opened.read(900).unwrap_err().to_string();
        assert_eq!(error, "file changed: 1,000 bytes are now 800");
        assert_eq!(opened.checked(), Some(ContentChange::Shrunk { from: 1_000, to: 800 }));
        // Without a reader, the check finds it.
        let opened = Opened::new();
        fs::OpenOptions::new().write(true).open(opened.path()).unwrap().set_len(800).unwrap();
        assert_eq!(opened.checked(), Some(ContentChange::Shrunk { from: 1_000, to: 800 }));
    }

    #[test]
    fn other_content_of_the_same_length_is_a_change() {
        let opened = Opened::new();
        opened.write(b"b", 950, 0);
        let error = opened.read(0).unwrap_err().to_string();
        assert_eq!(error, "file changed: content at byte 0 differs");
        let opened = Opened::new();
        opened.write(b"b", 950, 1);
        assert_eq!(opened.checked(), Some(ContentChange::Rewritten(0)));
        assert!(opened.read(0).is_err(), "and it stays one");
    }

    #[test]
    fn a_new_time_and_new_lines_are_no_change() {
        let opened = Opened::new();
        opened.write(b"", 0, 1);
        assert_eq!(opened.checked(), None);
        opened.write(content('b', 3).as_bytes(), 1_000, 2);
        assert_eq!(opened.checked(), None);
        assert_eq!(opened.read(0).unwrap(), content('a', 10), "new lines are not part of the capture");
        // A file that is written again from its start, and is longer than before.
        fs::write(opened.path(), content('c', 20)).unwrap();
        opened.write(b"", 0, 3);
        assert_eq!(opened.checked(), Some(ContentChange::Rewritten(0)));
    }

    #[test]
    fn a_replaced_file_is_still_readable() {
        let opened = Opened::new();
        fs::rename(opened.path(), opened.folder.path().join("a.log.1")).unwrap();
        assert_eq!(opened.checked(), Some(ContentChange::Gone));
        fs::write(opened.path(), content('b', 10)).unwrap();
        assert_eq!(opened.checked(), Some(ContentChange::Replaced));
        assert_eq!(opened.read(0).unwrap(), content('a', 10));
        fs::rename(opened.folder.path().join("a.log.1"), opened.path()).unwrap();
        assert_eq!(opened.checked(), None, "the name is back");
        fs::rename(opened.path(), opened.folder.path().join("a.log.1")).unwrap();
        let former = fs::OpenOptions::new().write(true).open(opened.folder.path().join("a.log.1")).unwrap();
        former.set_len(0).unwrap();
        assert_eq!(opened.checked(), Some(ContentChange::Shrunk { from: 1_000, to: 0 }));
    }

    /// A block that was not read before the change would mix two captures.
    #[test]
    fn after_a_change_only_known_blocks_are_read() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("long.log");
        let length = usize::try_from(BLOCK).unwrap() * 3;
        fs::write(&path, vec![b'a'; length]).unwrap();
        let original = Arc::new(OriginalFile::for_path(&path, &File::open(&path).unwrap()).unwrap().unwrap());
        let mut buffer = vec![0; 10];
        let mut read = |offset: u64| original.reader_at(offset).read(&mut buffer);
        read(0).unwrap();
        read(BLOCK).unwrap();
        let file = fs::OpenOptions::new().write(true).open(&path).unwrap();
        crate::source::positioned::write_at(&file, b"b", BLOCK + 5).unwrap();
        let error = read(BLOCK).unwrap_err().to_string();
        assert!(error.ends_with("content at byte 262,144 differs"), "{error}");
        assert!(read(2 * BLOCK).is_err());
        assert_eq!(read(0).unwrap(), 10);
    }

    #[test]
    fn who_reads_once_gets_new_lines_and_an_error_for_missing_ones() {
        let opened = Opened::new();
        opened.write(content('b', 2).as_bytes(), 1_000, 1);
        let mut text = String::new();
        opened.original.single_reader().unwrap().read_to_string(&mut text).unwrap();
        assert_eq!(text.len(), 1_200);
        fs::OpenOptions::new().write(true).open(opened.path()).unwrap().set_len(0).unwrap();
        assert!(opened.original.single_reader().unwrap().read_to_string(&mut text).is_err());
    }
}
