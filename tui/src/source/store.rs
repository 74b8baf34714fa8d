//! The bytes of a capture for many readers at once: a file read in place, or, of what can be read only once
//! (compressed captures, standard input), a temporary file that fills while it is read.

use std::fs::File;
use std::io::{BufReader, Read};
use std::path::Path;
use std::sync::{Arc, Condvar, Mutex, PoisonError};
use std::time::{Duration, Instant};

use anyhow::Context as _;
use cobscope_decoder::capture::{decompress, is_compressed};

use super::HEAD;

/// Bytes written to the temporary file at a time.
const PIECE: usize = 256 * 1024;

/// Fewer bytes than this in a microsecond come from something that happens as it is read: a CAN bus has 0.4.
const TRICKLE: u128 = 2;

/// How long what trickles is gathered.
const GATHER: Duration = Duration::from_millis(10);

/// The decompressed bytes of a capture.
pub struct Store {
    name: String,
    file: File,
    state: Mutex<State>,
    grew: Condvar,
}

#[derive(Debug, Clone, Default)]
struct State {
    length: u64,
    is_complete: bool,
    /// Why it ends where it does, if it should not.
    failure: Option<String>,
    is_abandoned: bool,
}

impl Store {
    /// Opens a capture; `-` is standard input.
    ///
    /// # Errors
    /// When it cannot be opened, or no temporary file can be made for it.
    pub fn open(path: &Path) -> anyhow::Result<Arc<Self>> {
        let name = path.display().to_string();
        if path.as_os_str() == "-" {
            return Self::spooled(name, Box::new(std::io::stdin()));
        }
        let file = File::open(path).with_context(|| format!("{name}: cannot be opened"))?;
        let metadata = file.metadata().with_context(|| format!("{name}: cannot be looked at"))?;
        let mut head = [0; 8];
        let is_in_place = metadata.is_file() && !is_compressed(&head_of(&file, &mut head));
        if !is_in_place {
            return Self::spooled(name, Box::new(file));
        }
        let state = State { length: metadata.len(), is_complete: true, ..State::default() };
        Ok(Arc::new(Self { name, file, state: Mutex::new(state), grew: Condvar::new() }))
    }

    /// Copies a source to a temporary file without a name, decompressed, while others read it.
    fn spooled(name: String, source: Box<dyn Read + Send>) -> anyhow::Result<Arc<Self>> {
        let file = tempfile::tempfile().context("no temporary file can be made")?;
        let store = Arc::new(Self { name, file, state: Mutex::new(State::default()), grew: Condvar::new() });
        let filled = Arc::clone(&store);
        std::thread::Builder::new()
            .name("spool".into())
            .spawn(move || {
                let failure = filled.fill(source).err().map(|error| format!("{error:#}"));
                let mut state = filled.lock();
                (state.is_complete, state.failure) = (true, failure);
                drop(state);
                filled.grew.notify_all();
            })
            .context("no thread can be started")?;
        Ok(store)
    }

    fn fill(&self, source: Box<dyn Read + Send>) -> anyhow::Result<()> {
        let mut source = decompress(BufReader::with_capacity(HEAD, source))?;
        let mut piece = vec![0; PIECE];
        let (mut written, mut last) = (0, Instant::now());
        loop {
            let count = match source.read(&mut piece) {
                Ok(0) => return Ok(()),
                Ok(count) => count,
                Err(error) if error.kind() == std::io::ErrorKind::Interrupted => continue,
                Err(error) => return Err(anyhow::Error::from(error).context("reading failed")),
            };
            let piece = piece.get(..count).unwrap_or_default();
            write_at(&self.file, piece, written).context("the temporary file cannot be written")?;
            written += count as u64;
            let mut state = self.lock();
            state.length = written;
            let is_abandoned = state.is_abandoned;
            drop(state);
            self.grew.notify_all();
            if is_abandoned {
                return Ok(());
            }
            // What trickles is gathered a while: each piece wakes all who wait for more.
            let took = std::mem::replace(&mut last, Instant::now()).elapsed();
            if (count as u128) < took.as_micros() * TRICKLE {
                std::thread::sleep(GATHER);
            }
        }
    }

    fn lock(&self) -> std::sync::MutexGuard<'_, State> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// What the user called it.
    pub fn name(&self) -> &str {
        &self.name
    }

    /// Bytes there are by now, and whether these are all.
    pub fn length(&self) -> (u64, bool) {
        let state = self.lock();
        (state.length, state.is_complete)
    }

    /// Why it ends early, if it does.
    pub fn failure(&self) -> Option<String> {
        self.lock().failure.clone()
    }

    /// Nobody reads it any more: readers that wait come to the end.
    pub fn abandon(&self) {
        self.lock().is_abandoned = true;
        self.grew.notify_all();
    }

    /// A reader from `offset` on. At what is there by now it waits for more.
    pub fn reader(self: &Arc<Self>, offset: u64) -> StoreReader {
        StoreReader { store: Arc::clone(self), offset }
    }
}

/// The first bytes of a file, without moving in it.
fn head_of(file: &File, head: &mut [u8]) -> Vec<u8> {
    let count = read_at(file, head, 0).unwrap_or(0);
    head.get(..count).unwrap_or_default().to_vec()
}

#[cfg(unix)]
fn read_at(file: &File, buffer: &mut [u8], offset: u64) -> std::io::Result<usize> {
    std::os::unix::fs::FileExt::read_at(file, buffer, offset)
}

#[cfg(windows)]
fn read_at(file: &File, buffer: &mut [u8], offset: u64) -> std::io::Result<usize> {
    std::os::windows::fs::FileExt::seek_read(file, buffer, offset)
}

#[cfg(unix)]
fn write_at(file: &File, bytes: &[u8], offset: u64) -> std::io::Result<()> {
    std::os::unix::fs::FileExt::write_all_at(file, bytes, offset)
}

#[cfg(windows)]
fn write_at(file: &File, mut bytes: &[u8], mut offset: u64) -> std::io::Result<()> {
    while !bytes.is_empty() {
        let count = std::os::windows::fs::FileExt::seek_write(file, bytes, offset)?;
        bytes = bytes.get(count..).unwrap_or_default();
        offset += count as u64;
    }
    Ok(())
}

/// Reads a store from some place on.
pub struct StoreReader {
    store: Arc<Store>,
    offset: u64,
}

impl Read for StoreReader {
    fn read(&mut self, buffer: &mut [u8]) -> std::io::Result<usize> {
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
        let count = read_at(&self.store.file, buffer.get_mut(..wanted).unwrap_or_default(), self.offset)?;
        self.offset += count as u64;
        Ok(count)
    }
}

#[cfg(test)]
mod tests {
    use std::io::Write as _;

    use super::*;

    #[test]
    fn what_comes_in_pieces_is_read_whole_from_any_place() {
        let (mut writer, reader) = std::io::pipe().map(|(reader, writer)| (writer, reader)).unwrap();
        let store = Store::spooled("-".into(), Box::new(reader)).unwrap();
        let late = {
            let store = Arc::clone(&store);
            std::thread::spawn(move || {
                let mut text = String::new();
                store.reader(3).read_to_string(&mut text).unwrap();
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
    fn a_file_is_read_in_place() {
        let path = std::env::temp_dir().join(format!("cobscope-store-{}.log", std::process::id()));
        std::fs::write(&path, b"(1.0) can0 123#\n").unwrap();
        let store = Store::open(&path).unwrap();
        std::fs::remove_file(&path).unwrap();
        assert_eq!(store.length(), (16, true));
        let mut text = String::new();
        store.reader(6).read_to_string(&mut text).unwrap();
        assert_eq!(text, "can0 123#\n");
    }
}
