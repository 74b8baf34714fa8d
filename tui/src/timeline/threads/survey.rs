//! Surveys the whole capture in its own pass: findings, transfers, errors, load.

use std::sync::mpsc::Sender;
use std::sync::{Arc, PoisonError};
use std::time::{Duration, Instant};

use cobscope_decoder::event::{Event, EventKind, Kind, TransferFigures};
use cobscope_decoder::frame::Frame;
use cobscope_decoder::query::{kind_filter, subject_filter};
use cobscope_decoder::replay::{EventPosition, PlacedEvent, ReplayState};
use cobscope_decoder::rules::{Engine, Setup};
use cobscope_decoder::session::Bus;
use cobscope_decoder::sink::escape;
use cobscope_decoder::sink::text::{Line, TransferWords};
use cobscope_decoder::statistics::{LoadOverTime, Statistics};

use super::diagnosing::{Diagnosing, diagnose};
use crate::timeline::news::News;
use crate::timeline::shared::Shared;
use crate::timeline::survey::{
    Exchange, FindingOccurrence, MOST_ERRORS, MOST_EXCHANGES, MOST_NEWS, MOST_NMT, NmtMoment, OpenedFinding,
    bit_rate_change, nmt_moment,
};
use crate::timeline::walk;

/// Number of frames between two publications.
const STRIDE: u64 = 65_536;

/// Interval of publications of a growing capture.
const TELL: Duration = Duration::from_millis(200);

/// Surveys the whole capture.
pub(in crate::timeline) fn run(shared: &Shared, setup: &Arc<Setup>, news: &Sender<News>) {
    if let Ok(mut walk) = walk::start(shared) {
        let mut surveyor = Surveyor::new(setup);
        let mut next = STRIDE;
        let mut told = Instant::now();
        while !shared.is_over() {
            // The next frame may take long to arrive: until then, everything known is published.
            if walk.is_drained() {
                while !shared.is_over() && surveyor.has_unpublished() {
                    if told.elapsed() >= TELL {
                        told = Instant::now();
                        surveyor.publish(shared, &walk.world);
                        shared.report_growth(news);
                    }
                    if shared.waits_for_growth(walk.offset(), TELL) {
                        break;
                    }
                }
            }
            match walk.peek() {
                Ok(Some(frame)) => surveyor.frame(frame),
                // A notice: time may have advanced without a frame.
                Ok(None) => surveyor.advance(&walk.world),
                Err(error) => shared.fail(&error),
            }
            match walk.step(&mut |told: PlacedEvent<'_>| surveyor.event(&told)) {
                Ok(true) => {}
                Ok(false) => break,
                Err(error) => {
                    shared.fail(&error);
                    walk.close(&mut |told: PlacedEvent<'_>| surveyor.event(&told));
                    break;
                }
            }
            if walk.world.frames() >= next {
                next = walk.world.frames() + STRIDE;
                surveyor.publish(shared, &walk.world);
            }
        }
        surveyor.publish(shared, &walk.world);
        let names = walk.names().to_vec();
        surveyor.finish(shared, &walk.world, names);
    }
    shared.survey.write().unwrap_or_else(PoisonError::into_inner).is_complete = true;
    // The application may have ended.
    let _ = news.send(News::Surveyed);
}

/// Results since the last publication.
struct Surveyor {
    engine: Engine,
    findings: FindingInbox,
    exchanges: Vec<Exchange>,
    errors: Vec<EventPosition>,
    nmt: Vec<NmtMoment>,
    load: Vec<LoadOverTime>,
    statistics: Statistics,
    kept: (usize, usize, usize),
    kinds: Vec<u64>,
    more_exchanges: u64,
    bit_rate_change: Option<(String, String)>,
    /// Frames or events since the last publication.
    has_news: bool,
}

/// Findings since the last publication.
#[derive(Default)]
struct FindingInbox {
    opened: Vec<OpenedFinding>,
    kept: usize,
    diagnosing: Diagnosing,
}

impl FindingInbox {
    fn see(&mut self, spot: EventPosition, event: &Event) {
        self.diagnosing.see(event);
        if let EventKind::FindingOpened(news) = &event.kind
            && self.kept < MOST_NEWS
        {
            self.kept += 1;
            let (bus, node, news) = (event.bus, event.node, (**news).clone());
            self.opened.push(OpenedFinding { spot, time: event.time, bus, node, news });
        }
    }
}

impl Surveyor {
    /// Advances the time of the rules to that of the buses.
    fn advance(&mut self, world: &ReplayState) {
        let (engine, findings) = (&mut self.engine, &mut self.findings);
        for bus in world.buses() {
            engine.advance(bus, &mut |event: &Event, _: &Bus| findings.see(world.spot(), event));
        }
    }

    fn new(setup: &Arc<Setup>) -> Self {
        Self {
            engine: Engine::new(Arc::clone(setup)),
            findings: FindingInbox::default(),
            exchanges: Vec::new(),
            errors: Vec::new(),
            nmt: Vec::new(),
            load: Vec::new(),
            statistics: Statistics::default(),
            kept: (0, 0, 0),
            kinds: vec![0; Kind::ALL.len()],
            more_exchanges: 0,
            bit_rate_change: None,
            has_news: false,
        }
    }

    fn frame(&mut self, frame: &Frame) {
        self.has_news = true;
        self.engine.frame(frame);
        self.statistics.frame(frame);
        let bus = usize::from(frame.bus.0);
        if self.load.len() <= bus {
            self.load.resize_with(bus + 1, LoadOverTime::default);
        }
        if let Some(load) = self.load.get_mut(bus) {
            load.add(frame);
        }
    }

    fn event(&mut self, told: &PlacedEvent<'_>) {
        self.statistics.event(told.event);
        if let Some(count) = self.kinds.get_mut(told.event.kind.kind() as usize) {
            *count += 1;
        }
        self.has_news = true;
        let findings = &mut self.findings;
        self.engine.event(told.event, told.bus, &mut |event: &Event, _: &Bus| findings.see(told.spot, event));
        if let Some(change) = bit_rate_change(told.event) {
            self.bit_rate_change = Some((escape(told.bus.name()).into_owned(), escape(change).into_owned()));
        }
        if told.event.is_error() && self.kept.0 < MOST_ERRORS {
            self.kept.0 += 1;
            self.errors.push(told.spot);
        }
        if let Some(moment) = nmt_moment(told.event).filter(|_| self.kept.2 < MOST_NMT) {
            self.kept.2 += 1;
            self.nmt.push(moment);
        }
        if let Some(exchange) = exchange(told) {
            if self.kept.1 < MOST_EXCHANGES {
                self.kept.1 += 1;
                self.exchanges.push(exchange);
            } else {
                self.more_exchanges += 1;
            }
        }
    }

    /// Whether something is known that the survey does not contain.
    fn has_unpublished(&self) -> bool {
        self.has_news || self.findings.diagnosing.is_pending()
    }

    fn publish(&mut self, shared: &Shared, world: &ReplayState) {
        self.has_news = false;
        let so_far = self.findings.diagnosing.is_due(Instant::now());
        let so_far = so_far.then(|| diagnose(&self.engine.so_far(world.buses()), world.zero(), true));
        let mut survey = shared.survey.write().unwrap_or_else(PoisonError::into_inner);
        if let Some(so_far) = so_far {
            survey.set_diagnosis(so_far);
        }
        survey.frames = world.frames();
        survey.places.extend(self.findings.opened.iter().map(|opened| FindingOccurrence {
            frame: opened.spot.frame,
            time: opened.time,
            id: opened.news.id,
            severity: opened.news.severity,
        }));
        survey.news.append(&mut self.findings.opened);
        survey.exchanges.append(&mut self.exchanges);
        survey.errors.append(&mut self.errors);
        survey.nmt.append(&mut self.nmt);
        survey.kinds.clone_from(&self.kinds);
        survey.more_exchanges = self.more_exchanges;
        survey.bit_rate_change.clone_from(&self.bit_rate_change);
        survey.load.clone_from(&self.load);
        survey.statistics.clone_from(&self.statistics);
    }

    fn finish(self, shared: &Shared, world: &ReplayState, names: Vec<String>) {
        let buses = world.buses();
        let findings = self.engine.finish(buses, &mut |_: &Event, _: &Bus| ());
        let mut places = Vec::new();
        for group in findings.counting() {
            places.extend(group.first.iter().chain(&group.last).map(|occurrence| FindingOccurrence {
                frame: occurrence.frames.last,
                time: occurrence.time,
                id: group.id,
                severity: group.severity,
            }));
        }
        places.sort_by_key(|place| (place.frame, place.id));
        places.dedup();
        let diagnosed = diagnose(&findings, world.zero(), false);
        let mut survey = shared.survey.write().unwrap_or_else(PoisonError::into_inner);
        survey.places = places;
        survey.set_diagnosis(diagnosed);
        survey.statistics.withdraw(buses);
        survey.findings = Some(findings);
        survey.buses = names;
    }
}

/// The row of a transfer.
fn exchange(told: &PlacedEvent<'_>) -> Option<Exchange> {
    let event = told.event;
    let TransferFigures { duration, size, outcome } = event.transfer_figures()?;
    let line = Line::of(event, told.bus);
    let news = TransferWords::of(event, told.bus).map_or_else(|| line.what.clone(), |words| words.news());
    Some(Exchange {
        spot: told.spot,
        time: event.time,
        frames: event.frames,
        bus: event.bus,
        who: escape(&line.who).into(),
        node: event.node,
        kind: line.kind,
        event_kind: event.kind.kind(),
        kind_filter: kind_filter(event).into(),
        subject: subject_filter(event, told.bus).map(Into::into),
        what: escape(&line.what).into(),
        news: escape(&news).into(),
        duration,
        size,
        outcome,
        tone: line.tone,
    })
}
