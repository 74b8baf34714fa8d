//! Results of one pass over a capture: findings, stories, statistics and signals, each as its command writes it.

use std::collections::{BTreeSet, HashMap};
use std::sync::Arc;

use anyhow::bail;
use cobscope_decoder::answers::statistics::CaptureStatistics;
use cobscope_decoder::answers::stories::StoriesAnswer;
use cobscope_decoder::capture::BusNames;
use cobscope_decoder::decoder::Decoder;
use cobscope_decoder::diagnosis::Setting;
use cobscope_decoder::event::Event;
use cobscope_decoder::frame::{BusIndex, CanId, Frame};
use cobscope_decoder::profile::{Field, Layout};
use cobscope_decoder::rules::{Engine, Judge, Setup};
use cobscope_decoder::session::{Bus, Observer, Preview, SessionOptions};
use cobscope_decoder::sink::findings::{CaptureResult, Report};
use cobscope_decoder::statistics::Statistics;
use serde_json::Value;

use super::decoding::{CaptureObserver, decode_quietly};
use super::facts::{Facts, diagnosis, question};
use crate::cli::{InputArgs, SelectArgs};
use crate::select::Span;
use crate::source::Series;
use crate::timeline::signal::carried;

/// A signal of a capture: bus, node, object or message, name, unit.
pub(super) type SignalName = (String, String, String, String, String);

/// Maximum number of different signals that are listed.
const MOST_SIGNALS: usize = 10_000;

/// Results of one pass.
pub(super) struct Results {
    /// State after the last frame.
    pub(super) decoder: Decoder,
    /// The first frame.
    pub(super) first: Frame,
    /// The object of `stats -f json`.
    pub(super) statistics: Value,
    /// The object of `why -f json`.
    pub(super) why: Value,
    /// The objects of `check -f jsonl`.
    pub(super) findings: Vec<Value>,
    /// All signals, in order.
    pub(super) signals: Vec<SignalName>,
    pub(super) warnings: Vec<String>,
    /// Error that ended reading early.
    pub(super) failure: Option<String>,
}

impl Results {
    /// Reads a capture.
    ///
    /// # Errors
    /// It cannot be opened, has an unknown format, or contains no frames.
    pub(super) fn of(
        series: &Series,
        input: &InputArgs,
        options: &SessionOptions,
        rules: &Arc<Setup>,
    ) -> anyhow::Result<Self> {
        let (name, select) = (series.name(), SelectArgs::default());
        let question = question(input, &select, None);
        let mut watch = Watch {
            engine: Engine::new(Arc::clone(rules)),
            facts: Facts::new(question.clone(), &select)?,
            statistics: Statistics::default(),
            signals: BTreeSet::new(),
            layouts: HashMap::new(),
            first: None,
        };
        let read = decode_quietly(series, input, options, &mut watch)?;
        let Watch { engine, mut facts, mut statistics, signals, first, .. } = watch;
        let Some(first) = first else { bail!("{name}: contains no frames") };
        let buses = read.decoder.buses();
        let findings = engine.finish(buses, &mut facts);
        statistics.withdraw(buses);
        let (why_facts, selected, _) = facts.results(&findings, first.time);
        let setting = Setting { zero: first.time, end: None, is_growing: false };
        let stories = diagnosis(&findings, &selected, setting, (&question, buses));
        let answer = why_facts.report(stories, buses, &options.catalogue);
        let why = serde_json::to_value(StoriesAnswer::new(&answer, buses, first.time, None, &name))?;
        let statistics = CaptureStatistics::new((&name, read.format), &statistics, buses, Bus::bit_rate);
        let statistics = serde_json::to_value(statistics)?;
        let findings = findings_of(CaptureResult {
            capture: name.clone(),
            frames: read.decoder.frames(),
            first: first.time,
            last: read.decoder.last_time(),
            findings,
            ..CaptureResult::default()
        })?;
        let unreadable = read.unreadable_text(&name);
        let mut warnings = read.warnings;
        warnings.extend(unreadable);
        let failure = read.failure.map(|failure| format!("{failure:#}"));
        let signals = signals.into_iter().collect();
        Ok(Self { decoder: read.decoder, first, statistics, why, findings, signals, warnings, failure })
    }
}

/// The objects of `check -f jsonl`.
///
/// # Errors
/// If they cannot be written.
pub(super) fn findings_of(judged: CaptureResult) -> anyhow::Result<Vec<Value>> {
    let report = Report { captures: vec![judged], ..Report::default() };
    report.records().map(|record| Ok(serde_json::to_value(record)?)).collect()
}

/// Collects the results of all commands in one pass.
struct Watch {
    engine: Engine,
    facts: Facts,
    statistics: Statistics,
    signals: BTreeSet<SignalName>,
    /// Last layout of each identifier.
    layouts: HashMap<(BusIndex, CanId), Arc<Layout>>,
    first: Option<Frame>,
}

impl Observer for Watch {
    fn event(&mut self, event: &Event, bus: &Bus) {
        self.statistics.event(event);
        self.see_signals(event, bus);
        Judge { engine: &mut self.engine, out: &mut self.facts }.event(event, bus);
    }

    fn needs(&self, preview: &Preview, bus: &Bus) -> bool {
        self.facts.needs(preview, bus) || self.engine.needs(preview, bus)
    }

    fn skip(&mut self, preview: &Preview, bus: &Bus) -> bool {
        let is_skipped = !self.facts.needs(preview, bus) && self.engine.skip(preview, bus);
        if is_skipped {
            self.facts.count_skipped(preview, bus);
            self.statistics.skip(preview, bus);
        }
        is_skipped
    }

    fn is_selective(&self, preview: &Preview, bus: &Bus) -> bool {
        self.engine.is_selective(preview, bus)
    }
}

impl Watch {
    /// Signals of a layout, once. A new layout has an event, so that none is missed.
    fn see_signals(&mut self, event: &Event, bus: &Bus) {
        let Some((id, layout, _)) = carried(event) else {
            let names = event.signals().map(|signal| signal_name(event, bus, signal.field));
            return self.signals.extend(names.take(MOST_SIGNALS.saturating_sub(self.signals.len())));
        };
        let known = self.layouts.insert((bus.index(), id), Arc::clone(layout));
        if !known.is_some_and(|known| Arc::ptr_eq(&known, layout)) {
            let names = layout.fields.iter().map(|field| signal_name(event, bus, field));
            self.signals.extend(names.take(MOST_SIGNALS.saturating_sub(self.signals.len())));
        }
    }
}

/// Bus, node, object or message, name and unit of a signal.
pub(super) fn signal_name(event: &Event, bus: &Bus, field: &Field) -> SignalName {
    let node = event.node.map_or(String::new(), |node| node.to_string());
    let unit = field.meaning.as_deref().map_or("", |meaning| meaning.unit.as_str());
    let name = field.name().unwrap_or_default().to_owned();
    (bus.name().to_owned(), node, field.id.to_string(), name, unit.to_owned())
}

impl CaptureObserver for Watch {
    /// Nothing is printed.
    fn is_on_terminal(&self) -> bool {
        true
    }

    fn begin(&mut self, first: &Frame, span: Span<'_>) -> anyhow::Result<()> {
        self.first = Some(*first);
        self.facts.begin(first, span)
    }

    fn wants_frames(&self) -> bool {
        true
    }

    fn frame(&mut self, frame: &Frame, _names: &BusNames) -> bool {
        self.statistics.frame(frame);
        self.engine.frame(frame);
        true
    }
}
