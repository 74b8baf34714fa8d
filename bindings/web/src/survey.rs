//! The first reading of a capture: rules, stories, statistics, checkpoints.
//!
//! ```text
//! captures ─Walk─▶ events ─┬─▶ rules ─▶ findings      ┐
//!                          ├─▶ why, statistics, load  ├─▶ Survey
//!                          ├─▶ rows per block         │
//!                          └─▶ checkpoints            ┘
//! ```

use std::sync::Arc;

use cobscope_decoder::diagnosis::{Diagnosis, Setting};
use cobscope_decoder::event::{Event, EventKind, Kind};
use cobscope_decoder::finding::Findings;
use cobscope_decoder::frame::{Frame, Timestamp};
use cobscope_decoder::profile::Catalogue;
use cobscope_decoder::replay::{Checkpoint, EventPosition, Index, PlacedEvent, ReplayState, Walk};
use cobscope_decoder::rules::{Engine, Setup};
use cobscope_decoder::session::{Bus, Observer};
use cobscope_decoder::statistics::{LoadOverTime, Statistics};
use cobscope_decoder::why::{self, Question, Why};

use crate::counts::RowCounts;
use crate::files::Source;
use crate::transfers::{Transfer, Transfers};

/// Frames between the first checkpoints; doubled whenever there are too many.
const FIRST_INTERVAL: u64 = 65_536;

/// Maximum number of positions of error events.
const MOST_ERRORS: usize = 200_000;

/// Results of the first reading.
pub struct Survey {
    /// Findings in groups.
    pub findings: Findings,
    /// Changes before the stories.
    pub why: Why,
    /// Stories with the changes before them.
    pub answer: why::Report,
    /// Statistics of the buses.
    pub statistics: Statistics,
    /// Load of each bus over time.
    pub load: Vec<LoadOverTime>,
    /// Number of events of each kind, in the order of `Kind::ALL`.
    pub kinds: Vec<u64>,
    /// Rows of all events.
    pub all: RowCounts,
    /// Rows of events that are changes.
    pub news: RowCounts,
    /// Transfers in order of their end.
    pub transfers: Transfers,
    /// Positions of error events, in order.
    pub errors: Vec<EventPosition>,
    /// Checkpoints.
    pub index: Index,
    /// State after the last frame.
    pub end: ReplayState,
    /// Reason why the capture was not read to its end.
    pub failure: Option<String>,
}

/// A first reading in progress.
pub struct Surveying {
    walk: Walk<Source>,
    engine: Engine,
    seen: SeenEvents,
    index: Index,
    failure: Option<String>,
}

/// Results that events add to.
struct SeenEvents {
    why: Why,
    statistics: Statistics,
    load: Vec<LoadOverTime>,
    kinds: Vec<u64>,
    all: RowCounts,
    news: RowCounts,
    transfers: Transfers,
    errors: Vec<EventPosition>,
    opened: u64,
}

/// Events of findings.
struct FindingObserver<'a> {
    why: &'a mut Why,
    opened: &'a mut u64,
}

impl Observer for FindingObserver<'_> {
    fn event(&mut self, event: &Event, bus: &Bus) {
        self.why.observe(event, bus, true);
        *self.opened += u64::from(matches!(event.kind, EventKind::FindingOpened(_)));
    }
}

impl SeenEvents {
    fn frame(&mut self, frame: &Frame) {
        self.statistics.frame(frame);
        let bus = usize::from(frame.bus.0);
        if self.load.len() <= bus {
            self.load.resize_with(bus.saturating_add(1), LoadOverTime::default);
        }
        if let Some(load) = self.load.get_mut(bus) {
            load.add(frame);
        }
    }

    fn event(&mut self, placed: &PlacedEvent<'_>, engine: &mut Engine) {
        let event = placed.event;
        self.statistics.event(event);
        if let Some(count) = self.kinds.get_mut(event.kind.kind() as usize) {
            *count += 1;
        }
        self.all.add(placed.spot.frame);
        if placed.is_news {
            self.news.add(placed.spot.frame);
        }
        if event.is_error() && self.errors.len() < MOST_ERRORS {
            self.errors.push(placed.spot);
        }
        if let Some(transfer) = Transfer::of(placed) {
            self.transfers.add(transfer);
        }
        let mut observer = FindingObserver { why: &mut self.why, opened: &mut self.opened };
        observer.why.observe(event, placed.bus, true);
        engine.event(event, placed.bus, &mut observer);
    }
}

impl Surveying {
    /// Starts at the beginning of the captures.
    pub fn new(walk: Walk<Source>, setup: &Arc<Setup>) -> Self {
        let seen = SeenEvents {
            why: Why::new(Question::default()),
            statistics: Statistics::default(),
            load: Vec::new(),
            kinds: vec![0; Kind::ALL.len()],
            all: RowCounts::default(),
            news: RowCounts::default(),
            transfers: Transfers::default(),
            errors: Vec::new(),
            opened: 0,
        };
        let (engine, index) = (Engine::new(Arc::clone(setup)), Index::every(FIRST_INTERVAL));
        Self { walk, engine, seen, index, failure: None }
    }

    /// Frames read so far, decompressed bytes, and findings opened.
    pub fn progress(&self) -> (u64, u64, u64) {
        (self.walk.world.frames(), self.walk.offset(), self.seen.opened)
    }

    /// Reads up to `frames` more frames; `false` at the end.
    pub fn step(&mut self, frames: u64) -> bool {
        let Self { walk, engine, seen, index, failure } = self;
        let limit = walk.world.frames().saturating_add(frames);
        while walk.world.frames() < limit {
            if index.is_due(walk.world.frames())
                && let Some(mark) = walk.mark()
            {
                index.add(mark);
            }
            match walk.peek() {
                Ok(Some(frame)) => {
                    engine.frame(frame);
                    seen.frame(frame);
                }
                Ok(None) => {
                    for bus in walk.world.buses() {
                        let mut observer = FindingObserver { why: &mut seen.why, opened: &mut seen.opened };
                        engine.advance(bus, &mut observer);
                    }
                }
                Err(error) => failure.get_or_insert(error.to_string()).truncate(1_000),
            }
            match walk.step(&mut |placed: PlacedEvent<'_>| seen.event(&placed, engine)) {
                Ok(true) => {}
                Ok(false) => return false,
                Err(error) => {
                    failure.get_or_insert(error.to_string()).truncate(1_000);
                    walk.close(&mut |placed: PlacedEvent<'_>| seen.event(&placed, engine));
                    return false;
                }
            }
        }
        true
    }

    /// The results.
    pub fn finish(self, catalogue: &Catalogue) -> Survey {
        let Self { walk, engine, mut seen, index, failure } = self;
        let world = walk.world;
        let mut observer = FindingObserver { why: &mut seen.why, opened: &mut seen.opened };
        let findings = engine.finish(world.buses(), &mut observer);
        seen.statistics.withdraw(world.buses());
        let setting = Setting { zero: world.zero(), ..Setting::default() };
        let diagnosis = Diagnosis::of(&findings, findings.counting(), setting);
        let why = seen.why;
        let answer = why.clone().report(diagnosis, world.buses(), catalogue);
        Survey {
            findings,
            why,
            answer,
            statistics: seen.statistics,
            load: seen.load,
            kinds: seen.kinds,
            all: seen.all,
            news: seen.news,
            transfers: seen.transfers,
            errors: seen.errors,
            index,
            end: world,
            failure,
        }
    }
}

impl Survey {
    /// Time of the first frame.
    pub fn zero(&self) -> Option<Timestamp> {
        self.end.zero()
    }

    /// The next error event after a position, or the previous one before it.
    pub fn error(&self, from: EventPosition, is_backward: bool) -> Option<EventPosition> {
        let at = self.errors.partition_point(|spot| if is_backward { *spot < from } else { *spot <= from });
        let at = if is_backward { at.checked_sub(1)? } else { at };
        self.errors.get(at).copied()
    }

    /// The last checkpoint at or before a frame.
    pub fn mark(&self, frame: u64) -> Option<&Checkpoint> {
        self.index.before_frame(frame)
    }
}
