//! Expectations: rules of the user, `[[expect]]` in the bus file.
//!
//! ```text
//! bus_file::Expectation ─compile─▶ Expectation ─make, once per bus─▶ Scoped<Task of its kind> : Rule
//! ```
//!
//! A [`Task`] checks one kind of expectation; each kind has its own file. [`ScopedTask`] filters events of other
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
use self::plan::Plan;
use self::task::Task;
use super::{Context, Rule};
use crate::bus_file;
use crate::event::{Event, EventKind, KindSet};
use crate::finding::{Merge, RuleInfo, RuleOrigin};
use crate::profile::TextError;
use crate::wire::NodeId;

/// KIND column of findings of all expectations.
const WORD: &str = "EXPECT";

/// A compiled expectation.
#[derive(Debug, Clone)]
pub struct Expectation {
    info: RuleInfo,
    bus: Option<String>,
    node: Option<NodeId>,
    is_per_node: bool,
    kinds: KindSet,
    plan: Arc<Plan>,
}

impl Expectation {
    /// Compiles an expectation of the bus file; `text` is the source of the file.
    ///
    /// # Errors
    /// An invalid expression, or an expression without possible matches, with its position in `text`.
    pub(in crate::rules) fn compile(written: &bus_file::Expectation, text: &str) -> Result<Self, TextError> {
        let plan = Plan::of(&written.demand, text)?;
        Ok(Self {
            info: info(written, &plan),
            bus: written.bus.clone(),
            node: written.node,
            is_per_node: written.is_per_node,
            kinds: plan.kinds(),
            plan: Arc::new(plan),
        })
    }

    /// Description of the expectation as a rule.
    pub fn info(&self) -> &RuleInfo {
        &self.info
    }

    /// Event kinds that the expectation needs.
    pub fn kinds(&self) -> KindSet {
        self.kinds
    }

    /// Name of the bus if the expectation is limited to one.
    pub(super) fn bus(&self) -> Option<&str> {
        self.bus.as_deref()
    }

    /// Whether the expectation applies to the bus of this name.
    pub(super) fn is_about(&self, bus: &str) -> bool {
        self.bus.as_deref().is_none_or(|own| own == bus)
    }

    /// Creates the rule for one bus, in its initial state.
    pub(super) fn make(&self) -> Box<dyn Rule> {
        let apart = self.is_per_node;
        match &*self.plan {
            Plan::Always { when, expect } => self.scoped(each::always(when, expect)),
            Plan::Never { when } => self.scoped(each::never(when)),
            Plan::Within { when, expect, time } => self.scoped(within::new(when, expect, *time, apart)),
            Plan::Every { when, period, tolerance } => {
                self.scoped(every::new(when, *period, *tolerance, apart))
            }
            Plan::Count { when, limits, window: None } => self.scoped(count::new(when, *limits, apart)),
            Plan::Count { when, limits, window: Some(window) } => {
                self.scoped(window::new(when, *limits, *window, apart))
            }
            Plan::Order { steps, time } => self.scoped(order::new(steps, *time, apart)),
            Plan::Bounds { signal, when, limits } => self.scoped(bounds::new(signal, when.as_ref(), *limits)),
            Plan::Rate { signal, when, max } => self.scoped(rate::new(signal, when.as_ref(), *max)),
        }
    }

    fn scoped<T: Task + 'static>(&self, task: T) -> Box<dyn Rule> {
        Box::new(ScopedTask { node: self.node, named: RequiredNames::of(&self.plan, self.node), task })
    }
}

fn info(written: &bus_file::Expectation, plan: &Plan) -> RuleInfo {
    let title = plan.to_string();
    let reason = &written.reason;
    let explanation =
        format!("# What it checks\n{title}\n\n# Why it matters\n{reason}\n\n# Source\nthe bus file\n");
    RuleInfo {
        name: written.id.text.as_str().into(),
        severity: written.severity,
        title: title.into(),
        explanation: explanation.into(),
        needs: "events that match it".into(),
        cases: Vec::new(),
        shows: Vec::new(),
        origin: RuleOrigin::Expectation,
        is_timing: plan.is_timing(),
        merge: Merge::Subject,
        is_on: true,
        word: WORD,
        source: Some(Arc::clone(reason)),
        next_step: None,
    }
}

/// A task, limited to one node if set.
struct ScopedTask<T> {
    node: Option<NodeId>,
    named: RequiredNames,
    task: T,
}

impl<T: Task> Rule for ScopedTask<T> {
    #[inline]
    fn event(&mut self, event: &Event, context: &mut Context<'_>) {
        if matches!(event.kind, EventKind::BusSilent { .. } | EventKind::ClockStep { .. }) {
            self.task.interrupt(context);
        }
        if self.node.is_none() || event.node == self.node {
            self.named.saw(event, context);
            self.task.event(event, context);
        }
    }

    fn wake(&mut self, token: u64, context: &mut Context<'_>) {
        self.task.wake(token, context);
    }

    fn finish(&mut self, context: &mut Context<'_>) {
        let unknown = self.named.unknown(context.bus);
        self.task.finish(unknown.is_empty(), context);
        context.unexercised(if unknown.is_empty() { self.task.idle() } else { unknown.join(", ") });
    }
}
