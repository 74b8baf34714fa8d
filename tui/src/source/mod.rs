//! All input: files and standard input, decompressed, as readers of frames.

mod ahead;
mod arrange;
pub mod live;
mod progress;
mod store;

use std::fs::File;
use std::io::{BufRead as _, BufReader, Read};
use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::thread::available_parallelism;

use anyhow::{Context as _, ensure};
use cobscope_decoder::capture::{ReadOptions, Reader, decompress, is_compressed};

pub use ahead::{Ahead, Frames};
pub use arrange::{Arranged, arrange};
pub use progress::Progress;
pub use store::{Store, StoreReader, StoreWriter};

/// Bytes read ahead only to see whether the file is compressed; larger reads pass by this buffer.
const HEAD: usize = 16 * 1024;

/// Bytes of a file from which reading it takes longer than beginning a thread.
const WORTH_A_THREAD: u64 = 256 * 1024;

/// An open capture.
pub struct Capture {
    /// Frames.
    pub reader: Reader<Box<dyn Read + Send>>,
    /// How far it is read, for a long file on a terminal.
    pub progress: Progress,
    /// Bytes of the file; of none where it is no file.
    size: u64,
    is_compressed: bool,
}

impl Capture {
    /// Its frames, read on a thread of its own where that is worth it and another core may be free. What comes of a
    /// pipe is not: each line of it is to be seen when it comes.
    pub fn frames(self, may_read_ahead: bool) -> (Frames, Progress) {
        let cores = available_parallelism().map_or(1, usize::from);
        // Binary formats are read in less time than their frames take from one core to the other.
        let takes_long = self.size >= WORTH_A_THREAD && (self.is_compressed || self.reader.format().is_text);
        let frames = if may_read_ahead && cores > 1 && takes_long {
            Frames::Ahead(Ahead::new(self.reader))
        } else {
            Frames::Here(self.reader)
        };
        (frames, self.progress)
    }
}

/// Opens a capture; `-` is standard input.
pub fn open(path: &Path, options: &ReadOptions) -> anyhow::Result<Capture> {
    let taken = Arc::new(AtomicU64::new(0));
    let (source, size): (Box<dyn Read + Send>, _) = if path.as_os_str() == "-" {
        (Box::new(std::io::stdin()), None)
    } else {
        let file = File::open(path).with_context(|| format!("{}: cannot be opened", path.display()))?;
        ensure_no_folder(path)?;
        let size = file.metadata().ok().filter(std::fs::Metadata::is_file).map(|metadata| metadata.len());
        (Box::new(file), size)
    };
    let source = Counted { source, taken: Arc::clone(&taken) };
    let name = path.display();
    let mut source = BufReader::with_capacity(HEAD, source);
    let is_compressed = is_compressed(source.fill_buf().with_context(|| name.to_string())?);
    let source = decompress(source).with_context(|| name.to_string())?;
    let reader = Reader::open(source, options).with_context(|| name.to_string())?;
    Ok(Capture { reader, progress: Progress::new(size, taken), size: size.unwrap_or(0), is_compressed })
}

/// Refuses a folder, which can be opened but not read.
fn ensure_no_folder(path: &Path) -> anyhow::Result<()> {
    ensure!(!path.is_dir(), "{}: a folder; name the captures in it, or judge all with check", path.display());
    Ok(())
}

/// Counts the bytes that were read of the file itself.
struct Counted {
    source: Box<dyn Read + Send>,
    taken: Arc<AtomicU64>,
}

impl Read for Counted {
    fn read(&mut self, buffer: &mut [u8]) -> std::io::Result<usize> {
        let count = self.source.read(buffer)?;
        self.taken.fetch_add(count as u64, Ordering::Relaxed);
        Ok(count)
    }
}
