//! Decodes and checks frames as they are received: here of a node whose heartbeat stops after one
//! second.
//!
//! `cargo run -p cobscope-decoder --example live_frames`

use std::error::Error;
use std::io::{Write as _, stdout};

use cobscope_decoder::{Bus, CanId, Event, EventKind, Frame, Node, Reading, Timestamp};

const MILLISECOND: i64 = 1_000_000;

fn main() -> Result<(), Box<dyn Error>> {
    let mut lines = Vec::new();
    let add_line = |event: &Event, bus: &Bus| {
        let node = event.node.and_then(|node| bus.node(node)).and_then(Node::name).unwrap_or("-");
        let text = match &event.kind {
            EventKind::FindingOpened(finding) => &finding.text,
            kind => kind.name(),
        };
        lines.push(format!("{}  {node}  {text}", event.time.unwrap_or_default()));
    };
    let mut reading = Reading::builder().bus_file("[node.5]\nname = \"boom\"\n").build(add_line)?;
    let can0 = reading.bus("can0").ok_or("too many buses")?;
    for step in 0..40 {
        let now = Timestamp(step * 100 * MILLISECOND);
        // SYNC of another node, which continues.
        let sync =
            Frame { bus: can0, time: Some(now), ..Frame::data_frame(CanId::from_standard(0x080), &[]) };
        reading.push(&sync);
        if step <= 10 {
            let heartbeat =
                Frame { id: CanId::from_standard(0x705), time: Some(now.plus(MILLISECOND)), ..sync };
            reading.push(&Frame { length: 1, bytes: [5; 64], ..heartbeat });
        }
        // On a quiet bus, deadlines expire only by the clock.
        reading.advance(now.plus(50 * MILLISECOND));
    }
    let summary = reading.finish();
    let (frames, findings) = (summary.frames(), summary.findings.groups.len());
    drop(summary);
    lines.push(format!("{frames} frames, {findings} findings\n"));
    Ok(stdout().write_all(lines.join("\n").as_bytes())?)
}
