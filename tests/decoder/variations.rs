//! Replays every mutation on variations of its capture (`fixtures/rules/mutations/variations.toml`): the same
//! rules fire, no others.

#![expect(clippy::panic, reason = "a test that cannot go on has failed")]

use std::fmt::Write as _;
use std::fs;

use serde::Deserialize;

use crate::mutations::{Mutation, Table, tables, wrong};
use crate::mutator::{Dice, Line, apply, lines, micros};
use crate::support::{step, workspace};

/// Replays of each mutation on each variation with other amounts.
const ROUNDS: usize = 2;

/// Usual step between replays: about one for each mutation, on a variation that changes from row to row.
const STEP: usize = 11;

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Variations {
    variation: Vec<Variation>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Variation {
    operator: Operator,
    /// Largest amount.
    up_to: Option<String>,
    /// Capture on the second bus, below `fixtures/`.
    capture: Option<String>,
    /// Clean captures and profiles that the variation would concern.
    #[serde(default)]
    except: Vec<String>,
}

#[derive(Clone, Copy, Deserialize, PartialEq, Eq, Debug)]
#[serde(rename_all = "kebab-case")]
enum Operator {
    Clock,
    Jitter,
    SecondBus,
    UnknownMessages,
    Moved,
}

impl Variation {
    /// A random amount in µs; `span` is the length of the capture.
    fn amount(&self, dice: &mut Dice, span: i64) -> i64 {
        let up_to = self.up_to.as_deref().unwrap_or_else(|| panic!("{:?}: no up_to", self.operator));
        let most = match up_to.strip_suffix('%') {
            Some(share) => span * share.parse::<i64>().unwrap() / 100,
            None => micros(up_to),
        };
        i64::try_from(dice.roll(usize::try_from(most).unwrap())).unwrap() + 1
    }

    fn apply(&self, dice: &mut Dice, frames: &mut Vec<Line>) {
        let span = span(frames);
        match self.operator {
            Operator::Clock => {
                let by = self.amount(dice, span);
                for line in frames.iter_mut() {
                    line.time += by;
                }
            }
            Operator::Jitter => {
                for line in frames.iter_mut() {
                    line.time += self.amount(dice, span);
                }
                let mut latest = i64::MIN;
                for line in frames.iter_mut() {
                    latest = latest.max(line.time);
                    line.time = latest;
                }
            }
            Operator::SecondBus => {
                let file = self.capture.as_deref().unwrap_or_else(|| panic!("no capture"));
                let mut other = lines(&fs::read_to_string(workspace().join("fixtures").join(file)).unwrap());
                let by = frames[0].time - other[0].time;
                for line in &mut other {
                    line.time += by;
                    "can9".clone_into(&mut line.bus);
                }
                // The verdict on the other bus must not end with the capture.
                frames.append(&mut other);
                frames.sort_by_key(|line| line.time);
            }
            Operator::UnknownMessages => {
                let interval = self.amount(dice, span) + 10_000;
                let (begin, bus) = (frames[0].time, frames[0].bus.clone());
                let mut time = begin + interval;
                while time < begin + span {
                    let body = format!("{:016X}", dice.number());
                    frames.push(Line { time, bus: bus.clone(), id: "7C1".into(), body });
                    time += interval;
                }
                frames.sort_by_key(|line| line.time);
            }
            Operator::Moved => {}
        }
    }

    /// The steps of a mutation, at other times if the variation moves them.
    fn moved(&self, mutation: &Mutation, dice: &mut Dice, frames: &[Line]) -> Vec<String> {
        if self.operator != Operator::Moved {
            return mutation.steps.clone();
        }
        let (span, begin) = (span(frames), frames[0].time);
        let by = self.amount(dice, span);
        let moment = |word: &str| {
            let time = match word.strip_suffix('%') {
                Some(share) => begin + span * share.parse::<i64>().unwrap() / 100,
                None => begin + micros(word),
            };
            let since = time + by - begin;
            format!("{}.{:06}s", since / 1_000_000, since % 1_000_000)
        };
        let step = |step: &String| {
            let mut words: Vec<_> = step.split_whitespace().map(str::to_owned).collect();
            for place in 1..words.len() {
                if words[place - 1] == "at" {
                    words[place] = moment(&words[place]);
                }
            }
            words.join(" ")
        };
        mutation.steps.iter().map(step).collect()
    }
}

fn span(frames: &[Line]) -> i64 {
    frames.last().map_or(0, |last| last.time - frames[0].time)
}

fn variations() -> Vec<Variation> {
    let path = workspace().join("fixtures/rules/mutations/variations.toml");
    let text = fs::read_to_string(&path).unwrap();
    toml::from_str::<Variations>(&text)
        .unwrap_or_else(|error| panic!("{}: {error}", path.display()))
        .variation
}

fn replay(table: &Table, mutation: &Mutation, variation: &Variation, seed: u64) -> String {
    let (mut frames, known) = table.frames(mutation);
    let mut dice = Dice::new(seed);
    for step in variation.moved(mutation, &mut dice, &frames) {
        apply(&step, &mut frames);
    }
    variation.apply(&mut dice, &mut frames);
    wrong(mutation, &known, &frames)
}

#[test]
fn every_mutation_is_found_on_every_variation() {
    let (tables, variations) = (tables(), variations());
    let mut cases = Vec::new();
    for table in &tables {
        for mutation in table.mutation.iter().filter(|mutation| mutation.fixed.is_empty()) {
            for variation in &variations {
                if ![&mutation.capture, &table.profile].iter().any(|name| variation.except.contains(name)) {
                    cases.extend([(table, mutation, variation); ROUNDS]);
                }
            }
        }
    }
    let mut report = String::new();
    for (seed, (table, mutation, variation)) in (1..).zip(cases).step_by(step(STEP)) {
        let wrong = replay(table, mutation, variation, seed);
        if !wrong.is_empty() {
            write!(report, "{:?} {seed}: {wrong}", variation.operator).unwrap();
        }
    }
    assert!(report.is_empty(), "\n{report}");
}
