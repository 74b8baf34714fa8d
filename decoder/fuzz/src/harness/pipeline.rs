//! A capture through all stages.

use std::io::Read;

use cobscope_decoder::capture::{Batch, BatchItem, CaptureReader, ReadOptions, decompress};
use cobscope_decoder::decoder::Decoder;
use cobscope_decoder::session::SessionOptions;

use super::observe::Checker;

/// Maximum number of decompressed bytes: a few bytes of gzip can expand to gigabytes.
const LONGEST: u64 = 4 << 20;

/// Fuzzes any bytes as a capture: decompression, detection, reading, decoding, printing.
pub fn any(data: &[u8]) {
    let Ok(source) = decompress(data) else { return };
    let Ok(mut reader) = CaptureReader::open(source.take(LONGEST), &ReadOptions::default()) else { return };
    let mut checker = Checker::new();
    let _ = run(&mut reader, &mut Decoder::new(SessionOptions::default()), &mut checker);
    // Six output forms of an event are far below this; lines that grow with the history exceed it.
    assert!(checker.written <= 64 * 1024 * (checker.events + 1));
}

/// Reads and decodes to the end; returns the error that ended it early, if any.
pub fn run(
    reader: &mut CaptureReader<impl Read>,
    decoder: &mut Decoder,
    checker: &mut Checker,
) -> Option<String> {
    let mut batch = Batch::new();
    let mut error = None;
    let mut last = 0;
    loop {
        match reader.read(&mut batch) {
            Ok(true) => {}
            Ok(false) => break,
            Err(cause) => {
                error = Some(cause.to_string());
                break;
            }
        }
        for item in batch.items() {
            match item {
                BatchItem::Frame(frame) => {
                    assert_eq!(frame.number, last + 1);
                    last = frame.number;
                    checker.last_frame = last;
                    decoder.push(frame, reader.buses(), checker);
                }
                BatchItem::Notice(notice) => decoder.on_notice(notice, reader.buses(), checker),
            }
        }
    }
    decoder.finish_capture(reader.buses(), checker);
    error
}
