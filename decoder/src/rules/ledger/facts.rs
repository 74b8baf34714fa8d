//! Facts that can be the cause of a finding: commands and writes that no rule judges.

use std::sync::Arc;

use serde::Deserialize;

use super::causes::causes;
use super::occurrence;
use crate::event::{Direction, Event, EventKind, Outcome, SdoTransfer};
use crate::finding::FactCause;
use crate::frame::{BusIndex, Timestamp};
use crate::session::Bus;
use crate::wire::NodeId;

/// Maximum number of facts of a capture.
const FACT_LIMIT: usize = 256;

/// Error frames within this time are one fact, in ns.
const BURST: i64 = 1_000_000_000;

/// One row `[[fact]]` of `causes.toml`.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct FactRow {
    /// Name for `by`.
    pub(super) name: String,
    event: FactEvent,
    /// First step for the reader.
    #[serde(default)]
    pub(super) next: String,
    /// NMT services.
    #[serde(default)]
    services: Vec<String>,
    /// First and last object index of writes.
    #[serde(default)]
    objects: Vec<[u16; 2]>,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "kebab-case")]
enum FactEvent {
    NmtCommand,
    Write,
    CanError,
    /// Commands on an identifier without a known consumer; computed when a finding begins.
    NoConsumer,
}

/// A fact on a bus, about a node.
#[derive(Debug)]
struct SeenFact {
    row: usize,
    bus: BusIndex,
    node: Option<NodeId>,
    now: i64,
    /// A later command replaced the state that this one set.
    is_over: bool,
    fact: Arc<FactCause>,
}

/// Facts of a capture.
#[derive(Debug, Default)]
pub(super) struct Facts(Vec<SeenFact>);

impl Facts {
    /// Records an event if a row names it.
    pub(super) fn observe(&mut self, event: &Event, bus: &Bus, now: i64) {
        for (row, known) in causes().facts.iter().enumerate() {
            let seen = match (&event.kind, known.event) {
                (EventKind::NmtCommand { service, target, .. }, FactEvent::NmtCommand) => {
                    let node = (*target != 0).then(|| NodeId::from(*target));
                    for seen in self.0.iter_mut().filter(|seen| seen.row == row && seen.bus == event.bus) {
                        seen.is_over |= node.is_none() || seen.node.is_none() || seen.node == node;
                    }
                    let is_meant = known.services.iter().any(|name| name == service.name());
                    is_meant.then(|| (node, format!("NMT {} commanded", service.name())))
                }
                (EventKind::SdoTransfer(transfer), FactEvent::Write) => {
                    known.written(transfer).map(|text| (event.node, text))
                }
                (EventKind::CanError(_), FactEvent::CanError) => Some((None, "error frames on the bus".to_owned())),
                _ => None,
            };
            if let Some((node, text)) = seen {
                self.add(row, (event, bus), node, text, now);
            }
        }
    }

    fn add(&mut self, row: usize, (event, bus): (&Event, &Bus), node: Option<NodeId>, text: String, now: i64) {
        let mut known = self.0.iter_mut().rev();
        let known = known.find(|seen| (seen.row, seen.bus, seen.node) == (row, event.bus, node));
        if let Some(seen) = known.filter(|seen| now.saturating_sub(seen.now) <= BURST)
            && matches!(event.kind, EventKind::CanError(_))
        {
            seen.now = now;
            return;
        }
        if self.0.len() >= FACT_LIMIT {
            self.0.remove(0);
        }
        let name = node.and_then(|id| bus.node(id)).and_then(|node| node.name());
        let at = occurrence(event.time, event.frames);
        let next = causes().facts.get(row).map_or_else(|| "".into(), |row| row.next.as_str().into());
        let fact = Arc::new(FactCause { node, node_name: name.map(Arc::from), text, next, at });
        self.0.push(SeenFact { row, bus: event.bus, node, now, is_over: false, fact });
    }

    /// The last fact of a row, on a bus or about a node, not before `from`.
    pub(super) fn find(
        &self,
        name: &str,
        bus: BusIndex,
        node: Option<NodeId>,
        from: i64,
    ) -> Option<Arc<FactCause>> {
        let row = causes().facts.iter().position(|row| row.name == name)?;
        let is_meant = |seen: &&SeenFact| {
            seen.row == row && seen.bus == bus && seen.now >= from && !seen.is_over && is_about(seen, node)
        };
        self.0.iter().rev().find(is_meant).map(|found| Arc::clone(&found.fact))
    }

    /// A fact of a row up to `before` ns after `effect`, reported after its effect: the response to a write
    /// follows the effect of the write.
    pub(super) fn find_later(
        &self,
        name: &str,
        bus: BusIndex,
        node: Option<NodeId>,
        (effect, before): (Timestamp, i64),
    ) -> Option<Arc<FactCause>> {
        let row = causes().facts.iter().position(|row| row.name == name)?;
        let is_soon = |seen: &SeenFact| {
            seen.fact.at.time.is_some_and(|time| (0..=before).contains(&time.since(effect)))
        };
        let is_meant = |seen: &&SeenFact| {
            seen.row == row && seen.bus == bus && is_soon(seen) && is_about(seen, node)
        };
        self.0.iter().find(is_meant).map(|found| Arc::clone(&found.fact))
    }
}

fn is_about(seen: &SeenFact, node: Option<NodeId>) -> bool {
    node.is_none() || seen.node.is_none() || seen.node == node
}

impl FactRow {
    /// Whether the row stands for commands without a consumer.
    pub(super) fn is_no_consumer(&self) -> bool {
        self.event == FactEvent::NoConsumer
    }

    /// Text of a confirmed write to one of the objects: `1005:00 COB-ID SYNC = 40000080h written`.
    fn written(&self, transfer: &SdoTransfer) -> Option<String> {
        let object = transfer.object?;
        let is_write = transfer.direction == Some(Direction::Download) && transfer.outcome == Outcome::Complete;
        let is_meant = self.objects.iter().any(|[first, last]| (*first..=*last).contains(&object.index));
        let meaning = transfer.meaning.as_ref()?;
        let is_known = is_write && is_meant && !transfer.truncated && !transfer.data.is_empty();
        is_known.then(|| {
            let value = meaning.show(&meaning.decode(&transfer.data));
            format!("{object} {} = {value} written", meaning.name)
        })
    }
}
