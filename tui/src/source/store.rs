//! The decompressed bytes of a capture for several readers. Files are read in place. Compressed captures,
//! standard input and live buses can be read only once; they are stored in unnamed temporary files.
//!
//! ```text
//! live: ░░░░ evicted ░░░░│ piece │ piece │ piece │ piece ◀─ written    the total size is limited
//! ```

use std::collections::VecDeque;
use std::fs::File;
use std::io::{self, BufReader, ErrorKind, Read, Write};
use std::path::Path;
use std::sync::{Arc, Condvar, Mutex, PoisonError, RwLock};
use std::time::{Duration, Instant};

use anyhow::Context as _;
use cobscope_decoder::capture::{decompress, is_compressed};
use cobscope_decoder::sink::escape;

use super::file::{HEAD, ensure_no_folder};
use super::original::{ContentChange, OriginalFile, OriginalReader};
use super::positioned::{read_at, write_at};

/// Number of bytes written to the temporary file at a time.
const PIECE: usize = 256 * 1024;

/// Bytes per microsecond below which the input is a live source: a CAN bus has 0.4.
const TRICKLE: u128 = 2;

/// Time for which the bytes of a live source are collected.
const GATHER: Duration = Duration::from_millis(10);

/// Minimum number of bytes kept of a live source: some hundred thousand frames.
const LEAST_KEPT: u64 = 16 * 1024 * 1024;

/// Number of pieces of a live store; they are evicted one by one.
const PIECES: u64 = 16;

/// The decompressed bytes of a capture.
pub struct DecompressedBytes {
    name: String,
    /// The file of the capture, unless it is a pipe or a live bus.
    original: Option<Arc<OriginalFile>>,
    /// Temporary files; none if the original is read in place.
    pieces: RwLock<VecDeque<StoreSegment>>,
    state: Mutex<DecompressionState>,
    grew: Condvar,
}

/// A file with the bytes from an offset up to the next piece.
#[derive(Debug, Clone)]
struct StoreSegment {
    start: u64,
    file: Arc<File>,
}

#[derive(Debug, Clone, Default)]
struct DecompressionState {
    /// Number of evicted bytes at the start.
    start: u64,
    length: u64,
    is_complete: bool,
    /// Error that ended the input.
    failure: Option<(ErrorKind, String)>,
    is_abandoned: bool,
}

impl DecompressedBytes {
    /// Opens a capture; `-` is standard input.
    ///
    /// # Errors
    /// The capture cannot be opened or a temporary file cannot be created.
    pub fn open(path: &Path) -> anyhow::Result<Arc<Self>> {
        let name = path.display().to_string();
        if path.as_os_str() == "-" {
            return Self::spool_source(name, None, Box::new(io::stdin()));
        }
        ensure_no_folder(path)?;
        let file = File::open(path).with_context(|| format!("{name}: cannot be opened"))?;
        let original = OriginalFile::for_path(path, &file)
            .with_context(|| format!("{name}: cannot read the file size"))?;
        let Some(original) = original.map(Arc::new) else {
            return Self::spool_source(name, None, Box::new(file));
        };
        let mut head = [0; 8];
        if is_compressed(&head_of(&file, &mut head)) {
            let source = original.single_reader().with_context(|| format!("{name}: cannot be opened"))?;
            return Self::spool_source(name, Some(original), Box::new(source));
        }
        let state = DecompressionState {
            length: original.length(),
            is_complete: true,
            ..DecompressionState::default()
        };
        Ok(Arc::new(Self {
            state: Mutex::new(state),
            ..Self::from_segments(name, Some(original), VecDeque::new())
        }))
    }

    fn from_segments(
        name: String,
        original: Option<Arc<OriginalFile>>,
        pieces: VecDeque<StoreSegment>,
    ) -> Self {
        Self { name, original, pieces: RwLock::new(pieces), state: Mutex::default(), grew: Condvar::new() }
    }

    /// A store for a live source; about the last `keep` bytes are kept.
    ///
    /// # Errors
    /// A temporary file cannot be created.
    pub fn for_live(name: String, keep: u64) -> anyhow::Result<(Arc<Self>, StoreWriter)> {
        let (_, pieces) = spool_file()?;
        let store = Arc::new(Self::from_segments(name, None, pieces));
        let keep = keep.max(LEAST_KEPT);
        let writer = StoreWriter { store: Arc::clone(&store), keep, piece: keep / PIECES, written: 0 };
        Ok((store, writer))
    }

    /// Copies a source, decompressed, to an unnamed temporary file while it is being read.
    fn spool_source(
        name: String,
        original: Option<Arc<OriginalFile>>,
        source: Box<dyn Read + Send>,
    ) -> anyhow::Result<Arc<Self>> {
        let (file, pieces) = spool_file()?;
        let store = Arc::new(Self::from_segments(name, original, pieces));
        let filled = Arc::clone(&store);
        std::thread::Builder::new()
            .name("spool".into())
            .spawn(move || {
                filled.finish_input(filled.fill_from(&file, source).err().map(|error| {
                    let cause = error.downcast_ref::<io::Error>();
                    (cause.map_or(ErrorKind::Other, io::Error::kind), format!("{error:#}"))
                }));
            })
            .context("cannot start a thread")?;
        Ok(store)
    }

    fn fill_from(&self, file: &File, source: Box<dyn Read + Send>) -> anyhow::Result<()> {
        let mut source = decompress(BufReader::with_capacity(HEAD, source))?;
        let mut piece = vec![0; PIECE];
        let (mut written, mut last) = (0, Instant::now());
        loop {
            let count = match source.read(&mut piece) {
                Ok(0) => return Ok(()),
                Ok(count) => count,
                Err(error) if error.kind() == ErrorKind::Interrupted => continue,
                Err(error) => return Err(error.into()),
            };
            let piece = piece.get(..count).unwrap_or_default();
            write_at(file, piece, written).context("cannot write the temporary file")?;
            written += count as u64;
            let mut state = self.lock();
            state.length = written;
            let is_abandoned = state.is_abandoned;
            drop(state);
            self.grew.notify_all();
            if is_abandoned {
                return Ok(());
            }
            // The bytes of a live source are collected for a while: each write wakes all waiting readers.
            let took = std::mem::replace(&mut last, Instant::now()).elapsed();
            if (count as u128) < took.as_micros() * TRICKLE {
                std::thread::sleep(GATHER);
            }
        }
    }

    fn lock(&self) -> std::sync::MutexGuard<'_, DecompressionState> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Name as given by the user.
    pub fn name(&self) -> &str {
        &self.name
    }

    /// Number of bytes so far, and whether these are all.
    pub fn length(&self) -> (u64, bool) {
        let state = self.lock();
        (state.length, state.is_complete)
    }

    /// Waits at most `most` for bytes beyond a length or for the end; whether one of them occurred.
    pub fn waits_beyond(&self, length: u64, most: Duration) -> bool {
        let is_quiet = |state: &mut DecompressionState| {
            state.length <= length && !state.is_complete && !state.is_abandoned
        };
        let waited = self.grew.wait_timeout_while(self.lock(), most, is_quiet);
        !waited.unwrap_or_else(PoisonError::into_inner).1.timed_out()
    }

    /// Number of evicted bytes at the start.
    pub fn start(&self) -> u64 {
        self.lock().start
    }

    /// The file with the byte at `offset`, its position there, and the number of bytes up to the next piece.
    fn place_at(&self, offset: u64) -> Option<(Arc<File>, u64, u64)> {
        let pieces = self.pieces.read().unwrap_or_else(PoisonError::into_inner);
        let behind = pieces.partition_point(|piece| piece.start <= offset);
        let piece = pieces.get(behind.checked_sub(1)?)?;
        let end = pieces.get(behind).map_or(u64::MAX, |next| next.start);
        Some((Arc::clone(&piece.file), offset - piece.start, end - offset))
    }

    /// Reason for an early end.
    pub fn failure(&self) -> Option<String> {
        self.end_error().map(|error| match error.kind() {
            ErrorKind::UnexpectedEof => format!("the file is cut off: {error}"),
            _ => error.to_string(),
        })
    }

    /// Compares the file of the capture with its state when it was opened, and returns a message on the change.
    pub fn file_change(&self) -> Option<String> {
        let original = self.original.as_ref()?;
        original.check_file();
        let (change, name) = (original.found_change()?, self.short_name());
        let has_copy = !self.is_in_place() && self.length().1 && self.end_error().is_none();
        Some(match change {
            ContentChange::Replaced => {
                format!("{name} is now another file; restart view to show it: the former one is shown")
            }
            ContentChange::Gone => format!("{name} was renamed or deleted while open; it is still shown"),
            _ if has_copy => {
                format!("{name} changed while open: {change}; restart view: the former content is shown")
            }
            _ => format!("{name} changed while open: {change}; restart view: counts and rows may not match"),
        })
    }

    /// File name without its folders, escaped.
    pub fn short_name(&self) -> String {
        let name = Path::new(&self.name).file_name().and_then(|name| name.to_str());
        escape(name.unwrap_or(&self.name)).into_owned()
    }

    /// Whether content that readers need is lost.
    pub fn has_lost_content(&self) -> bool {
        self.is_in_place()
            && self
                .original
                .as_ref()
                .and_then(|original| original.found_change())
                .is_some_and(ContentChange::is_content)
    }

    fn is_in_place(&self) -> bool {
        self.pieces.read().unwrap_or_else(PoisonError::into_inner).is_empty()
    }

    /// The error that a reader would return at the end.
    pub fn end_error(&self) -> Option<io::Error> {
        self.lock().failure.clone().map(|(kind, text)| io::Error::new(kind, text))
    }

    /// Ends waiting readers when the store is no longer needed.
    pub fn end_readers(&self) {
        self.lock().is_abandoned = true;
        self.grew.notify_all();
    }

    /// Ends the input, with an error if it failed.
    pub fn end_input(&self, failure: Option<String>) {
        self.finish_input(failure.map(|text| (ErrorKind::Other, text)));
    }

    fn finish_input(&self, failure: Option<(ErrorKind, String)>) {
        let mut state = self.lock();
        (state.is_complete, state.failure) = (true, failure);
        drop(state);
        self.grew.notify_all();
    }

    /// A reader from `offset`. At the present end it waits for more.
    pub fn reader_at(self: &Arc<Self>, offset: u64) -> StoreReader {
        let original = self.original.as_ref().filter(|_| self.is_in_place());
        let original = original.map(|original| original.reader_at(offset));
        StoreReader { store: Arc::clone(self), original, offset }
    }
}

/// A temporary file as the only segment of a store.
fn spool_file() -> anyhow::Result<(Arc<File>, VecDeque<StoreSegment>)> {
    let file = Arc::new(tempfile::tempfile().context("cannot create a temporary file")?);
    let segments = VecDeque::from([StoreSegment { start: 0, file: Arc::clone(&file) }]);
    Ok((file, segments))
}

/// The first bytes of a file, without moving its position.
fn head_of(file: &File, head: &mut [u8]) -> Vec<u8> {
    let count = read_at(file, head, 0).unwrap_or(0);
    head.get(..count).unwrap_or_default().to_vec()
}

/// A reader of a store.
pub struct StoreReader {
    store: Arc<DecompressedBytes>,
    /// The file read in place.
    original: Option<OriginalReader>,
    offset: u64,
}

impl Read for StoreReader {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        if let Some(original) = &mut self.original {
            return if self.store.lock().is_abandoned { Ok(0) } else { original.read(buffer) };
        }
        let mut state = self.store.lock();
        while self.offset >= state.length && !state.is_complete && !state.is_abandoned {
            state = self.store.grew.wait(state).unwrap_or_else(PoisonError::into_inner);
        }
        let available = state.length.saturating_sub(self.offset);
        let is_abandoned = state.is_abandoned;
        drop(state);
        let wanted = usize::try_from(available).unwrap_or(usize::MAX).min(buffer.len());
        if wanted == 0 || is_abandoned {
            return Ok(0);
        }
        let Some((file, place, whole)) = self.store.place_at(self.offset) else {
            return Err(io::Error::other("these frames are no longer kept (--keep)"));
        };
        let wanted = wanted.min(usize::try_from(whole).unwrap_or(usize::MAX));
        let count = read_at(&file, buffer.get_mut(..wanted).unwrap_or_default(), place)?;
        self.offset += count as u64;
        Ok(count)
    }
}

/// Writer of a live store. Readers see the bytes after a flush.
pub struct StoreWriter {
    store: Arc<DecompressedBytes>,
    keep: u64,
    /// Size of a piece in bytes.
    piece: u64,
    written: u64,
}

impl StoreWriter {
    /// Starts a new piece if the present one is full, and evicts the oldest pieces.
    fn make_room(&mut self) -> io::Result<()> {
        let mut pieces = self.store.pieces.write().unwrap_or_else(PoisonError::into_inner);
        let start = pieces.back().map_or(0, |piece| piece.start);
        if self.written - start < self.piece {
            return Ok(());
        }
        pieces.push_back(StoreSegment { start: self.written, file: Arc::new(tempfile::tempfile()?) });
        while pieces.len() > 1 && self.written - pieces.front().map_or(0, |piece| piece.start) > self.keep {
            pieces.pop_front();
        }
        let start = pieces.front().map_or(0, |piece| piece.start);
        drop(pieces);
        self.store.lock().start = start;
        Ok(())
    }

    /// The store being written.
    pub fn store(&self) -> Arc<DecompressedBytes> {
        Arc::clone(&self.store)
    }
}

impl Write for StoreWriter {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        self.make_room()?;
        let Some((file, place, _)) = self.store.place_at(self.written) else {
            return Err(io::Error::other("no temporary file"));
        };
        write_at(&file, bytes, place)?;
        self.written += bytes.len() as u64;
        Ok(bytes.len())
    }

    fn flush(&mut self) -> io::Result<()> {
        self.store.lock().length = self.written;
        self.store.grew.notify_all();
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_comes_in_pieces_is_read_whole_from_any_place() {
        let (mut writer, reader) = io::pipe().map(|(reader, writer)| (writer, reader)).unwrap();
        let store = DecompressedBytes::spool_source("-".into(), None, Box::new(reader)).unwrap();
        let late = {
            let store = Arc::clone(&store);
            std::thread::spawn(move || {
                let mut text = String::new();
                store.reader_at(3).read_to_string(&mut text).unwrap();
                text
            })
        };
        writer.write_all(b"012").unwrap();
        writer.write_all(b"345").unwrap();
        drop(writer);
        assert_eq!(late.join().unwrap(), "345");
        assert_eq!(store.length(), (6, true));
    }

    #[test]
    fn a_folder_is_no_capture() {
        let folder = tempfile::tempdir().unwrap();
        let error = DecompressedBytes::open(folder.path()).err().unwrap().to_string();
        assert!(
            error.ends_with(": a folder; name the captures in it, or use check for all of them"),
            "{error}"
        );
    }

    #[test]
    fn of_a_live_store_the_last_bytes_are_kept() {
        let (store, mut writer) = DecompressedBytes::for_live("live".into(), 0).unwrap();
        let chunk = |number: u64| vec![u8::try_from(number % 251).unwrap(); 1 << 20];
        let chunks = 40;
        for number in 0..chunks {
            writer.write_all(&chunk(number)).unwrap();
            writer.flush().unwrap();
        }
        let (length, is_complete) = store.length();
        assert_eq!((length, is_complete), (chunks << 20, false));
        let start = store.start();
        assert!(length - start >= LEAST_KEPT && length - start <= LEAST_KEPT * 2, "{start}");
        assert!(store.reader_at(0).read(&mut [0; 16]).is_err(), "the beginning is gone");
        store.end_input(None);
        let mut kept = Vec::new();
        store.reader_at(start).read_to_end(&mut kept).unwrap();
        let expected: Vec<u8> = (start >> 20..chunks).flat_map(chunk).collect();
        assert!(kept == expected, "what is kept is whole, across pieces");
    }

    #[cfg(feature = "gzip")]
    #[test]
    fn a_compressed_capture_is_shown_as_it_was() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.log.gz");
        let fixture = concat!(env!("CARGO_MANIFEST_DIR"), "/../fixtures/malformed/long_lines.log.gz");
        std::fs::copy(fixture, &path).unwrap();
        let store = DecompressedBytes::open(&path).unwrap();
        let mut text = Vec::new();
        store.reader_at(0).read_to_end(&mut text).unwrap();
        assert_eq!((store.file_change(), store.length()), (None, (text.len() as u64, true)));
        File::options().write(true).open(&path).unwrap().set_len(10).unwrap();
        let change = store.file_change().unwrap();
        assert!(change.ends_with("bytes are now 10; restart view: the former content is shown"), "{change}");
        assert!(!store.has_lost_content());
        let mut again = Vec::new();
        store.reader_at(0).read_to_end(&mut again).unwrap();
        assert!(again == text);
    }

    #[test]
    fn a_file_is_read_in_place() {
        let path = std::env::temp_dir().join(format!("cobscope-store-{}.log", std::process::id()));
        std::fs::write(&path, b"(1.0) can0 123#\n").unwrap();
        let store = DecompressedBytes::open(&path).unwrap();
        std::fs::remove_file(&path).unwrap();
        assert_eq!(store.length(), (16, true));
        let mut text = String::new();
        store.reader_at(6).read_to_string(&mut text).unwrap();
        assert_eq!(text, "can0 123#\n");
    }
}
