//! The pass itself: a decoder, the rules and a part.

use std::io::{BufReader, Read};
use std::sync::Arc;

use super::error::ReadingError;
use super::part::{FrameDemand, ReadingPart};
use super::short_path::JudgedPart;
use crate::capture::{
    Batch, BatchItem, BusNames, CaptureError, CaptureReader, Notice, ReadOptions, decompress,
};
use crate::decoder::Decoder;
use crate::finding::CaptureFindings;
use crate::frame::{BusIndex, Frame, Timestamp};
use crate::rules::RuleSetup;
use crate::session::{Buses, SessionOptions};

/// Reads, decodes and checks one capture, or the frames of live buses.
///
/// Events and findings are passed to a [`ReadingPart`]; any `FnMut(&Event, &Bus)` implements it. A finding is
/// also an event: [`EventKind::FindingOpened`](crate::EventKind) follows the event that shows it. The
/// [`Summary`] at the end contains all findings, grouped.
///
/// ```
/// use cobscope_decoder::{Bus, Event, Reading};
///
/// let capture = &b"(1700000000.000000) can0 705#00\n(1700000000.500000) can0 705#7F\n"[..];
/// let mut kinds = Vec::new();
/// let mut reading = Reading::new(|event: &Event, _: &Bus| kinds.push(event.kind.name()));
/// reading.run(capture)?;
/// let summary = reading.finish();
/// assert_eq!((summary.frames(), summary.findings.reported_groups().count()), (2, 0));
/// drop(summary);
/// assert_eq!(kinds, ["boot-up", "nmt-state", "heartbeat"]);
/// # Ok::<(), cobscope_decoder::ReadingError>(())
/// ```
pub struct Reading<P> {
    decoder: Decoder,
    judged: JudgedPart<P>,
    /// Buses of frames that the caller pushes.
    names: BusNames,
    read: ReadOptions,
    first: Option<Frame>,
    is_closed: bool,
}

/// Results of a whole capture, or of all frames that were pushed.
pub struct Summary<P = ()> {
    /// Findings of all rules; empty without rules.
    pub findings: CaptureFindings,
    /// The part of the pass, after its end.
    pub part: P,
    /// State after the last frame.
    pub decoder: Decoder,
    /// The first frame; `None` without any.
    pub first: Option<Frame>,
}

impl<P: ReadingPart> Reading<P> {
    /// A reading with all rules and the profiles of this crate, without information about the buses.
    pub fn new(part: P) -> Self {
        Self::of_options(SessionOptions::default(), Some(Arc::default()), part)
    }

    /// A reading with options that were read before, such as device files; without `setup` it has no rules.
    pub fn of_options(session: SessionOptions, setup: Option<Arc<RuleSetup>>, part: P) -> Self {
        Self {
            decoder: Decoder::new(session),
            judged: JudgedPart::new(setup, part),
            names: BusNames::default(),
            read: ReadOptions::default(),
            first: None,
            is_closed: false,
        }
    }

    pub(super) fn with_read_options(self, read: ReadOptions) -> Self {
        Self { read, ..self }
    }

    /// Reads a capture of any format, plain or compressed, to its end, or until the part is done.
    ///
    /// # Errors
    /// If the capture cannot be read at all, has no frame, or is incomplete. Unreadable lines and records are
    /// not errors; they are `unreadable` events.
    pub fn run(&mut self, source: impl Read + Send) -> Result<(), ReadingError> {
        let source = decompress(BufReader::new(source)).map_err(CaptureError::from)?;
        let mut reader = CaptureReader::open(source, &self.read)?;
        let mut batch = Batch::new();
        let mut failure = None;
        while !self.is_done() {
            match reader.read(&mut batch) {
                Ok(true) => {}
                Ok(false) => break,
                Err(error) => {
                    failure = Some(error.to_string());
                    break;
                }
            }
            if !self.take(&batch, reader.buses()) {
                break;
            }
            failure = failure.or_else(|| batch.cut_off());
        }
        self.close(reader.buses());
        match failure {
            Some(reason) => Err(ReadingError::Incomplete(reason)),
            None if self.first.is_none() => Err(ReadingError::NoFrames),
            None => Ok(()),
        }
    }

    /// Starts a file of a capture that consists of several; see [`Decoder::begin_part`].
    pub fn begin_file(&mut self, file: &str) {
        self.decoder.begin_part(file);
    }

    /// Decodes the next frames and notices of a reader, whose buses have these names; `false` if the part ended the
    /// capture.
    pub fn take(&mut self, batch: &Batch, names: &BusNames) -> bool {
        self.first = self.first.or_else(|| batch.frames().first().copied());
        let demand = self.judged.part.demand();
        if batch.notices().is_empty() && demand < FrameDemand::Decoded {
            return self.take_frames(batch.frames(), names);
        }
        for item in batch.items() {
            match item {
                BatchItem::Frame(frame) => {
                    if !self.judged.frame(frame, names) {
                        return false;
                    }
                    self.decoder.push(frame, names, &mut self.judged);
                    let bus = self.decoder.buses().get(usize::from(frame.bus.0));
                    if let Some(bus) = bus.filter(|_| demand == FrameDemand::Decoded) {
                        self.judged.part.frame_decoded(frame, bus);
                    }
                }
                BatchItem::Notice(notice) => {
                    self.judged.notice(notice, names);
                    self.decoder.on_notice(notice, names, &mut self.judged);
                }
            }
        }
        true
    }

    fn take_frames(&mut self, frames: &[Frame], names: &BusNames) -> bool {
        let mut rest = frames;
        while !rest.is_empty() {
            let count = self.judged.frames(rest, names);
            let Some((next, after)) = rest.split_at_checked(count).filter(|_| count > 0) else {
                return false;
            };
            self.decoder.push_all(next, names, &mut self.judged);
            rest = after;
        }
        true
    }

    /// Index of a live bus for [`Frame::bus`], added if new; `None` above
    /// [`MAX_BUSES`](crate::capture::MAX_BUSES) buses.
    pub fn bus(&mut self, name: &str) -> Option<BusIndex> {
        self.names.index_of(name.as_bytes())
    }

    /// Names of the live buses, for a source that numbers its buses itself.
    pub fn set_buses(&mut self, names: BusNames) {
        self.names = names;
    }

    /// Decodes the next frame of a live bus. Frames of all buses must be in order of time; they are numbered
    /// here, from 1. Returns the number.
    pub fn push(&mut self, frame: &Frame) -> u64 {
        let frame = Frame { number: self.decoder.frame_count().saturating_add(1), ..*frame };
        self.first = self.first.or(Some(frame));
        self.judged.frame(&frame, &self.names);
        self.decoder.push(&frame, &self.names, &mut self.judged);
        frame.number
    }

    /// Handles a notice of a live source, such as a change of a link.
    pub fn notice(&mut self, notice: &Notice) {
        self.judged.notice(notice, &self.names);
        self.decoder.on_notice(notice, &self.names, &mut self.judged);
        self.judged.advance(self.decoder.buses());
    }

    /// Advances the time of live buses without a frame, so that deadlines expire: to be called several times
    /// per second with the clock of the frames.
    pub fn advance(&mut self, now: Timestamp) {
        self.decoder.advance_time(now, &mut self.judged);
        self.judged.advance(self.decoder.buses());
    }

    /// Ends the capture: closes open transfers and findings. Later calls have no effect.
    pub fn close(&mut self, names: &BusNames) {
        if !std::mem::replace(&mut self.is_closed, true) {
            self.decoder.finish_capture(names, &mut self.judged);
            self.judged.finish(self.decoder.buses());
        }
    }

    /// The results; ends the capture if it has not ended.
    pub fn finish(mut self) -> Summary<P> {
        let names = std::mem::take(&mut self.names);
        self.close(&names);
        let JudgedPart { findings, part, .. } = self.judged;
        Summary { findings, part, decoder: self.decoder, first: self.first }
    }

    /// The part of the pass.
    pub fn part(&self) -> &P {
        &self.judged.part
    }

    /// The part of the pass, to change it.
    pub fn part_mut(&mut self) -> &mut P {
        &mut self.judged.part
    }

    /// Names of the live buses, and the part.
    pub fn names_and_part(&mut self) -> (&BusNames, &mut P) {
        (&self.names, &mut self.judged.part)
    }

    /// The first frame; `None` before it.
    pub fn first(&self) -> Option<&Frame> {
        self.first.as_ref()
    }

    /// Whether the part needs no more events.
    pub fn is_done(&self) -> bool {
        self.judged.part.is_done()
    }

    /// The moment at which the part ended the capture, as text; `None` if it did not.
    pub fn end_moment(&self) -> Option<String> {
        self.judged.part.end_moment()
    }

    /// Names of the live buses.
    pub fn names(&self) -> &BusNames {
        &self.names
    }

    /// State after the last frame.
    pub fn decoder(&self) -> &Decoder {
        &self.decoder
    }
}

impl<P> Summary<P> {
    /// The same results with another part.
    pub fn map<Q>(self, other: impl FnOnce(P) -> Q) -> Summary<Q> {
        let Self { findings, part, decoder, first } = self;
        Summary { findings, part: other(part), decoder, first }
    }

    /// Buses in order of appearance, each with the state of its nodes and objects after the last frame.
    pub fn buses(&self) -> Buses<'_> {
        self.decoder.buses()
    }

    /// Number of frames decoded.
    pub fn frames(&self) -> u64 {
        self.decoder.frame_count()
    }

    /// Number of unreadable lines or records in the capture.
    pub fn unreadable(&self) -> u64 {
        self.decoder.unreadable_count()
    }

    /// Time of the first frame, if it has one.
    pub fn first_time(&self) -> Option<Timestamp> {
        self.first.and_then(|first| first.time)
    }

    /// Time of the last frame, if it has one.
    pub fn last_time(&self) -> Option<Timestamp> {
        self.decoder.last_time()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::event::{Event, EventKind};
    use crate::frame::CanId;
    use crate::reading::ReadingBuilder;
    use crate::session::Bus;
    use crate::wire::NodeId;

    const LOST: &[u8] =
        b"(1.0) can0 705#7F\n(1.1) can0 705#7F\n(1.2) can0 705#7F\n(3.0) can0 080#\n(4.0) can0 080#\n";

    /// Names of the kinds of all events.
    #[derive(Default)]
    struct KindNames(Vec<&'static str>);

    impl ReadingPart for KindNames {
        fn event(&mut self, event: &Event, _bus: &Bus) {
            self.0.push(event.kind.name());
        }
    }

    fn kinds(capture: &[u8]) -> (Result<(), ReadingError>, Summary<KindNames>) {
        let mut reading = Reading::new(KindNames::default());
        (reading.run(capture), reading.finish())
    }

    #[test]
    fn frames_pushed_by_hand_are_judged_as_those_of_a_capture() {
        let (_, of_capture) = kinds(LOST);
        let mut reading = Reading::new(KindNames::default());
        let bus = reading.bus("can0").unwrap();
        for (time, id, data) in [
            (10, 0x705, &[0x7F][..]),
            (11, 0x705, &[0x7F]),
            (12, 0x705, &[0x7F]),
            (30, 0x80, &[]),
            (40, 0x80, &[]),
        ] {
            let time = Some(Timestamp(time * 100_000_000));
            let frame = Frame { time, bus, ..Frame::data_frame(CanId::from_standard(id), data) };
            reading.push(&frame);
        }
        let summary = reading.finish();
        assert_eq!(summary.part.0, of_capture.part.0);
        assert_eq!((summary.frames(), summary.buses().len()), (5, 1));
        assert_eq!(summary.findings.groups.len(), of_capture.findings.groups.len());
    }

    #[test]
    fn time_that_passes_without_frames_expires_deadlines() {
        let mut is_timeout = false;
        let note = |event: &Event, _: &Bus| is_timeout |= matches!(event.kind, EventKind::SdoTransfer(_));
        let mut reading = Reading::builder().without_rules().build(note).unwrap();
        let bus = reading.bus("can0").unwrap();
        let boot =
            Frame { time: Some(Timestamp(0)), bus, ..Frame::data_frame(CanId::from_standard(0x705), &[0]) };
        let request = Frame {
            time: Some(Timestamp(1)),
            ..Frame::data_frame(CanId::from_standard(0x605), &[0x40, 0, 0x10, 0, 0, 0, 0, 0])
        };
        reading.push(&boot);
        reading.push(&request);
        let later = Frame { time: Some(Timestamp(2_000_000_000)), bus, ..boot };
        reading.advance(Timestamp(100_000_000));
        reading.push(&later);
        drop(reading);
        assert!(is_timeout);
    }

    #[test]
    fn options_that_are_wrong_are_refused() {
        let wrong = |builder: ReadingBuilder| {
            builder.build(()).err().map(|error| error.to_string()).unwrap_or_default()
        };
        assert!(wrong(Reading::builder().bus_file("nodes = 1")).starts_with("bus file: 1:1: "));
        let unknown = Reading::builder().device(NodeId::Canopen(2), "rexroth-sydfek");
        assert_eq!(wrong(unknown), "unknown profile 'rexroth-sydfek'; did you mean 'rexroth-sydfec'?");
        assert!(wrong(Reading::builder().profile("id = 1")).starts_with("profile 1:1:6: "));
        assert!(wrong(Reading::builder().database(*b"\0")).starts_with("database: "));
    }

    #[test]
    fn a_capture_that_is_not_whole_is_an_error_with_all_before() {
        let mut whole = Vec::from(0xA1B2_C3D4_u32.to_le_bytes());
        whole.extend([2, 0, 4, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0xFF, 0xFF, 0, 0, 227, 0, 0, 0]);
        assert!(matches!(kinds(&whole).0, Err(ReadingError::NoFrames)));
        whole.extend([0; 8]);
        whole.extend([16, 0, 0, 0, 16, 0, 0, 0, 0, 0, 7, 5, 1, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0]);
        let (result, summary) = kinds(&whole);
        assert!(result.is_ok());
        assert_eq!(summary.frames(), 1);
        whole.extend([0; 12]);
        let (result, summary) = kinds(&whole);
        assert!(matches!(result, Err(ReadingError::Incomplete(_))));
        assert_eq!(summary.frames(), 1);
        assert!(matches!(kinds(b"no capture").0, Err(ReadingError::Capture(_))));
    }
}
