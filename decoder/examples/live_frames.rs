//! Decodes and checks frames as they are received: here of a node whose heartbeat stops after one
//! second.
//!
//! `cargo run -p cobscope-decoder --example live_frames`

use std::error::Error;
use std::io::{Write as _, stdout};

use cobscope_decoder::{Bus, CanId, Event, EventKind, Frame, Node, Pipeline, Timestamp};

const MILLISECOND: i64 = 1_000_000;

fn main() -> Result<(), Box<dyn Error>> {
    let mut pipeline = Pipeline::builder().bus_file("[node.5]\nname = \"boom\"\n").build()?;
    let can0 = pipeline.bus("can0").ok_or("too many buses")?;
    let mut lines = Vec::new();
    let mut observer = |event: &Event, bus: &Bus| {
        let node = event.node.and_then(|node| bus.node(node)).and_then(Node::name).unwrap_or("-");
        let text = match &event.kind {
            EventKind::FindingOpened(finding) => &finding.text,
            kind => kind.name(),
        };
        lines.push(format!("{}  {node}  {text}", event.time.unwrap_or_default()));
    };
    for step in 0..40 {
        let now = Timestamp(step * 100 * MILLISECOND);
        // SYNC of another node, which continues.
        let sync = Frame { bus: can0, time: Some(now), ..Frame::data_frame(CanId::standard(0x080), &[]) };
        pipeline.push(&sync, &mut observer);
        if step <= 10 {
            let heartbeat = Frame { id: CanId::standard(0x705), time: Some(now.plus(MILLISECOND)), ..sync };
            pipeline.push(&Frame { length: 1, bytes: [5; 64], ..heartbeat }, &mut observer);
        }
        // On a quiet bus, deadlines expire only by the clock.
        pipeline.advance(now.plus(50 * MILLISECOND), &mut observer);
    }
    let summary = pipeline.finish(&mut observer);
    lines.push(format!("{} frames, {} findings\n", summary.frames, summary.findings.groups.len()));
    Ok(stdout().write_all(lines.join("\n").as_bytes())?)
}
