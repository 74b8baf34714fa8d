//! Files and standard input, decompressed, as frame readers.

use std::fs::File;
use std::io::{BufRead as _, BufReader, Read};
use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::thread::available_parallelism;

use anyhow::{Context as _, ensure};
use cobscope_decoder::capture::{
    CaptureError, CaptureReader, ForeignFile, ReadOptions, decompress, foreign_file, is_compressed,
};

use super::ahead::{FramesAhead, ReadAhead};
use super::original::OriginalFile;
use super::progress::ProgressLine;
use crate::device_name;
use crate::path_text::path_text;

/// Bytes buffered to detect compression; larger reads bypass the buffer.
pub(super) const HEAD: usize = 16 * 1024;

/// File size from which reading takes longer than starting a thread.
const WORTH_A_THREAD: u64 = 256 * 1024;

/// An open capture.
pub struct OpenCapture {
    /// Reader of its frames.
    pub reader: CaptureReader<Box<dyn Read + Send>>,
    /// Progress display for a long file.
    pub progress: ProgressLine,
    /// Size of the file in bytes; 0 for other inputs.
    size: u64,
    is_compressed: bool,
}

impl OpenCapture {
    /// The frames, read in another thread if that is faster and a core may be free. Pipes are not read ahead,
    /// because each line must be processed when it arrives.
    pub fn read_frames(self, may_read_ahead: bool) -> (FramesAhead, ProgressLine) {
        let cores = available_parallelism().map_or(1, usize::from);
        // Reading plain binary frames takes less time than passing them to another core.
        let format = self.reader.format();
        let is_slow = self.is_compressed || format.is_packed || format.is_text;
        let takes_long = self.size >= WORTH_A_THREAD && is_slow;
        let frames = if may_read_ahead && cores > 1 && takes_long {
            FramesAhead::Ahead(ReadAhead::new(self.reader))
        } else {
            FramesAhead::Here(self.reader)
        };
        (frames, self.progress)
    }
}

/// Opens a capture; `-` is standard input.
pub fn open_capture(path: &Path, options: &ReadOptions) -> anyhow::Result<OpenCapture> {
    let taken = Arc::new(AtomicU64::new(0));
    let (source, size): (Box<dyn Read + Send>, _) = if path.as_os_str() == "-" {
        (Box::new(std::io::stdin()), None)
    } else {
        ensure_no_folder(path)?;
        let file = File::open(path).with_context(|| format!("{}: cannot be opened", path_text(path)))?;
        let original = OriginalFile::for_path(path, &file).with_context(|| path_text(path))?.map(Arc::new);
        match original {
            Some(original) => {
                let source = original
                    .single_reader()
                    .with_context(|| format!("{}: cannot be opened", path_text(path)))?;
                (Box::new(source), Some(original.length()))
            }
            None => (Box::new(file), None),
        }
    };
    let source = CountedInput { source, taken: Arc::clone(&taken) };
    let name = path_text(path);
    let mut source = BufReader::with_capacity(HEAD, source);
    let is_compressed = is_compressed(source.fill_buf().with_context(|| name.clone())?);
    let source = decompress(source).with_context(|| name.clone())?;
    let reader = CaptureReader::open(source, options).map_err(|error| name_by_suffix(error, path));
    let reader = reader.with_context(|| name.clone())?;
    Ok(OpenCapture {
        reader,
        progress: ProgressLine::new(size, taken),
        size: size.unwrap_or(0),
        is_compressed,
    })
}

/// Names a file without known content by the suffix of its name.
fn name_by_suffix(error: CaptureError, path: &Path) -> CaptureError {
    let suffix = path.extension().and_then(|suffix| suffix.to_str());
    match (error, foreign_file(&[], suffix)) {
        (CaptureError::Unrecognised { .. }, Some(ForeignFile { name, remedy })) => {
            CaptureError::Foreign { name, remedy }
        }
        (error, _) => error,
    }
}

/// Rejects a folder: on Unix it can be opened but not read, on Windows neither.
pub(super) fn ensure_no_folder(path: &Path) -> anyhow::Result<()> {
    ensure!(
        device_name::is_device(path) || !path.is_dir(),
        "{}: a folder; name the captures in it, or use check for all of them",
        path_text(path)
    );
    Ok(())
}

/// Counts the bytes read from the compressed file.
struct CountedInput {
    source: Box<dyn Read + Send>,
    taken: Arc<AtomicU64>,
}

impl Read for CountedInput {
    fn read(&mut self, buffer: &mut [u8]) -> std::io::Result<usize> {
        let count = self.source.read(buffer)?;
        self.taken.fetch_add(count as u64, Ordering::Relaxed);
        Ok(count)
    }
}

#[cfg(test)]
mod tests {
    use cobscope_decoder::capture::Batch;

    use super::*;

    #[test]
    fn a_file_that_shrinks_while_it_is_read_is_an_error() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.log");
        std::fs::write(&path, "(1.000000) can0 185#0102030405060708\n".repeat(30_000)).unwrap();
        let mut reader = open_capture(&path, &ReadOptions::default()).unwrap().reader;
        let mut batch = Batch::new();
        assert!(reader.read(&mut batch).unwrap());
        File::options().write(true).open(&path).unwrap().set_len(700_000).unwrap();
        let error = loop {
            match reader.read(&mut batch) {
                Ok(more) => assert!(more, "an early end is not the end of the capture"),
                Err(error) => break error.to_string(),
            }
        };
        let expected = "reading failed: file changed: 1,110,000 bytes are now 700,000";
        assert_eq!(error, expected);
    }
}
