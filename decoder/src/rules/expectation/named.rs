//! Names in an expectation: signals and nodes that never occur are probably misspelt.

use super::nearest::NearestName;
use super::plan::ExpectationPlan;
use super::signal::{LayoutTable, SignalReference};
use crate::event::Event;
use crate::query::Filter;
use crate::rules::RuleContext;
use crate::session::Bus;
use crate::wire::NodeId;

/// Names that must occur for any match.
#[derive(Debug)]
pub(super) struct RequiredNames {
    /// Signals that have not occurred yet.
    signals: Vec<(SignalReference, NearestName)>,
    messages: LayoutTable<()>,
    /// Required nodes; each entry lists alternative identifiers.
    nodes: Vec<Vec<NodeId>>,
    node_names: Vec<String>,
}

impl RequiredNames {
    pub(super) fn names_of(plan: &ExpectationPlan, node: Option<NodeId>) -> Self {
        let mut named = Self {
            signals: Vec::new(),
            messages: LayoutTable::default(),
            nodes: node.into_iter().map(|node| vec![node]).collect(),
            node_names: Vec::new(),
        };
        for filter in plan.conditions() {
            named.take_names(filter);
        }
        named
    }

    fn take_names(&mut self, filter: &Filter) {
        let objects = filter.required_values("signals.id").into_iter().map(SignalReference::parse_reference);
        let names =
            filter.required_values("signals.name").into_iter().map(|name| SignalReference::Name(name.into()));
        let numbers = filter
            .required_values("signals.spn")
            .into_iter()
            .filter_map(parse_number)
            .map(SignalReference::Spn);
        self.signals.extend(objects.chain(names).chain(numbers).map(|name| (name, NearestName::default())));
        for id in filter.required_values("node").into_iter().filter_map(parse_number) {
            let id = u8::try_from(id).unwrap_or(u8::MAX);
            self.nodes.push(vec![NodeId::Canopen(id), NodeId::J1939(id)]);
        }
        self.node_names.extend(filter.required_values("node_name").into_iter().map(str::to_owned));
    }

    /// Removes the signals that a new layout contains.
    #[inline]
    pub(super) fn on_layout(&mut self, event: &Event, context: &RuleContext<'_>) {
        if self.signals.is_empty() {
            return;
        }
        let signals = &mut self.signals;
        self.messages.layout_for(event, context, |layout, ()| {
            signals.retain(|(name, _)| !layout.fields.iter().any(|field| name.is_field(field)));
            for (name, nearest) in signals.iter() {
                nearest.see_all(&name.to_string(), layout);
            }
        });
    }

    /// Messages about names that did not occur on this bus.
    pub(super) fn unknown_texts(&self, bus: &Bus) -> Vec<String> {
        let signals = self.signals.iter();
        let signals =
            signals.map(|(name, nearest)| format!("signal '{name}' did not occur{}", nearest.hint_text()));
        let is_received = |id: &NodeId| bus.node(*id).is_some_and(|node| node.last_seen().0 > 0);
        let nodes = self.nodes.iter().filter(|ids| !ids.iter().any(is_received));
        let nodes = nodes.filter_map(|ids| Some(format!("{} sent no frame", ids.first()?.sentence_label())));
        let has_name = |name: &str| bus.nodes().any(|node| node.name() == Some(name));
        let names = self.node_names.iter().filter(|name| !has_name(name));
        let names = names.map(|name| {
            let nearest = NearestName::default();
            bus.nodes().filter_map(|node| node.name()).for_each(|known| nearest.compare_name(name, known));
            format!("unknown node name '{name}'{}", nearest.hint_text())
        });
        signals.chain(nodes).chain(names).collect()
    }
}

/// Number in filter notation, decimal or `0x` hexadecimal.
fn parse_number(text: &str) -> Option<u32> {
    match text.strip_prefix("0x").or_else(|| text.strip_prefix("0X")) {
        Some(digits) => u32::from_str_radix(digits, 16).ok(),
        None => text.parse().ok(),
    }
}
