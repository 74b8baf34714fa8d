//! Reads a capture in its own thread, ahead of the decoder and in the same order.
//!
//! ```text
//! reader ─ thread ──▶ filled blocks ──▶ decoder
//!                ◀── empty blocks ──
//! ```

use std::io::Read;
use std::sync::mpsc::{Receiver, Sender, SyncSender, channel, sync_channel};
use std::thread::JoinHandle;

use cobscope_decoder::capture::{Batch, BusNames, CaptureError, CaptureFormat, CaptureReader};

/// Batches per block: some thousand frames, so that passing a block on is cheap.
const BATCHES: usize = 8;

/// Number of blocks: one at each end, two between.
const BLOCKS: usize = 4;

/// Frames of a capture in order.
pub enum FramesAhead {
    /// Read on request.
    Here(CaptureReader<Box<dyn Read + Send>>),
    /// Read ahead in another thread.
    Ahead(ReadAhead),
}

impl FramesAhead {
    /// Replaces the content of `batch` by the next frames and notices; `false` at the end.
    ///
    /// # Errors
    /// As [`CaptureReader::read_input`].
    pub fn read(&mut self, batch: &mut Batch) -> Result<bool, CaptureError> {
        match self {
            Self::Here(reader) => reader.read(batch),
            Self::Ahead(ahead) => ahead.read(batch),
        }
    }

    /// Buses seen so far; when reading ahead, possibly some that appear later.
    pub fn buses(&self) -> &BusNames {
        match self {
            Self::Here(reader) => reader.buses(),
            Self::Ahead(ahead) => &ahead.buses,
        }
    }

    /// Format detected at the start.
    pub fn format(&self) -> &'static CaptureFormat {
        match self {
            Self::Here(reader) => reader.format(),
            Self::Ahead(ahead) => ahead.format,
        }
    }
}

/// Batches passed on together.
struct BatchBlock {
    batches: Vec<Batch>,
    filled: usize,
    /// All buses, if there are more than in the previous block.
    buses: Option<BusNames>,
    /// End of reading, after the last batch.
    end: Option<Result<(), CaptureError>>,
}

/// A capture that is read ahead.
pub struct ReadAhead {
    /// Receiver of filled blocks and sender of empty ones; dropping them ends the thread.
    blocks: Option<(Receiver<BatchBlock>, Sender<BatchBlock>)>,
    thread: Option<JoinHandle<()>>,
    block: Option<BatchBlock>,
    next: usize,
    buses: BusNames,
    format: &'static CaptureFormat,
}

impl ReadAhead {
    /// Continues reading in another thread.
    pub fn new(reader: CaptureReader<Box<dyn Read + Send>>) -> Self {
        let (empty, empties) = channel();
        let (full, filled) = sync_channel(BLOCKS);
        for _ in 0..BLOCKS {
            let batches = (0..BATCHES).map(|_| Batch::new()).collect();
            // The thread does not run yet, but its end of the channel exists.
            let _ = empty.send(BatchBlock { batches, filled: 0, buses: None, end: None });
        }
        let format = reader.format();
        let thread = std::thread::spawn(move || read_all(reader, &empties, &full));
        Self {
            blocks: Some((filled, empty)),
            thread: Some(thread),
            block: None,
            next: 0,
            buses: BusNames::default(),
            format,
        }
    }

    fn read(&mut self, batch: &mut Batch) -> Result<bool, CaptureError> {
        loop {
            if let Some(block) = &mut self.block {
                if let Some(next) = block.batches.get_mut(self.next).filter(|_| self.next < block.filled) {
                    std::mem::swap(batch, next);
                    self.next += 1;
                    return Ok(true);
                }
                if let Some(end) = &mut block.end {
                    batch.clear();
                    return std::mem::replace(end, Ok(())).map(|()| false);
                }
            }
            self.next_block();
        }
    }

    fn next_block(&mut self) {
        let emptied = self.block.take();
        let received = self.blocks.as_ref().and_then(|(filled, empty)| {
            if let Some(block) = emptied {
                // At the end of the capture the thread takes no more blocks.
                let _ = empty.send(block);
            }
            filled.recv().ok()
        });
        // The last block contains the end, unless the thread panicked.
        let mut block = received.unwrap_or_else(|| self.join_batches());
        if let Some(buses) = block.buses.take() {
            self.buses = buses;
        }
        self.next = 0;
        self.block = Some(block);
    }

    fn join_batches(&mut self) -> BatchBlock {
        if let Some(Err(panic)) = self.thread.take().map(JoinHandle::join) {
            std::panic::resume_unwind(panic);
        }
        BatchBlock { batches: Vec::new(), filled: 0, buses: None, end: Some(Ok(())) }
    }
}

impl Drop for ReadAhead {
    fn drop(&mut self) {
        self.blocks = None;
        if let Some(thread) = self.thread.take() {
            let _ = thread.join();
        }
    }
}

fn read_all(
    mut reader: CaptureReader<Box<dyn Read + Send>>,
    empties: &Receiver<BatchBlock>,
    full: &SyncSender<BatchBlock>,
) {
    let mut known = 0;
    while let Ok(mut block) = empties.recv() {
        block.filled = 0;
        for batch in &mut block.batches {
            match reader.read(batch) {
                Ok(true) => block.filled += 1,
                Ok(false) => block.end = Some(Ok(())),
                Err(error) => block.end = Some(Err(error)),
            }
            if block.end.is_some() {
                break;
            }
        }
        let names = reader.buses();
        if names.names().len() > known {
            known = names.names().len();
            block.buses = Some(names.clone());
        }
        let is_end = block.end.is_some();
        if full.send(block).is_err() || is_end {
            return;
        }
    }
}

#[cfg(test)]
mod tests {
    use std::fmt::Write as _;
    use std::io::Cursor;

    use cobscope_decoder::capture::ReadOptions;

    use super::*;

    fn reader(bytes: Vec<u8>) -> CaptureReader<Box<dyn Read + Send>> {
        let source: Box<dyn Read + Send> = Box::new(Cursor::new(bytes));
        CaptureReader::open(source, &ReadOptions::default()).unwrap()
    }

    /// All frames, the end and the buses.
    fn all(mut frames: FramesAhead) -> (Vec<String>, String, Vec<String>) {
        let (mut batch, mut items) = (Batch::new(), Vec::new());
        let end = loop {
            match frames.read(&mut batch) {
                Ok(true) => items.extend(batch.items().map(|item| format!("{item:?}"))),
                Ok(false) => break "end".to_owned(),
                Err(error) => break error.to_string(),
            }
        };
        assert!(matches!(frames.read(&mut batch), Ok(false)) || end != "end");
        (items, end, frames.buses().names().to_vec())
    }

    fn log() -> Vec<u8> {
        let mut text = String::new();
        for number in 0..20_000 {
            let bus = if number < 15_000 { "can0" } else { "can1" };
            writeln!(text, "({number}.5) {bus} 185#{number:08X}").unwrap();
            if number % 777 == 0 {
                text.push_str("no frame\n");
            }
        }
        text.into_bytes()
    }

    #[test]
    fn ahead_or_not_the_same_comes() {
        let here = all(FramesAhead::Here(reader(log())));
        assert_eq!((here.0.len(), here.2.len()), (20_000 + 26, 2));
        assert_eq!(all(FramesAhead::Ahead(ReadAhead::new(reader(log())))), here);
    }

    #[test]
    fn a_failure_comes_behind_what_was_read() {
        struct Failing(Cursor<Vec<u8>>);
        impl Read for Failing {
            fn read(&mut self, buffer: &mut [u8]) -> std::io::Result<usize> {
                match self.0.read(buffer)? {
                    0 => Err(std::io::Error::other("the disk is gone")),
                    count => Ok(count),
                }
            }
        }
        let open = || {
            let source: Box<dyn Read + Send> = Box::new(Failing(Cursor::new(log())));
            CaptureReader::open(source, &ReadOptions::default()).unwrap()
        };
        let (items, end, _) = all(FramesAhead::Ahead(ReadAhead::new(open())));
        assert_eq!((items.len(), end.as_str()), (20_026, "reading failed: the disk is gone"));
        assert_eq!(all(FramesAhead::Here(open())).0, items);
    }

    #[test]
    fn who_has_enough_ends_it() {
        let mut frames = FramesAhead::Ahead(ReadAhead::new(reader(log())));
        let mut batch = Batch::new();
        assert!(frames.read(&mut batch).unwrap());
        // The thread waits for an empty block until then; the test would hang if it did not end.
        drop(frames);
    }
}
