//! Preview of a position ahead of the index: undecoded frames without numbers.
//!
//! This needs an uncompressed text capture, in which a frame starts after every line end.

use std::io::Read as _;
use std::sync::PoisonError;

use cobscope_decoder::capture::{Batch, CaptureReader};
use cobscope_decoder::event::Event;
use cobscope_decoder::frame::Frame;
use cobscope_decoder::replay::{EarlierPayloads, EventPosition, PlacedEvent, ReplayState};

use crate::timeline::shared::SharedResults;
use crate::timeline::{ReplayRow, SeekTarget};

/// Number of bytes searched for a line end.
const LONGEST_LINE: usize = 4 * 1024;

/// Usual length of a line, to estimate the start of the last frames.
const USUAL_LINE: u64 = 64;

/// Rows of frames near a position.
pub(super) fn rows_ahead(
    shared: &SharedResults,
    target: SeekTarget,
    count: usize,
    world: &ReplayState,
) -> Option<Vec<ReplayRow>> {
    let [lane] = shared.lanes.as_slice() else { return None };
    let (length, true) = lane.store.length() else { return None };
    let index = shared.index.read().unwrap_or_else(PoisonError::into_inner);
    let mut position = index.checkpoints().last()?.position.only_position()?;
    drop(index);
    if !position.is_text() {
        return None;
    }
    let last = length.saturating_sub(USUAL_LINE * count as u64);
    let offset = guess_offset(shared, target).map_or(last, |offset| offset.min(last));
    position.offset = offset + behind_line(shared, offset)?;
    let mut reader = CaptureReader::resume(lane.store.reader_at(position.offset), &position);
    let mut batch = Batch::new();
    let mut frames: Vec<Frame> = Vec::new();
    while frames.len() < count && reader.read(&mut batch).ok()? {
        frames.extend(batch.frames());
    }
    if matches!(target, SeekTarget::End) {
        frames.drain(..frames.len().saturating_sub(count));
    }
    let first = shared.progress.frames();
    (first..).zip(frames.iter().take(count)).map(|(number, frame)| frame_row(number, frame, world)).collect()
}

/// Estimated byte offset of a position, by the average of the indexed part.
fn guess_offset(shared: &SharedResults, target: SeekTarget) -> Option<u64> {
    let progress = &shared.progress;
    let share = match target {
        SeekTarget::End => return None,
        SeekTarget::Event(spot) => ratio_of(spot.frame, progress.frames())?,
        SeekTarget::Time(time) => {
            let (zero, last) = progress.time_range()?;
            ratio_of(time.since(zero).unsigned_abs(), last.since(zero).unsigned_abs())?
        }
    };
    #[expect(
        clippy::cast_precision_loss,
        clippy::cast_possible_truncation,
        clippy::cast_sign_loss,
        reason = "an estimate"
    )]
    let offset = (progress.bytes() as f64 * share) as u64;
    Some(offset)
}

#[expect(clippy::cast_precision_loss, reason = "an estimate")]
fn ratio_of(part: u64, whole: u64) -> Option<f64> {
    (whole > 0).then(|| part as f64 / whole as f64)
}

/// Number of bytes from an offset to the start of the next line.
fn behind_line(shared: &SharedResults, offset: u64) -> Option<u64> {
    let mut text = Vec::with_capacity(LONGEST_LINE);
    let reader = shared.lanes.first()?.store.reader_at(offset);
    reader.take(LONGEST_LINE as u64).read_to_end(&mut text).ok()?;
    let end = text.iter().position(|byte| *byte == b'\n')?;
    Some(end as u64 + 1)
}

fn frame_row(number: u64, frame: &Frame, world: &ReplayState) -> Option<ReplayRow> {
    let bus = world.buses().get(usize::from(frame.bus.0)).or_else(|| world.buses().first())?;
    // The frame number is not known yet.
    let frame = Frame { number: 0, ..*frame };
    let event = Event::undecoded(&frame);
    let spot = EventPosition::before_frame(number + 1);
    let earlier = EarlierPayloads::default();
    let placed = PlacedEvent { spot, event: &event, bus, frame: Some(&frame), is_news: true, earlier };
    Some(ReplayRow::new(&placed, true))
}
