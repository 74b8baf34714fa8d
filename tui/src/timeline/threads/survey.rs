//! Surveys the whole capture in its own pass: findings, transfers, errors, load.

use std::sync::mpsc::Sender;
use std::sync::{Arc, PoisonError};
use std::time::{Duration, Instant};

use cobscope_decoder::diagnosis::{Diagnosis, Setting};
use cobscope_decoder::event::{
    DtcAction, EmcyAction, Event, EventKind, ExchangeOutcome, Kind, MessageOutcome, Outcome,
};
use cobscope_decoder::frame::{Frame, Timestamp};
use cobscope_decoder::replay::{EventPosition, PlacedEvent};
use cobscope_decoder::rules::{Engine, Setup};
use cobscope_decoder::session::{Bus, Buses};
use cobscope_decoder::sink::escape;
use cobscope_decoder::sink::text::{Line, TransferWords};
use cobscope_decoder::statistics::Statistics;

use crate::timeline::load::LoadOverTime;
use crate::timeline::news::News;
use crate::timeline::shared::Shared;
use crate::timeline::survey::{
    Exchange, FindingOccurrence, MOST_ERRORS, MOST_EXCHANGES, MOST_NEWS, MOST_NMT, NmtMoment, OpenedFinding,
    bit_rate_change, nmt_moment,
};
use crate::timeline::walk::Walk;

/// Number of frames between two publications.
const STRIDE: u64 = 65_536;

/// Interval of publications of a growing capture.
const TELL: Duration = Duration::from_millis(200);

/// Surveys the whole capture.
pub(in crate::timeline) fn run(shared: &Shared, setup: &Arc<Setup>, news: &Sender<News>) {
    if let Ok(mut walk) = Walk::start(shared) {
        let mut surveyor = Surveyor::new(setup);
        let mut next = STRIDE;
        let mut told = Instant::now();
        while !shared.is_over() {
            // The next frame may take long to arrive.
            if walk.is_drained() && told.elapsed() >= TELL {
                told = Instant::now();
                surveyor.publish(shared, walk.world.frames());
            }
            match walk.peek() {
                Ok(Some(frame)) => surveyor.frame(frame),
                // A notice: time may have advanced without a frame.
                Ok(None) => surveyor.advance(walk.world.buses()),
                Err(_) => {}
            }
            match walk.step(&mut |told: PlacedEvent<'_>| surveyor.event(&told)) {
                Ok(true) => {}
                Ok(false) => break,
                Err(_) => {
                    walk.close(&mut |told: PlacedEvent<'_>| surveyor.event(&told));
                    break;
                }
            }
            if walk.world.frames() >= next {
                next = walk.world.frames() + STRIDE;
                surveyor.publish(shared, walk.world.frames());
            }
        }
        surveyor.publish(shared, walk.world.frames());
        let names = walk.names().to_vec();
        surveyor.finish(shared, walk.world.buses(), names);
    }
    shared.survey.write().unwrap_or_else(PoisonError::into_inner).is_complete = true;
    // The application may have ended.
    let _ = news.send(News::Surveyed);
}

/// Results since the last publication.
struct Surveyor {
    engine: Engine,
    news: Vec<OpenedFinding>,
    exchanges: Vec<Exchange>,
    errors: Vec<EventPosition>,
    nmt: Vec<NmtMoment>,
    load: Vec<LoadOverTime>,
    statistics: Statistics,
    kept: (usize, usize, usize, usize),
    kinds: Vec<u64>,
    more_exchanges: u64,
    bit_rate_change: Option<(String, String)>,
    /// Timestamp of the first frame.
    first: Option<Timestamp>,
}

impl Surveyor {
    /// Advances the time of the rules to that of the buses.
    fn advance(&mut self, buses: Buses<'_>) {
        for bus in buses {
            self.engine.advance(bus, &mut |_: &Event, _: &Bus| ());
        }
    }

    fn new(setup: &Arc<Setup>) -> Self {
        Self {
            engine: Engine::new(Arc::clone(setup)),
            news: Vec::new(),
            exchanges: Vec::new(),
            errors: Vec::new(),
            nmt: Vec::new(),
            load: Vec::new(),
            statistics: Statistics::default(),
            kept: (0, 0, 0, 0),
            kinds: vec![0; Kind::ALL.len()],
            more_exchanges: 0,
            bit_rate_change: None,
            first: None,
        }
    }

    fn frame(&mut self, frame: &Frame) {
        if frame.number == 1 {
            self.first = frame.time;
        }
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
        let (news, kept) = (&mut self.news, &mut self.kept);
        let mut opened = |event: &Event, _: &Bus| {
            if let EventKind::FindingOpened(finding) = &event.kind
                && kept.0 < MOST_NEWS
            {
                kept.0 += 1;
                let (bus, node, finding) = (event.bus, event.node, (**finding).clone());
                news.push(OpenedFinding { spot: told.spot, time: event.time, bus, node, news: finding });
            }
        };
        self.engine.event(told.event, told.bus, &mut opened);
        if let Some(change) = bit_rate_change(told.event) {
            self.bit_rate_change = Some((escape(told.bus.name()).into_owned(), escape(change).into_owned()));
        }
        if is_error(told.event) && self.kept.1 < MOST_ERRORS {
            self.kept.1 += 1;
            self.errors.push(told.spot);
        }
        if let Some(moment) = nmt_moment(told.event).filter(|_| self.kept.3 < MOST_NMT) {
            self.kept.3 += 1;
            self.nmt.push(moment);
        }
        if let Some(exchange) = exchange(told) {
            if self.kept.2 < MOST_EXCHANGES {
                self.kept.2 += 1;
                self.exchanges.push(exchange);
            } else {
                self.more_exchanges += 1;
            }
        }
    }

    fn publish(&mut self, shared: &Shared, frames: u64) {
        let mut survey = shared.survey.write().unwrap_or_else(PoisonError::into_inner);
        survey.frames = frames;
        survey.places.extend(self.news.iter().map(|opened| FindingOccurrence {
            frame: opened.spot.frame,
            time: opened.time,
            id: opened.news.id,
            severity: opened.news.severity,
        }));
        survey.news.append(&mut self.news);
        survey.exchanges.append(&mut self.exchanges);
        survey.errors.append(&mut self.errors);
        survey.nmt.append(&mut self.nmt);
        survey.kinds.clone_from(&self.kinds);
        survey.more_exchanges = self.more_exchanges;
        survey.bit_rate_change.clone_from(&self.bit_rate_change);
        survey.load.clone_from(&self.load);
        survey.statistics.clone_from(&self.statistics);
    }

    fn finish(self, shared: &Shared, buses: Buses<'_>, names: Vec<String>) {
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
        let setting = Setting { zero: self.first, end: None };
        let diagnosis = Diagnosis::of(&findings, findings.counting(), setting);
        let mut survey = shared.survey.write().unwrap_or_else(PoisonError::into_inner);
        survey.places = places;
        survey.diagnosis = Some(diagnosis);
        survey.statistics.withdraw(buses);
        survey.findings = Some(findings);
        survey.buses = names;
    }
}

/// Whether an event reports an error.
fn is_error(event: &Event) -> bool {
    match &event.kind {
        EventKind::Emcy(emergency) => emergency.action == EmcyAction::Raised,
        EventKind::Dtc(dtc) => dtc.action == DtcAction::Raised,
        EventKind::NodeLost(_)
        | EventKind::CanError(_)
        | EventKind::LostFrames { .. }
        | EventKind::Malformed { .. }
        | EventKind::MessageGap(_) => true,
        EventKind::DeviceState(state) => state.fault,
        EventKind::SdoTransfer(transfer) => {
            matches!(transfer.outcome, Outcome::Aborted | Outcome::Timeout)
        }
        EventKind::J1939Transfer(transfer) => {
            !matches!(transfer.outcome, Outcome::Complete | Outcome::Unfinished)
        }
        EventKind::UdsExchange(exchange) => {
            matches!(exchange.outcome, ExchangeOutcome::Negative | ExchangeOutcome::NoAnswer)
        }
        _ => false,
    }
}

/// The row of a transfer.
fn exchange(told: &PlacedEvent<'_>) -> Option<Exchange> {
    let event = told.event;
    let (duration, size, outcome) = match &event.kind {
        EventKind::SdoTransfer(transfer) => (transfer.duration, transfer.size, transfer.outcome.name()),
        EventKind::J1939Transfer(transfer) => (transfer.duration, transfer.size, transfer.outcome.name()),
        EventKind::UdsExchange(exchange) => (exchange.duration, 0, exchange.outcome.name()),
        // Complete ISO-TP messages belong to a UDS exchange.
        EventKind::IsoTpTransfer(transfer) if transfer.outcome != MessageOutcome::Complete => {
            (transfer.duration, transfer.size, transfer.outcome.name())
        }
        _ => return None,
    };
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
        event_kind: event.kind.name(),
        what: escape(&line.what).into(),
        news: escape(&news).into(),
        duration,
        size,
        outcome,
        tone: line.tone,
    })
}
