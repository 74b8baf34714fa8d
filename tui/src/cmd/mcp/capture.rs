//! A capture that was read once, with everything that answers need: findings, stories, statistics, objects, signals, and
//! checkpoints for a second look at any part.

use std::path::PathBuf;
use std::sync::Arc;

use anyhow::{Context as _, anyhow, bail, ensure};
use cobscope_decoder::frame::Timestamp;
use cobscope_decoder::rules::RuleSetup;
use cobscope_decoder::session::{Bus, Buses, Node};

use crate::run::arguments::{InputArgs, NodeArg};
use crate::run::capture_answers::PassResults;
use crate::run::input::{
    build_setup, capture_paths, capture_series, join_options, load_catalogue, missing_parts, options_of,
    read_options,
};
use crate::select::{BoundSide, RangeBound};
use crate::source::{CaptureFile, time_span};
use crate::timeline::{IndexedCapture, TimelineCaptures, WalkStart};

/// A capture with its results.
pub(super) struct OpenedCapture {
    pub(super) name: String,
    input: InputArgs,
    parts: Vec<PathBuf>,
    pub(super) results: PassResults,
    pub(super) indexed: IndexedCapture,
    rules: Arc<RuleSetup>,
}

impl OpenedCapture {
    /// Reads a capture.
    ///
    /// # Errors
    /// It cannot be opened, has an unknown format, or its files are parts of several captures.
    pub(super) fn open(input: InputArgs) -> anyhow::Result<Self> {
        let options = options_of(&input, load_catalogue(&input.profiles))?;
        let all = capture_series(&input);
        ensure!(all.len() == 1, "the files are {} captures, expected the parts of one", all.len());
        let Some(series) = all.into_iter().next() else { bail!("no capture") };
        let rules = Arc::new(build_setup(&input, &options.catalogue, None)?);
        let mut results = PassResults::of(&series, &input, &options, &rules)?;
        results.warnings.extend(results.failure.clone());
        results.warnings.extend(missing_parts(&CaptureFile::files_named(&capture_paths(&input)), &input));
        let captures = TimelineCaptures {
            paths: series.parts.clone(),
            align: false,
            join: join_options(&input),
            read: read_options(&input),
            session: options,
            rules: Arc::clone(&rules),
            live: None,
        };
        let indexed = IndexedCapture::open(captures)?;
        Ok(Self { name: series.name(), input, parts: series.parts, results, indexed, rules })
    }

    /// Checks the name of a rule, so that a wrong one is not taken for a rule without findings.
    ///
    /// # Errors
    /// The rule is unknown.
    pub(super) fn ensure_rule(&self, rule: Option<&str>) -> anyhow::Result<()> {
        rule.map_or(Ok(()), |rule| self.rules.check_name(rule)).map_err(|error| anyhow!("rule: {error}"))
    }

    /// Checks a node, so that a wrong one is not taken for a node without findings.
    ///
    /// # Errors
    /// The node is not in this capture.
    pub(super) fn ensure_node(&self, node: Option<&NodeArg>) -> anyhow::Result<()> {
        node.map_or(Ok(()), |node| node_in(self.results.decoder.buses(), node).map(|_| ()))
    }

    /// Time of the first frame, the zero of seconds.
    pub(super) fn zero(&self) -> Option<Timestamp> {
        self.results.first.time
    }

    /// A bound in this capture.
    ///
    /// # Errors
    /// A time is requested and the capture has no timestamps, or a time of day is ambiguous.
    pub(super) fn resolve_bound(&self, bound: RangeBound, side: BoundSide) -> anyhow::Result<RangeBound> {
        bound.resolve_bound(side, &self.results.first, &mut || {
            time_span(&self.parts, &read_options(&self.input))
        })
    }

    /// The start of a walk that reaches a bound.
    pub(super) fn walk_start(&self, bound: Option<RangeBound>) -> WalkStart {
        match (bound, self.zero()) {
            (Some(RangeBound::Frame(frame)), _) => WalkStart::Frame(frame),
            (Some(RangeBound::Moment(moment)), _) => WalkStart::Time(moment),
            (Some(RangeBound::Offset(offset)), Some(zero)) => WalkStart::Time(zero.plus(offset)),
            _ => WalkStart::Frame(1),
        }
    }
}

/// A node with its bus; the first one of this ID if no bus is named.
///
/// # Errors
/// The node is not in this capture.
pub(super) fn node_in<'a>(buses: Buses<'a>, node: &NodeArg) -> anyhow::Result<(&'a Bus, &'a Node)> {
    let on = buses.iter().filter(|bus| node.bus.as_deref().is_none_or(|name| name == bus.name()));
    let mut known = on.filter_map(|bus| Some((bus, bus.node(node.id)?)));
    known.next().with_context(|| format!("node {}: not in this capture", node.typed_text()))
}
