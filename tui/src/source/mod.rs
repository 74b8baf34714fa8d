//! All input: files and standard input, decompressed, as readers of frames.

mod arrange;
pub mod live;
mod progress;
mod store;

use std::fs::File;
use std::io::{BufReader, Read};
use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

use anyhow::Context as _;
use cobscope_decoder::capture::{ReadOptions, Reader, decompress};

pub use arrange::{Arranged, arrange};
pub use progress::Progress;
pub use store::{Store, StoreReader, StoreWriter};

/// Bytes read ahead only to see whether the file is compressed; larger reads pass by this buffer.
const HEAD: usize = 16 * 1024;

/// An open capture.
pub struct Capture {
    /// Frames.
    pub reader: Reader<Box<dyn Read>>,
    /// How far it is read, for a long file on a terminal.
    pub progress: Progress,
}

/// Opens a capture; `-` is standard input.
pub fn open(path: &Path, options: &ReadOptions) -> anyhow::Result<Capture> {
    let taken = Arc::new(AtomicU64::new(0));
    let (source, size): (Box<dyn Read>, _) = if path.as_os_str() == "-" {
        (Box::new(std::io::stdin().lock()), None)
    } else {
        let file = File::open(path).with_context(|| format!("{}: cannot be opened", path.display()))?;
        let size = file.metadata().ok().filter(std::fs::Metadata::is_file).map(|metadata| metadata.len());
        (Box::new(file), size)
    };
    let source = Counted { source, taken: Arc::clone(&taken) };
    let name = path.display();
    let source = decompress(BufReader::with_capacity(HEAD, source)).with_context(|| name.to_string())?;
    let reader = Reader::open(source, options).with_context(|| name.to_string())?;
    Ok(Capture { reader, progress: Progress::new(size, taken) })
}

/// Counts the bytes that were read of the file itself.
struct Counted {
    source: Box<dyn Read>,
    taken: Arc<AtomicU64>,
}

impl Read for Counted {
    fn read(&mut self, buffer: &mut [u8]) -> std::io::Result<usize> {
        let count = self.source.read(buffer)?;
        self.taken.fetch_add(count as u64, Ordering::Relaxed);
        Ok(count)
    }
}
