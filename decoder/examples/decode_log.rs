//! Decodes a candump line by line and prints what the node did.
//!
//! `cargo run -p cobscope-decoder --example decode_log`

use cobscope_decoder::capture::{Batch, ReadOptions, Reader};
use cobscope_decoder::decoder::Decoder;
use cobscope_decoder::event::Event;
use cobscope_decoder::session::{Bus, SessionOptions};

const CAPTURE: &[u8] = b"(1700000000.000000) can0 705#00\n(1700000000.500000) can0 705#7F\n";

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let mut reader = Reader::open(CAPTURE, &ReadOptions::default())?;
    let mut decoder = Decoder::new(SessionOptions::default());
    let mut batch = Batch::new();
    let mut kinds = Vec::new();
    let mut see = |event: &Event, _: &Bus| kinds.push(event.kind.name());
    while reader.read(&mut batch)? {
        for frame in batch.frames() {
            decoder.push(frame, reader.buses(), &mut see);
        }
    }
    decoder.finish(reader.buses(), &mut see);
    assert!(kinds.starts_with(&["boot-up", "nmt-state"]));
    Ok(())
}
