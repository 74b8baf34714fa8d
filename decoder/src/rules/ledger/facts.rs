//! Facts that can be the cause of a finding: commands and writes that no rule judges.

use std::sync::Arc;

use super::causes::cause_table;
use super::fact_row::FactEvent;
use crate::event::{Event, EventKind};
use crate::finding::{FactCause, Occurrence};
use crate::frame::{BusIndex, Timestamp};
use crate::session::Bus;
use crate::wire::NodeId;

/// Maximum number of facts of a capture.
const FACT_LIMIT: usize = 256;

/// Error frames within this time are one fact, in ns.
const BURST: i64 = 1_000_000_000;

/// A fact on a bus, about a node.
#[derive(Debug, Clone)]
struct KnownFact {
    row: usize,
    bus: BusIndex,
    node: Option<NodeId>,
    now: i64,
    /// A later command replaced the state that this one set.
    is_over: bool,
    fact: Arc<FactCause>,
}

/// Facts of a capture.
#[derive(Debug, Clone, Default)]
pub(super) struct LedgerFacts(Vec<KnownFact>);

impl LedgerFacts {
    /// Records an event if a row names it.
    pub(super) fn observe_event(&mut self, event: &Event, bus: &Bus, now: i64) {
        for (row, known) in cause_table().facts.iter().enumerate() {
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
                    known.write_text(transfer).map(|text| (event.node, text))
                }
                (EventKind::CanError(error), FactEvent::CanError)
                    if !error.is_only_receive_overflow() && !error.is_only_counters() =>
                {
                    Some((None, "error frames on the bus".to_owned()))
                }
                _ => None,
            };
            if let Some((node, text)) = seen {
                self.add_fact(row, (event, bus), node, text, now);
            }
        }
    }

    fn add_fact(
        &mut self,
        row: usize,
        (event, bus): (&Event, &Bus),
        node: Option<NodeId>,
        text: String,
        now: i64,
    ) {
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
        let at = Occurrence { time: event.time, frames: event.frames };
        let next = cause_table().facts.get(row).map_or_else(|| "".into(), |row| row.next.as_str().into());
        let fact = Arc::new(FactCause { node, node_name: name.map(Arc::from), text, next, at });
        self.0.push(KnownFact { row, bus: event.bus, node, now, is_over: false, fact });
    }

    /// The last fact of a row, on a bus or about a node, not before `from`.
    pub(super) fn find_fact(
        &self,
        name: &str,
        bus: BusIndex,
        node: Option<NodeId>,
        from: i64,
    ) -> Option<Arc<FactCause>> {
        let row = cause_table().facts.iter().position(|row| row.name == name)?;
        let is_meant = |seen: &&KnownFact| {
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
        let row = cause_table().facts.iter().position(|row| row.name == name)?;
        let is_soon = |seen: &KnownFact| {
            seen.fact.at.time.is_some_and(|time| (0..=before).contains(&time.since(effect)))
        };
        let is_meant =
            |seen: &&KnownFact| seen.row == row && seen.bus == bus && is_soon(seen) && is_about(seen, node);
        self.0.iter().find(is_meant).map(|found| Arc::clone(&found.fact))
    }
}

fn is_about(seen: &KnownFact, node: Option<NodeId>) -> bool {
    node.is_none() || seen.node.is_none() || seen.node == node
}
