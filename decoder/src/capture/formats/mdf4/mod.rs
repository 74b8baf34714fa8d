//! MDF4: captures of loggers in the format of ASAM, with frames as in the ASAM bus logging standard.
//!
//! ```text
//! identification, 64 bytes         header            groups, channels and data, in any order
//!  0 "MDF     " or "UnFinMF "       start, link to the first group ─▶ …
//! 28 version (2)  60 unfinished (2)
//! ```
//! Layouts: [`block`], [`group`] and [`stream`]; conversion: [`field`] and [`frame`].
//!
//! Links may lead anywhere, so the whole capture is read into memory first; all positions share this memory.
//! Frames of several groups are merged by time. Ties are resolved by the order of the groups, and a frame
//! never precedes an earlier one of its group.

mod block;
mod field;
mod frame;
mod group;
mod recording;
mod records;
mod source;
mod stream;
mod transposed;

use std::sync::Arc;

use block::{TITLE, is_cut_off};
use frame::ChannelFrame;
use recording::{Mdf4Capture, UNFINISHED};
use source::GroupSource;

use crate::capture::local_time::{LocalClock, TimeOrigin};
use crate::capture::{
    Batch, BusNames, CaptureError, CaptureFormat, CapturePlace, FormatParser, MAX_BUSES, Notice, ReadOptions,
};
use crate::frame::{BusIndex, Frame, Timestamp};

const FINISHED: &[u8] = b"MDF     ";

/// Maximum size of a capture in bytes.
const LARGEST_CAPTURE: usize = 1024 * 1024 * 1024;

pub(super) const FORMAT: CaptureFormat = CaptureFormat {
    name: "mdf4",
    title: TITLE,
    is_text: false,
    is_packed: true,
    detect: |head| head.starts_with(FINISHED) || head.starts_with(UNFINISHED),
    parser: |options| Box::new(Mdf4Parser::new(options)),
};

/// Parser of MDF4.
#[derive(Clone, Default)]
struct Mdf4Parser {
    /// All bytes received so far.
    file: Arc<Vec<u8>>,
    state: Mdf4State,
    delivery: FrameDelivery,
}

#[derive(Clone, Default)]
enum Mdf4State {
    #[default]
    Collecting,
    Reading(Mdf4Reading),
    Ended,
}

#[derive(Clone)]
struct Mdf4Reading {
    start: i64,
    origin: TimeOrigin,
    sources: Vec<GroupSource>,
    /// Notices emitted before the first frame, in reverse order.
    notices: Vec<Notice>,
    others: u64,
    names: Vec<Vec<u8>>,
}

/// State of the frames emitted so far.
#[derive(Clone, Default)]
struct FrameDelivery {
    buses: BusNames,
    clock: LocalClock,
    frames: u64,
    /// Channel of the last frame, and its bus.
    last: Option<(Option<u64>, BusIndex)>,
}

impl Mdf4Parser {
    fn new(options: &ReadOptions) -> Self {
        let clock = LocalClock::new(&options.time_zones);
        Self { delivery: FrameDelivery { clock, ..FrameDelivery::default() }, ..Self::default() }
    }

    fn collect_input(&mut self, input: &[u8]) -> Result<usize, CaptureError> {
        if self.file.len().saturating_add(input.len()) > LARGEST_CAPTURE {
            return Err(CaptureError::Header {
                format: TITLE,
                offset: LARGEST_CAPTURE as u64,
                found: "more than 1 GiB".into(),
                expected: "at most 1 GiB: split the capture, or convert it to BLF, which is not read into memory",
            });
        }
        Arc::make_mut(&mut self.file).extend_from_slice(input);
        Ok(input.len())
    }
}

impl Mdf4Reading {
    fn open(file: &[u8]) -> Result<Self, CaptureError> {
        let Mdf4Capture { start, is_local, sources, damages, others, names } = Mdf4Capture::open(file)?;
        let notice = |(at, reason)| {
            let place = CapturePlace::Offset(at);
            if is_cut_off(file, at) {
                Notice::CutOff { place, reason }
            } else {
                Notice::Unreadable { place, reason }
            }
        };
        let mut notices: Vec<_> = damages.into_iter().map(notice).collect();
        notices.reverse();
        let origin = if is_local { TimeOrigin::LocalStart(start) } else { TimeOrigin::Universal };
        Ok(Self { start, origin, sources, notices, others, names })
    }

    /// Emits frames and notices until the batch is full; `false` at the end.
    fn read(&mut self, file: &[u8], delivery: &mut FrameDelivery, batch: &mut Batch) -> bool {
        while !batch.is_full() {
            if let Some(notice) = self.notices.pop() {
                batch.add_notice(notice);
                continue;
            }
            if let Some(source) = self.sources.iter_mut().find(|source| source.is_behind()) {
                source.read_step(file, batch);
                continue;
            }
            // Ties: the first source.
            let due = self.sources.iter_mut().filter_map(|source| Some((source.due_time()?, source)));
            let next = due.min_by_key(|(due, _)| *due).and_then(|(_, source)| source.take_frame());
            let Some((time, found)) = next else { return false };
            let time = time.map(|time| Timestamp(self.start).plus(time));
            delivery.deliver_frame(time, self.origin, found, batch);
        }
        true
    }

    /// Reports the skipped records once.
    fn report_skipped(&self, batch: &mut Batch) {
        let others =
            self.sources.iter().map(GroupSource::skipped_records).fold(self.others, u64::saturating_add);
        let names =
            self.names.iter().map(|name| String::from_utf8_lossy(name)).collect::<Vec<_>>().join(", ");
        if self.sources.is_empty() {
            let text = format!(
                "no group contains CAN frames in the layout of the bus logging standard; found {names}"
            );
            batch.add_notice(Notice::Assumption(text.trim_end_matches("; found ").into()));
        } else if others > 0 {
            let text = format!("{others} records of groups without CAN frames skipped ({names})");
            batch.add_notice(Notice::Assumption(text));
        }
    }
}

impl FrameDelivery {
    fn deliver_frame(
        &mut self,
        time: Option<Timestamp>,
        origin: TimeOrigin,
        found: ChannelFrame,
        batch: &mut Batch,
    ) {
        let name = || found.channel.map_or_else(|| "can".into(), |channel| channel.to_string());
        let known = self.last.filter(|(channel, _)| *channel == found.channel).map(|(_, bus)| bus);
        let Some(bus) = known.or_else(|| self.buses.index_of(name().as_bytes())) else {
            let name = name();
            let reason = format!("channel {name}: more than {MAX_BUSES} channels");
            batch.add_notice(Notice::Unreadable { place: CapturePlace::Offset(0), reason });
            return;
        };
        self.last = Some((found.channel, bus));
        self.frames += 1;
        let name = self.buses.name_of(bus);
        let time = time.map(|time| Timestamp(self.clock.convert_time(time.0, origin, name, batch)));
        batch.push(Frame { number: self.frames, time, bus, ..found.frame });
    }
}

impl FormatParser for Mdf4Parser {
    fn parse(&mut self, input: &[u8], at_end: bool, batch: &mut Batch) -> Result<usize, CaptureError> {
        if !input.is_empty() {
            return self.collect_input(input);
        }
        if at_end && matches!(self.state, Mdf4State::Collecting) && !self.file.is_empty() {
            self.state = Mdf4State::Reading(Mdf4Reading::open(&self.file)?);
        }
        if let Mdf4State::Reading(reading) = &mut self.state
            && !reading.read(&self.file, &mut self.delivery, batch)
        {
            reading.report_skipped(batch);
            self.state = Mdf4State::Ended;
        }
        Ok(0)
    }

    fn buses(&self) -> &BusNames {
        &self.delivery.buses
    }

    fn clone_box(&self) -> Box<dyn FormatParser> {
        Box::new(self.clone())
    }
}

#[cfg(test)]
mod tests;
