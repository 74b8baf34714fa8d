//! Decodes a capture, or single frames, to events and findings: all stages in one type.

use std::io::{BufReader, Read};
use std::sync::Arc;

use crate::bus_file::BusFile;
use crate::capture::{Batch, BusNames, CaptureError, Item, Notice, ReadOptions, Reader, decompress};
use crate::decoder::Decoder;
use crate::finding::Findings;
use crate::frame::{BusIndex, Frame, Timestamp};
use crate::profile::dbc::{self, Database, Problem};
use crate::profile::{Catalogue, ProfileError, TextError};
use crate::rules::{Engine, Judge, Setup};
use crate::session::{AssignedBy, Assignment, Bus, Observer, ProtocolChoice, SessionOptions};
use crate::wire::NodeId;

/// Reads, decodes and checks one capture, or the frames of live buses.
///
/// Events and findings are passed to an [`Observer`]; any `FnMut(&Event, &Bus)` implements it. A finding is
/// also an event: [`EventKind::FindingOpened`](crate::EventKind) follows the event that shows it. The
/// [`Summary`] at the end contains all findings, grouped.
///
/// ```
/// use cobscope_decoder::{Bus, Event, Pipeline};
///
/// let capture = &b"(1700000000.000000) can0 705#00\n(1700000000.500000) can0 705#7F\n"[..];
/// let mut kinds = Vec::new();
/// let summary = Pipeline::new().read(capture, &mut |event: &Event, _: &Bus| kinds.push(event.kind.name()))?;
/// assert_eq!(kinds, ["boot-up", "nmt-state", "heartbeat"]);
/// assert_eq!((summary.frames, summary.findings.counting().count()), (2, 0));
/// # Ok::<(), cobscope_decoder::PipelineError>(())
/// ```
pub struct Pipeline {
    decoder: Decoder,
    engine: Option<Engine>,
    names: BusNames,
    read: ReadOptions,
}

/// Results of a whole capture, or of all frames that were pushed.
#[derive(Debug)]
#[non_exhaustive]
pub struct Summary {
    /// Findings of all rules; empty without rules.
    pub findings: Findings,
    /// Frames decoded.
    pub frames: u64,
    /// Number of unreadable lines or records in the capture.
    pub unreadable: u64,
    /// Buses in order of appearance, each with the state of its nodes and objects after the last frame.
    pub buses: Vec<Bus>,
}

/// Error of building a pipeline or of reading a capture.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum PipelineError {
    /// The bus file is invalid.
    #[error("bus file: {0}")]
    BusFile(TextError),
    /// A profile is invalid or unknown.
    #[error(transparent)]
    Profile(#[from] ProfileError),
    /// The database has an unknown format.
    #[error("database: {0}")]
    Database(Problem),
    /// The capture cannot be read at all.
    #[error(transparent)]
    Capture(#[from] CaptureError),
    /// The capture contains no frame.
    #[error("the capture contains no frame")]
    NoFrames,
    /// The capture ends inside a record, or its source cannot be read further. All frames before that are
    /// decoded and checked.
    #[error("the capture is incomplete: {reason}")]
    Incomplete {
        /// Place and cause.
        reason: String,
        /// Results of the frames before the error.
        summary: Box<Summary>,
    },
}

impl Default for Pipeline {
    fn default() -> Self {
        Self::new()
    }
}

impl Pipeline {
    /// A pipeline with all rules and the profiles of this crate, without information about the buses.
    pub fn new() -> Self {
        Self::with(SessionOptions::default(), Some(Setup::default()), ReadOptions::default())
    }

    /// Options of a pipeline, to be completed by [`PipelineBuilder::build`].
    pub fn builder() -> PipelineBuilder {
        PipelineBuilder::default()
    }

    fn with(session: SessionOptions, setup: Option<Setup>, read: ReadOptions) -> Self {
        Self { read, ..Self::of_options(session, setup.map(Arc::new)) }
    }

    /// A pipeline with options that were read before, such as device files; without `setup` it has no rules.
    pub fn of_options(session: SessionOptions, setup: Option<Arc<Setup>>) -> Self {
        Self {
            decoder: Decoder::new(session),
            engine: setup.map(Engine::new),
            names: BusNames::default(),
            read: ReadOptions::default(),
        }
    }

    /// Reads a capture of any format, plain or compressed, to its end.
    ///
    /// # Errors
    /// If the capture cannot be read at all, has no frame, or is incomplete. Unreadable lines and records are
    /// not errors; they are `unreadable` events.
    pub fn read(
        mut self,
        source: impl Read + Send,
        observer: &mut dyn Observer,
    ) -> Result<Summary, PipelineError> {
        let source = decompress(BufReader::new(source)).map_err(CaptureError::from)?;
        let mut reader = Reader::open(source, &self.read)?;
        let mut batch = Batch::new();
        let mut failure = None;
        loop {
            match reader.read(&mut batch) {
                Ok(true) => {}
                Ok(false) => break,
                Err(error) => {
                    failure = Some(error.to_string());
                    break;
                }
            }
            self.take(&batch, reader.buses(), observer);
            let cut_off = |(_, notice): &&(usize, Notice)| matches!(notice, Notice::CutOff { .. });
            failure = failure
                .or_else(|| batch.notices().iter().find(cut_off).map(|(_, notice)| notice.to_string()));
        }
        self.names = reader.buses().clone();
        let summary = self.finish(observer);
        match failure {
            Some(reason) => Err(PipelineError::Incomplete { reason, summary: Box::new(summary) }),
            None if summary.frames == 0 => Err(PipelineError::NoFrames),
            None => Ok(summary),
        }
    }

    fn take(&mut self, batch: &Batch, names: &BusNames, observer: &mut dyn Observer) {
        for item in batch.items() {
            match (item, &mut self.engine) {
                (Item::Frame(frame), None) => self.decoder.push(frame, names, observer),
                (Item::Frame(frame), Some(engine)) => {
                    engine.frame(frame);
                    self.decoder.push(frame, names, &mut Judge { engine, out: observer });
                }
                (Item::Notice(notice), None) => self.decoder.notice(notice, names, observer),
                (Item::Notice(notice), Some(engine)) => {
                    self.decoder.notice(notice, names, &mut Judge { engine, out: observer });
                }
            }
        }
    }

    /// Index of a live bus for [`Frame::bus`], added if new; `None` above
    /// [`MAX_BUSES`](crate::capture::MAX_BUSES) buses.
    pub fn bus(&mut self, name: &str) -> Option<BusIndex> {
        self.names.index_of(name.as_bytes())
    }

    /// Decodes the next frame of a live bus. Frames of all buses must be in order of time; they are numbered
    /// here, from 1.
    pub fn push(&mut self, frame: &Frame, observer: &mut dyn Observer) {
        let frame = Frame { number: self.decoder.frames().saturating_add(1), ..*frame };
        match &mut self.engine {
            None => self.decoder.push(&frame, &self.names, observer),
            Some(engine) => {
                engine.frame(&frame);
                self.decoder.push(&frame, &self.names, &mut Judge { engine, out: observer });
            }
        }
    }

    /// Advances the time of live buses without a frame, so that deadlines expire: to be called several times
    /// per second with the clock of the frames.
    pub fn advance(&mut self, now: Timestamp, observer: &mut dyn Observer) {
        let Some(engine) = &mut self.engine else { return self.decoder.advance(now, observer) };
        self.decoder.advance(now, &mut Judge { engine, out: observer });
        for bus in self.decoder.buses() {
            engine.advance(bus, observer);
        }
    }

    /// Closes open transfers and findings, and returns all results.
    pub fn finish(mut self, observer: &mut dyn Observer) -> Summary {
        let findings = match self.engine {
            None => {
                self.decoder.finish(&self.names, observer);
                Findings::default()
            }
            Some(mut engine) => {
                self.decoder.finish(&self.names, &mut Judge { engine: &mut engine, out: observer });
                engine.finish(self.decoder.buses(), observer)
            }
        };
        let (frames, unreadable) = (self.decoder.frames(), self.decoder.unreadable());
        Summary { findings, frames, unreadable, buses: self.decoder.into_buses() }
    }
}

/// Information about the buses that their frames do not contain; all options are optional, in any order.
///
/// ```
/// use cobscope_decoder::{NodeId, Pipeline};
///
/// let options = Pipeline::builder()
///     .bus_file("[bus.can0]\nbitrate = 250000\n[node.5]\nname = \"boom\"\n")
///     .device(NodeId::Canopen(2), "rexroth-sydfec");
/// let pipeline = options.build()?;
/// # let _ = pipeline;
/// # Ok::<(), cobscope_decoder::PipelineError>(())
/// ```
#[derive(Debug, Clone, Default)]
pub struct PipelineBuilder {
    read: ReadOptions,
    protocol: ProtocolChoice,
    bus_file: String,
    today: Option<String>,
    profiles: Vec<String>,
    devices: Vec<(Option<String>, NodeId, String)>,
    databases: Vec<Vec<u8>>,
    is_without_rules: bool,
}

impl PipelineBuilder {
    /// Text of a bus file (TOML): names, devices, identifiers, bit rates, expectations. Files that it refers
    /// to are not read: add them with [`Self::profile`] and [`Self::database`].
    #[must_use]
    pub fn bus_file(mut self, text: impl Into<String>) -> Self {
        self.bus_file = text.into();
        self
    }

    /// Current date such as `2026-01-31`, at which suppressions of the bus file expire; without it none
    /// expires.
    #[must_use]
    pub fn today(mut self, day: impl Into<String>) -> Self {
        self.today = Some(day.into());
        self
    }

    /// Text of a device profile (TOML), in addition to those of this crate; repeatable.
    #[must_use]
    pub fn profile(mut self, text: impl Into<String>) -> Self {
        self.profiles.push(text.into());
        self
    }

    /// Profile of a node on every bus, such as `wandfluh-md2` or `wandfluh-md2:controller`; overrides the bus
    /// file.
    #[must_use]
    pub fn device(mut self, node: NodeId, profile: impl Into<String>) -> Self {
        self.devices.push((None, node, profile.into()));
        self
    }

    /// Profile of a node on one bus.
    #[must_use]
    pub fn device_on(mut self, bus: impl Into<String>, node: NodeId, profile: impl Into<String>) -> Self {
        self.devices.push((Some(bus.into()), node, profile.into()));
        self
    }

    /// Content of a DBC file, or of pretty_j1939's JSON; repeatable. If several define a message, the first
    /// takes precedence.
    #[must_use]
    pub fn database(mut self, bytes: impl Into<Vec<u8>>) -> Self {
        self.databases.push(bytes.into());
        self
    }

    /// Protocol of the traffic; by default it is detected.
    #[must_use]
    pub fn protocol(mut self, protocol: ProtocolChoice) -> Self {
        self.protocol = protocol;
        self
    }

    /// Interpretation of ambiguous captures.
    #[must_use]
    pub fn read_options(mut self, options: ReadOptions) -> Self {
        self.read = options;
        self
    }

    /// Only decodes: emits no findings.
    #[must_use]
    pub fn without_rules(mut self) -> Self {
        self.is_without_rules = true;
        self
    }

    /// Builds a pipeline with these options; each pipeline reads one capture.
    ///
    /// # Errors
    /// If a bus file, profile or database is invalid, or if a profile or rule is unknown.
    pub fn build(&self) -> Result<Pipeline, PipelineError> {
        let bus_file = BusFile::parse(&self.bus_file).map_err(PipelineError::BusFile)?;
        let mut catalogue = Catalogue::default();
        for (place, text) in (1..).zip(&self.profiles) {
            catalogue.add_text(&format!("profile {place}"), text)?;
        }
        for (profile, rule, key, value) in bus_file.device_tolerances() {
            catalogue.set_tolerance(profile, rule, key, value);
        }
        let assignments = self.assignments(&bus_file, &mut catalogue)?;
        let setup = (!self.is_without_rules).then(|| self.setup(&bus_file, &catalogue)).transpose()?;
        let session = SessionOptions {
            protocol: self.protocol,
            assignments,
            database: Arc::new(self.joined_databases()?),
            catalogue: Arc::new(catalogue),
            bus_file,
            ..SessionOptions::default()
        };
        Ok(Pipeline::with(session, setup, self.read))
    }

    /// Devices of the bus file, then of the options: if a node is listed twice, the last entry wins.
    fn assignments(
        &self,
        bus_file: &BusFile,
        catalogue: &mut Catalogue,
    ) -> Result<Vec<Assignment>, ProfileError> {
        let of_file = bus_file.devices().map(|(bus, node, profile)| {
            (bus.map(str::to_owned), node, profile.text.as_str(), AssignedBy::BusFile)
        });
        let of_options = self
            .devices
            .iter()
            .map(|(bus, node, profile)| (bus.clone(), *node, profile.as_str(), AssignedBy::Option));
        let all = of_file.chain(of_options);
        all.map(|(bus, node, profile, by)| {
            Ok(Assignment { bus, node, device: catalogue.device(profile)?, by })
        })
        .collect()
    }

    fn setup(&self, bus_file: &BusFile, catalogue: &Catalogue) -> Result<Setup, PipelineError> {
        let setup = Setup::new(bus_file, &self.bus_file, self.today.clone());
        let setup = setup.map_err(PipelineError::BusFile)?;
        setup.check_devices(bus_file, &self.bus_file, catalogue).map_err(PipelineError::BusFile)?;
        Ok(setup)
    }

    fn joined_databases(&self) -> Result<Database, PipelineError> {
        let mut joined = Database::default();
        for bytes in &self.databases {
            joined.add(dbc::parse(bytes).map_err(PipelineError::Database)?);
        }
        Ok(joined)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::event::{Event, EventKind};
    use crate::frame::CanId;

    const LOST: &[u8] =
        b"(1.0) can0 705#7F\n(1.1) can0 705#7F\n(1.2) can0 705#7F\n(3.0) can0 080#\n(4.0) can0 080#\n";

    fn kinds(pipeline: Pipeline, capture: &[u8]) -> Result<(Vec<&'static str>, Summary), PipelineError> {
        let mut kinds = Vec::new();
        let summary = pipeline.read(capture, &mut |event: &Event, _: &Bus| kinds.push(event.kind.name()))?;
        Ok((kinds, summary))
    }

    #[test]
    fn frames_pushed_by_hand_are_judged_as_those_of_a_capture() {
        let (expected, of_capture) = kinds(Pipeline::new(), LOST).unwrap();
        let mut pipeline = Pipeline::new();
        let bus = pipeline.bus("can0").unwrap();
        let mut found = Vec::new();
        let mut observer = |event: &Event, _: &Bus| found.push(event.kind.name());
        for (time, id, data) in [
            (10, 0x705, &[0x7F][..]),
            (11, 0x705, &[0x7F]),
            (12, 0x705, &[0x7F]),
            (30, 0x80, &[]),
            (40, 0x80, &[]),
        ] {
            let time = Some(Timestamp(time * 100_000_000));
            let frame = Frame { time, bus, ..Frame::data_frame(CanId::standard(id), data) };
            pipeline.push(&frame, &mut observer);
        }
        let summary = pipeline.finish(&mut observer);
        assert_eq!(found, expected);
        assert_eq!((summary.frames, summary.buses.len()), (5, 1));
        assert_eq!(summary.findings.groups.len(), of_capture.findings.groups.len());
    }

    #[test]
    fn time_that_passes_without_frames_expires_deadlines() {
        let options = Pipeline::builder().without_rules();
        let mut pipeline = options.build().unwrap();
        let bus = pipeline.bus("can0").unwrap();
        let mut is_timeout = false;
        let mut observer =
            |event: &Event, _: &Bus| is_timeout |= matches!(event.kind, EventKind::SdoTransfer(_));
        let boot = Frame { time: Some(Timestamp(0)), bus, ..Frame::data_frame(CanId::standard(0x705), &[0]) };
        let request = Frame {
            time: Some(Timestamp(1)),
            ..Frame::data_frame(CanId::standard(0x605), &[0x40, 0, 0x10, 0, 0, 0, 0, 0])
        };
        pipeline.push(&boot, &mut observer);
        pipeline.push(&request, &mut observer);
        let later = Frame { time: Some(Timestamp(2_000_000_000)), bus, ..boot };
        pipeline.advance(Timestamp(100_000_000), &mut observer);
        pipeline.push(&later, &mut observer);
        assert!(is_timeout);
    }

    #[test]
    fn options_that_are_wrong_are_refused() {
        let wrong = |builder: PipelineBuilder| {
            builder.build().err().map(|error| error.to_string()).unwrap_or_default()
        };
        assert!(wrong(Pipeline::builder().bus_file("nodes = 1")).starts_with("bus file: 1:1: "));
        let unknown = Pipeline::builder().device(NodeId::Canopen(2), "rexroth-sydfek");
        assert_eq!(wrong(unknown), "unknown profile 'rexroth-sydfek'; did you mean 'rexroth-sydfec'?");
        assert!(wrong(Pipeline::builder().profile("id = 1")).starts_with("profile 1:1:6: "));
        assert!(wrong(Pipeline::builder().database(*b"\0")).starts_with("database: "));
    }

    #[test]
    fn a_capture_that_is_not_whole_is_an_error_with_all_before() {
        let mut whole = Vec::from(0xA1B2_C3D4_u32.to_le_bytes());
        whole.extend([2, 0, 4, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0xFF, 0xFF, 0, 0, 227, 0, 0, 0]);
        assert!(matches!(kinds(Pipeline::new(), &whole), Err(PipelineError::NoFrames)));
        whole.extend([0; 8]);
        whole.extend([16, 0, 0, 0, 16, 0, 0, 0, 0, 0, 7, 5, 1, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0]);
        assert_eq!(kinds(Pipeline::new(), &whole).unwrap().1.frames, 1);
        whole.extend([0; 12]);
        let Err(PipelineError::Incomplete { summary, .. }) = kinds(Pipeline::new(), &whole) else {
            unreachable!()
        };
        assert_eq!(summary.frames, 1);
        assert!(matches!(kinds(Pipeline::new(), b"no capture"), Err(PipelineError::Capture(_))));
    }
}
