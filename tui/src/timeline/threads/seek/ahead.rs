//! Frames of a place the index has not reached: as they are, without numbers and without what they mean.
//!
//! Only a text capture read in place can be entered anywhere: its lines tell where the next frame begins.

use std::io::Read as _;
use std::sync::PoisonError;

use cobscope_decoder::capture::{Batch, Reader};
use cobscope_decoder::event::Event;
use cobscope_decoder::frame::Frame;
use cobscope_decoder::replay::{Spot, Told, World};

use crate::timeline::shared::Shared;
use crate::timeline::{Row, Target};

/// Bytes in which the end of a line is looked for.
const LONGEST_LINE: usize = 4 * 1024;

/// Bytes of a line as most captures have them: how far before the end its last frames begin.
const USUAL_LINE: u64 = 64;

/// Rows of frames about at a place.
pub(super) fn rows(shared: &Shared, target: Target, count: usize, world: &World) -> Option<Vec<Row>> {
    let [lane] = shared.lanes.as_slice() else { return None };
    let (length, true) = lane.store.length() else { return None };
    let index = shared.index.read().unwrap_or_else(PoisonError::into_inner);
    let mut position = index.marks().last()?.position.alone()?;
    drop(index);
    if !position.is_text() {
        return None;
    }
    let last = length.saturating_sub(USUAL_LINE * count as u64);
    let offset = guess(shared, target).map_or(last, |offset| offset.min(last));
    position.offset = offset + behind_line(shared, offset)?;
    let mut reader = Reader::resume(lane.store.reader(position.offset), &position);
    let mut batch = Batch::new();
    let mut frames: Vec<Frame> = Vec::new();
    while frames.len() < count && reader.read(&mut batch).ok()? {
        frames.extend(batch.frames());
    }
    if matches!(target, Target::End) {
        frames.drain(..frames.len().saturating_sub(count));
    }
    let first = shared.progress.frames();
    (first..).zip(frames.iter().take(count)).map(|(number, frame)| row(number, frame, world)).collect()
}

/// About at which byte a place is, by what the part that was read is like.
fn guess(shared: &Shared, target: Target) -> Option<u64> {
    let progress = &shared.progress;
    let share = match target {
        Target::End => return None,
        Target::Spot(spot) => ratio(spot.frame, progress.frames())?,
        Target::Time(time) => {
            let (zero, last) = progress.times()?;
            ratio(time.since(zero).unsigned_abs(), last.since(zero).unsigned_abs())?
        }
    };
    #[expect(
        clippy::cast_precision_loss,
        clippy::cast_possible_truncation,
        clippy::cast_sign_loss,
        reason = "a guess"
    )]
    let offset = (progress.bytes() as f64 * share) as u64;
    Some(offset)
}

#[expect(clippy::cast_precision_loss, reason = "a guess")]
fn ratio(part: u64, whole: u64) -> Option<f64> {
    (whole > 0).then(|| part as f64 / whole as f64)
}

/// Bytes from a place to behind the end of its line.
fn behind_line(shared: &Shared, offset: u64) -> Option<u64> {
    let mut text = Vec::with_capacity(LONGEST_LINE);
    let reader = shared.lanes.first()?.store.reader(offset);
    reader.take(LONGEST_LINE as u64).read_to_end(&mut text).ok()?;
    let end = text.iter().position(|byte| *byte == b'\n')?;
    Some(end as u64 + 1)
}

fn row(number: u64, frame: &Frame, world: &World) -> Option<Row> {
    let bus = world.buses().get(usize::from(frame.bus.0)).or_else(|| world.buses().first())?;
    // Nobody knows its number yet.
    let frame = Frame { number: 0, ..*frame };
    let event = Event::undecoded(&frame);
    let spot = Spot::before(number + 1);
    Some(Row::new(&Told { spot, event: &event, bus, frame: Some(&frame), is_news: true }))
}
