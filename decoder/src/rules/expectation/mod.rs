//! Expectations: rules as expressions on events, `[[expect]]` in bus files and profiles.
//!
//! ```text
//! ExpectEntry ─compile─▶ CompiledExpectation ─once per bus─▶ ScopedTask<task of its kind> : Rule
//! ```
//!
//! A [`ExpectationTask`] checks one kind of expectation; each kind has its own file. [`ScopedTask`] filters events of other
//! nodes, and reports at the end the signals and nodes of the expectation that never occurred.

mod bounds;
mod count;
mod deadline;
mod each;
mod every;
mod moment;
mod named;
mod nearest;
mod order;
mod plan;
mod quoted;
mod rate;
mod signal;
mod subjects;
mod task;
mod window;
mod within;
mod words;

use std::sync::Arc;

use self::named::RequiredNames;
use self::plan::ExpectationPlan;
use self::task::ExpectationTask;
use super::{Rule, RuleContext};
use crate::event::{Event, EventKind, KindSet};
use crate::finding::{MergedFindings, RuleInfo, RuleOrigin};
use crate::profile::{ExpectEntry, TextError};
use crate::session::Bus;
use crate::wire::NodeId;

/// KIND column of findings of all expectations.
const WORD: &str = "EXPECT";

/// Nodes that an expectation is about.
#[derive(Debug, Clone)]
struct NodeScope {
    node: Option<NodeId>,
    /// Id of a profile that is assigned to the nodes.
    profile: Option<Arc<str>>,
}

impl NodeScope {
    #[inline]
    fn contains_node(&self, node: Option<NodeId>, bus: &Bus) -> bool {
        match &self.profile {
            None => self.node.is_none() || node == self.node,
            Some(profile) => node
                .and_then(|id| bus.node(id))
                .is_some_and(|node| node.assigned_by().is_some() && node.device().id == **profile),
        }
    }
}

/// A compiled expectation.
#[derive(Debug, Clone)]
pub struct CompiledExpectation {
    info: RuleInfo,
    bus: Option<String>,
    scope: NodeScope,
    is_per_node: bool,
    kinds: KindSet,
    plan: Arc<ExpectationPlan>,
}

impl CompiledExpectation {
    /// Compiles an expectation of a bus file or profile; `text` is the source of the file.
    ///
    /// # Errors
    /// An invalid expression, or an expression without possible matches, with its position in `text`.
    pub(in crate::rules) fn compile_entry(written: &ExpectEntry, text: &str) -> Result<Self, TextError> {
        let plan = ExpectationPlan::plan_for(&written.demand, text)?;
        Ok(Self {
            info: rule_info(written, &plan.to_string(), plan.is_timing()),
            bus: written.bus.clone(),
            scope: NodeScope { node: written.node, profile: written.profile.clone() },
            is_per_node: written.is_per_node,
            kinds: plan.needed_kinds(),
            plan: Arc::new(plan),
        })
    }

    /// Description of an expectation of a profile that cannot be compiled.
    pub(in crate::rules) fn broken_info(written: &ExpectEntry) -> RuleInfo {
        rule_info(written, &format!("invalid expectation {}", written.id.text), false)
    }

    /// Description of the expectation as a rule.
    pub fn rule_info(&self) -> &RuleInfo {
        &self.info
    }

    /// Event kinds that the expectation needs.
    pub fn needed_kinds(&self) -> KindSet {
        self.kinds
    }

    /// Name of the bus if the expectation is limited to one.
    pub(super) fn bus_name(&self) -> Option<&str> {
        self.bus.as_deref()
    }

    /// Whether the expectation applies to the bus of this name.
    pub(super) fn is_about(&self, bus: &str) -> bool {
        self.bus.as_deref().is_none_or(|own| own == bus)
    }

    /// Creates the rule for one bus, in its initial state.
    pub(super) fn build_rule(&self) -> Box<dyn Rule> {
        let apart = self.is_per_node;
        match &*self.plan {
            ExpectationPlan::Always { when, expect } => self.scope_task(each::always_task(when, expect)),
            ExpectationPlan::Never { when } => self.scope_task(each::never_task(when)),
            ExpectationPlan::Within { when, expect, time } => {
                self.scope_task(within::new(when, expect, *time, apart))
            }
            ExpectationPlan::Every { when, period, tolerance } => {
                self.scope_task(every::new(when, *period, *tolerance, apart))
            }
            ExpectationPlan::Count { when, limits, window: None } => {
                self.scope_task(count::new(when, *limits, apart))
            }
            ExpectationPlan::Count { when, limits, window: Some(window) } => {
                self.scope_task(window::new(when, *limits, *window, apart))
            }
            ExpectationPlan::Order { steps, time } => self.scope_task(order::new(steps, *time, apart)),
            ExpectationPlan::Bounds { signal, when, limits } => {
                self.scope_task(bounds::new(signal, when.as_ref(), *limits))
            }
            ExpectationPlan::Rate { signal, when, max } => {
                self.scope_task(rate::new(signal, when.as_ref(), *max))
            }
        }
    }

    fn scope_task<T: ExpectationTask + 'static>(&self, task: T) -> Box<dyn Rule> {
        let named = RequiredNames::names_of(&self.plan, self.scope.node);
        Box::new(ScopedTask { scope: self.scope.clone(), named, task })
    }
}

fn rule_info(written: &ExpectEntry, title: &str, is_timing: bool) -> RuleInfo {
    let reason = &written.reason;
    let id = &written.id.text;
    let (name, source) = match &written.profile {
        Some(profile) => (format!("{profile}:{id}"), format!("profile {profile}")),
        None => (id.clone(), "the bus file".to_owned()),
    };
    let explanation =
        format!("# What it checks\n{title}\n\n# Why it matters\n{reason}\n\n# Source\n{source}\n");
    RuleInfo {
        name: name.into(),
        severity: written.severity,
        title: title.into(),
        explanation: explanation.into(),
        needs: "events that match it".into(),
        cases: Vec::new(),
        shows: Vec::new(),
        origin: RuleOrigin::Expectation,
        is_timing,
        merge: MergedFindings::Subject,
        is_on: true,
        word: WORD,
        source: Some(Arc::clone(reason)),
        next_step: None,
    }
}

/// A task about the nodes of a scope.
struct ScopedTask<T> {
    scope: NodeScope,
    named: RequiredNames,
    task: T,
}

impl<T: ExpectationTask> Rule for ScopedTask<T> {
    #[inline]
    fn on_event(&mut self, event: &Event, context: &mut RuleContext<'_>) {
        if matches!(event.kind, EventKind::BusSilent { .. } | EventKind::ClockStep { .. }) {
            self.task.on_gap(context);
        }
        if self.scope.contains_node(event.node, context.bus) {
            self.named.on_layout(event, context);
            self.task.on_event(event, context);
        }
    }

    fn on_wake(&mut self, token: u64, context: &mut RuleContext<'_>) {
        self.task.on_wake(token, context);
    }

    fn on_end(&mut self, context: &mut RuleContext<'_>) {
        let unknown = self.named.unknown_texts(context.bus);
        self.task.on_end(unknown.is_empty(), context);
        context.note_unexercised(if unknown.is_empty() {
            self.task.idle_reason()
        } else {
            unknown.join(", ")
        });
    }
}
