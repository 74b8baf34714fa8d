//! A fleet: verdicts and stories of many captures, by machine and week.

use std::collections::{BTreeMap, BTreeSet};

use jiff::civil::{Date, Weekday};

use crate::finding::Severity;
use crate::sink::findings::CaptureOutcome;

/// Maximum number of weeks, the latest ones.
const MOST_WEEKS: usize = 53;

/// Maximum number of kinds of stories in the list.
const MOST_KINDS: usize = 20;

/// A story of a capture.
#[derive(Debug, Clone, PartialEq)]
pub struct FleetStory {
    /// Rule of its first finding.
    pub rule: String,
    /// Node of the cause, such as `5/05 valve`; empty for the bus.
    pub node: String,
    /// Cause, or first effect.
    pub title: String,
    /// Highest severity of its findings.
    pub severity: Severity,
    /// Weight; stories are in descending order of it.
    pub rank: f64,
}

/// A capture of the fleet.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct FleetCapture {
    /// Name of the machine.
    pub machine: String,
    /// Name of the capture.
    pub capture: String,
    /// Day of its first frame, UTC; `None` without a date.
    pub day: Option<Date>,
    /// Frames read.
    pub frames: u64,
    /// Overall result.
    pub verdict: CaptureOutcome,
    /// Reason why it was not read, or not to its end.
    pub failure: Option<String>,
    /// Stories, most important first.
    pub stories: Vec<FleetStory>,
}

/// Captures of a machine in a week.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct WeekCell {
    /// Number of captures.
    pub captures: usize,
    /// Number of those that failed.
    pub failed: usize,
    /// Number of those that are unreadable or incomplete.
    pub unreadable: usize,
}

/// A machine with its captures.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct FleetMachine {
    /// Name.
    pub name: String,
    /// Cells by week, in the order of [`Fleet::weeks`].
    pub weeks: Vec<WeekCell>,
    /// Captures with stories or a failure, by day.
    pub captures: Vec<FleetCapture>,
}

/// Stories with the same rule and node, over all captures.
#[derive(Debug, Clone, PartialEq)]
pub struct StoryKind {
    /// Rule of the first finding.
    pub rule: String,
    /// Node of the cause.
    pub node: String,
    /// Highest severity.
    pub severity: Severity,
    /// Title of the first one.
    pub example: String,
    /// Number of captures with such a story.
    pub captures: usize,
    /// Machines.
    pub machines: BTreeSet<String>,
    /// First and last day.
    pub days: Option<(Date, Date)>,
    weight: f64,
}

/// All captures, by machine and week.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Fleet {
    /// Mondays of the weeks; `None` for captures without a date.
    pub weeks: Vec<Option<Date>>,
    /// Machines by name.
    pub machines: Vec<FleetMachine>,
    /// Kinds of stories, worst first, at most 20.
    pub kinds: Vec<StoryKind>,
    /// Number of captures.
    pub captures: usize,
    /// Number of kinds of stories that are not listed.
    pub further_kinds: usize,
    /// Captures of earlier weeks, which are not counted in the weeks.
    pub earlier: usize,
}

impl Fleet {
    /// Sorts captures by machine and week.
    pub fn sort_captures(mut captures: Vec<FleetCapture>) -> Self {
        captures.sort_by(|one, other| {
            let key = |it: &FleetCapture| (it.machine.clone(), it.day, it.capture.clone());
            key(one).cmp(&key(other))
        });
        let all: BTreeSet<Option<Date>> = captures.iter().map(|capture| week_of(capture.day)).collect();
        let skipped = all.len().saturating_sub(MOST_WEEKS);
        let weeks: Vec<_> = all.into_iter().skip(skipped).collect();
        let mut fleet = Self { captures: captures.len(), weeks, ..Self::default() };
        let mut kinds: BTreeMap<(String, String), StoryKind> = BTreeMap::new();
        for capture in captures {
            for story in &capture.stories {
                let key = (story.rule.clone(), story.node.clone());
                kinds.entry(key).or_insert_with(|| StoryKind::new(story)).add_story(story, &capture);
            }
            fleet.add_capture(capture);
        }
        let mut kinds: Vec<_> = kinds.into_values().collect();
        kinds.sort_by(|one, other| {
            other.severity.cmp(&one.severity).then(other.weight.total_cmp(&one.weight))
        });
        fleet.further_kinds = kinds.len().saturating_sub(MOST_KINDS);
        kinds.truncate(MOST_KINDS);
        fleet.kinds = kinds;
        fleet
    }

    /// Adds a capture; those of a machine follow each other.
    fn add_capture(&mut self, capture: FleetCapture) {
        if self.machines.last().is_none_or(|machine| machine.name != capture.machine) {
            let weeks = vec![WeekCell::default(); self.weeks.len()];
            let name = capture.machine.clone();
            self.machines.push(FleetMachine { name, weeks, captures: Vec::new() });
        }
        let Some(machine) = self.machines.last_mut() else { return };
        let week = self.weeks.binary_search(&week_of(capture.day)).ok();
        match week.and_then(|week| machine.weeks.get_mut(week)) {
            Some(cell) => {
                cell.captures += 1;
                cell.failed += usize::from(capture.verdict == CaptureOutcome::Failed);
                cell.unreadable += usize::from(capture.failure.is_some());
            }
            None => self.earlier += 1,
        }
        if !capture.stories.is_empty() || capture.failure.is_some() {
            machine.captures.push(capture);
        }
    }
}

impl StoryKind {
    fn new(story: &FleetStory) -> Self {
        Self {
            rule: story.rule.clone(),
            node: story.node.clone(),
            severity: story.severity,
            example: story.title.clone(),
            captures: 0,
            machines: BTreeSet::new(),
            days: None,
            weight: 0.0,
        }
    }

    fn add_story(&mut self, story: &FleetStory, capture: &FleetCapture) {
        self.severity = self.severity.max(story.severity);
        self.captures += 1;
        self.weight += story.rank;
        self.machines.insert(capture.machine.clone());
        if let Some(day) = capture.day {
            let (first, last) = self.days.unwrap_or((day, day));
            self.days = Some((first.min(day), last.max(day)));
        }
    }
}

/// Monday of the week of a day (ISO 8601).
fn week_of(day: Option<Date>) -> Option<Date> {
    let day = day?;
    let since = i64::from(day.weekday().since(Weekday::Monday));
    day.checked_sub(jiff::Span::new().days(since)).ok()
}

#[cfg(test)]
mod tests {
    use jiff::civil::date;

    use super::*;

    fn capture(machine: &str, day: Option<Date>, story: Option<(&str, Severity)>) -> FleetCapture {
        let story = story.map(|(rule, severity)| FleetStory {
            rule: rule.to_owned(),
            node: "5/05".to_owned(),
            title: format!("{rule} {{1}}"),
            severity,
            rank: 1.0,
        });
        let is_failure = story.as_ref().is_some_and(|it| it.severity == Severity::Error);
        let verdict = if is_failure { CaptureOutcome::Failed } else { CaptureOutcome::Passed };
        FleetCapture {
            machine: machine.to_owned(),
            capture: "a.log".to_owned(),
            day,
            verdict,
            stories: story.into_iter().collect(),
            ..FleetCapture::default()
        }
    }

    /// 2024-01-01 is a Monday, 2024-01-07 the Sunday of its week.
    #[test]
    fn captures_are_counted_by_machine_and_week() {
        let lost = Some(("node-lost", Severity::Error));
        let fleet = Fleet::sort_captures(vec![
            capture("b", Some(date(2024, 1, 8)), lost),
            capture("a", Some(date(2024, 1, 7)), Some(("emcy-raised", Severity::Warning))),
            capture("b", Some(date(2024, 1, 1)), lost),
            capture("b", Some(date(2024, 1, 7)), None),
            FleetCapture {
                failure: Some("empty".to_owned()),
                verdict: CaptureOutcome::Unreadable,
                ..capture("a", None, None)
            },
        ]);
        assert_eq!(fleet.weeks, [None, Some(date(2024, 1, 1)), Some(date(2024, 1, 8))]);
        let cells = |machine: usize| -> Vec<_> {
            fleet.machines[machine].weeks.iter().map(|it| (it.captures, it.failed, it.unreadable)).collect()
        };
        assert_eq!(cells(0), [(1, 0, 1), (1, 0, 0), (0, 0, 0)]);
        assert_eq!(cells(1), [(0, 0, 0), (2, 1, 0), (1, 1, 0)]);
        assert_eq!(fleet.machines[1].captures.len(), 2);
        let kinds: Vec<_> = fleet.kinds.iter().map(|it| (it.rule.as_str(), it.captures)).collect();
        assert_eq!(kinds, [("node-lost", 2), ("emcy-raised", 1)]);
        assert_eq!(fleet.kinds[0].days, Some((date(2024, 1, 1), date(2024, 1, 8))));
    }

    #[test]
    fn only_the_latest_weeks_are_columns() {
        let first = date(2020, 1, 6);
        let weeks =
            (0..60).map(|week| capture("a", first.checked_add(jiff::Span::new().weeks(week)).ok(), None));
        let fleet = Fleet::sort_captures(weeks.collect());
        assert_eq!((fleet.weeks.len(), fleet.earlier, fleet.captures), (53, 7, 60));
    }
}
