//! Events and findings that trigger a capture.

use std::collections::{BTreeMap, BTreeSet};

use anyhow::Context as _;
use cobscope_decoder::event::{Event, EventKind, FindingNews, KindSet};
use cobscope_decoder::finding::{CAUSES, GROUP_LIMIT};
use cobscope_decoder::profile::Catalogue;
use cobscope_decoder::query::Filter;
use cobscope_decoder::rules::RuleSetup;
use cobscope_decoder::session::Bus;
use cobscope_decoder::sink::text::EventLine;

use super::arguments::TriggerArgs;
use crate::record::CaptureTrigger;
use crate::run::input::check_rules_in;

/// Maximum length of the text of a trigger, in characters.
const LONGEST_TEXT: usize = 500;

/// Checks the rules of the options.
///
/// # Errors
/// If a rule is unknown.
pub(super) fn check(arguments: &TriggerArgs, setup: &RuleSetup, catalogue: &Catalogue) -> anyhow::Result<()> {
    for filter in &arguments.trigger {
        check_rules_in(filter, setup, "--trigger")?;
    }
    for rule in &arguments.trigger_finding {
        setup.check_rule(rule, catalogue).map_err(anyhow::Error::msg).context("--trigger-finding")?;
    }
    Ok(())
}

/// The start of a finding.
struct FindingStart {
    first_frame: u64,
    cause: Option<u64>,
}

/// The triggers of the options, and those that were raised.
pub(super) struct LiveTriggers {
    /// Filters, each with the number of its events.
    filters: Vec<(Filter, u64)>,
    rules: BTreeSet<String>,
    /// Start of each finding by its number; there are at most [`GROUP_LIMIT`].
    findings: BTreeMap<u64, FindingStart>,
    /// Triggers since the last call of `raised`.
    raised: Vec<CaptureTrigger>,
}

impl LiveTriggers {
    pub(super) fn new(arguments: &TriggerArgs) -> Self {
        Self {
            filters: arguments.trigger.iter().map(|filter| (filter.clone(), 0)).collect(),
            rules: arguments.trigger_finding.iter().cloned().collect(),
            findings: BTreeMap::new(),
            raised: Vec::new(),
        }
    }

    /// Whether findings can be triggers.
    pub(super) fn needs_rules(&self) -> bool {
        let of_findings = |filter: &Filter| filter.kinds().and(KindSet::FINDINGS) != KindSet::NONE;
        !self.rules.is_empty() || self.filters.iter().any(|(filter, _)| of_findings(filter))
    }

    /// Raises a trigger if the event is one.
    pub(super) fn event(&mut self, event: &Event, bus: &Bus) {
        if let EventKind::FindingOpened(finding) = &event.kind {
            self.remember(finding.id, finding.cause, start(finding, event));
        }
        let mut is_trigger = matches!(&event.kind,
            EventKind::FindingOpened(finding) if self.rules.contains(&*finding.rule));
        for (filter, count) in &mut self.filters {
            if filter.matches_event(event, bus, None) {
                *count = count.saturating_add(1);
                is_trigger = true;
            }
        }
        if is_trigger {
            self.raised.push(self.trigger(event, bus));
        }
    }

    /// Removes and returns the triggers since the last call.
    pub(super) fn raised(&mut self) -> Vec<CaptureTrigger> {
        std::mem::take(&mut self.raised)
    }

    /// Notes on filters without an event, such as those with an unknown signal or object.
    pub(super) fn remarks(&self) -> Vec<String> {
        let unused = self.filters.iter().filter(|(_, count)| *count == 0);
        unused.map(|(filter, _)| format!("live: no event matched --trigger '{filter}'")).collect()
    }

    fn remember(&mut self, finding: u64, cause: Option<u64>, first_frame: u64) {
        self.findings.insert(finding, FindingStart { first_frame, cause });
        while self.findings.len() > GROUP_LIMIT {
            self.findings.pop_first();
        }
    }

    /// Number of the first frame of a finding and its causes.
    fn first_frame(&self, mut cause: Option<u64>, own: u64) -> u64 {
        let mut first = own;
        for _ in 0..CAUSES {
            let Some(start) = cause.and_then(|id| self.findings.get(&id)) else { break };
            first = first.min(start.first_frame);
            cause = start.cause;
        }
        first
    }

    fn trigger(&self, event: &Event, bus: &Bus) -> CaptureTrigger {
        let EventLine { who: subject, what, .. } = EventLine::describe_event(event, bus);
        let (cause, text, first_frame) = match &event.kind {
            EventKind::FindingOpened(finding) => {
                let first = self.first_frame(finding.cause, start(finding, event));
                (finding.rule.to_string(), finding.text.clone(), first)
            }
            kind => (kind.name().to_owned(), what, event.frames.first),
        };
        CaptureTrigger {
            bus: bus.name().to_owned(),
            node: event.node,
            subject,
            cause,
            text: text.chars().take(LONGEST_TEXT).collect(),
            time: event.time,
            first_frame,
            last_frame: event.frames.last,
        }
    }
}

/// First frame of a finding, or of the fact that is its cause.
fn start(finding: &FindingNews, event: &Event) -> u64 {
    finding.cause_frame.map_or(event.frames.first, |frame| frame.min(event.frames.first))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn triggers(filter: Option<&str>, rule: Option<&str>) -> LiveTriggers {
        LiveTriggers::new(&TriggerArgs {
            trigger: filter.iter().map(|filter| filter.parse().unwrap()).collect(),
            trigger_finding: rule.iter().map(|rule| (*rule).to_owned()).collect(),
            ..TriggerArgs::default()
        })
    }

    #[test]
    fn a_finding_starts_with_its_earliest_cause() {
        let mut triggers = triggers(None, Some("node-lost"));
        triggers.remember(1, None, 30);
        triggers.remember(2, Some(1), 20);
        assert_eq!(triggers.first_frame(Some(2), 40), 20);
        assert_eq!(triggers.first_frame(Some(1), 40), 30);
        assert_eq!(triggers.first_frame(Some(1), 10), 10);
        assert_eq!(triggers.first_frame(Some(99), 40), 40);
        // Findings can be causes of each other.
        triggers.remember(1, Some(2), 30);
        assert_eq!(triggers.first_frame(Some(1), 40), 20);
    }

    #[test]
    fn the_number_of_known_findings_is_limited() {
        let mut triggers = triggers(None, Some("node-lost"));
        (0..10_000).for_each(|id| triggers.remember(id, None, id));
        assert_eq!(triggers.findings.len(), GROUP_LIMIT);
        assert_eq!(triggers.first_frame(Some(9_999), 20_000), 9_999);
    }

    #[test]
    fn rules_run_only_if_a_trigger_needs_them() {
        assert!(triggers(None, Some("node-lost")).needs_rules());
        assert!(triggers(Some("rule == node-lost"), None).needs_rules());
        assert!(triggers(Some("node == 5"), None).needs_rules());
        assert!(!triggers(Some("kind == emcy && node == 5"), None).needs_rules());
        assert!(!triggers(None, None).needs_rules());
    }
}
