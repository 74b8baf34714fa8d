//! Filters that select events.
//!
//! The language is that of Wireshark's display filters: `== != < <= > >=`, `in {…}`, `contains`,
//! `matches`, `&& || ! ()`, and the words `and or not eq ne lt le gt ge`. A field name alone matches if the
//! event has the field. [`super::fields`] defines the fields and their names.
//!
//! * A comparison with a missing or null field is false, also with `!=`.
//! * A list field (`frames`, `signals.id`) matches if one of its values does, also with `!=`.
//! * `matches` takes a regular expression, not anchored and, as in Wireshark, not case-sensitive unless it
//!   starts with `(?-i)`. `contains` and `==` are exact.
//! * Numbers are decimal, or hexadecimal with `0x`. Codes and identifiers require the `0x`.

use std::fmt;
use std::str::FromStr;
use std::sync::Arc;

use super::compile::{CompiledFilter, FieldTest, FilterNode, NameSet, compile_filter};
use super::error::FilterError;
use super::expression::Expression;
use super::fields::resolve_name;
use super::parser::parse_filter;
use super::record::{self, FieldConsumer, FieldValue};
use crate::event::{Event, KindSet};
use crate::session::Bus;

pub use super::compile::MAX_TESTS;

/// Max nesting depth of lists and groups.
const MAX_NESTING: usize = 4;

/// Tests per word of [`TestHits`].
const WORD: usize = 64;

/// A compiled filter; cheap to clone. `Display` prints an equivalent filter.
#[derive(Debug, Clone)]
pub struct Filter(Arc<SharedFilter>);

#[derive(Debug)]
struct SharedFilter {
    written: Expression,
    compiled: CompiledFilter,
}

impl Filter {
    /// Whether the filter matches the event; `capture` is its name in the output.
    pub fn matches_event(&self, event: &Event, bus: &Bus, capture: Option<&str>) -> bool {
        let CompiledFilter { tree, tests, may, must, needs_details, needs_signals, names } = &self.0.compiled;
        if !may.contains(&event.kind) || must.contains(&event.kind) {
            return may.contains(&event.kind);
        }
        let hits = TestHits([0; MAX_TESTS / WORD]);
        let mut search = FieldSearch {
            tests,
            names: *names,
            needs_signals: *needs_signals,
            hits,
            path: [""; MAX_NESTING],
            depth: 0,
        };
        record::visit_envelope(event, bus, capture, &mut search);
        // Skips the fields that depend on the kind if the common ones decide.
        if let Some(answer) = search.hits.answer_of_common(tree, tests).filter(|_| *needs_details) {
            return answer;
        }
        if *needs_details {
            record::visit_details(event, bus, &mut search);
        }
        search.hits.is_fulfilled(tree)
    }

    /// Whether the filter matches a frame: by the fields of the message that it contains, and by the fields
    /// of the frame itself (`id`, `data`, `size`, `remote` …).
    pub fn matches_frame(&self, message: &Event, frame: &Event, bus: &Bus) -> bool {
        let CompiledFilter { tree, tests, needs_signals, names, .. } = &self.0.compiled;
        let mut search = FieldSearch {
            tests,
            names: *names,
            needs_signals: *needs_signals,
            hits: TestHits([0; MAX_TESTS / WORD]),
            path: [""; MAX_NESTING],
            depth: 0,
        };
        record::visit_envelope(message, bus, None, &mut search);
        record::visit_details(message, bus, &mut search);
        if message.kind.name() != frame.kind.name() {
            record::visit_details(frame, bus, &mut search);
        }
        search.hits.is_fulfilled(tree)
    }

    /// Event kinds that the filter can match.
    pub fn kinds(&self) -> KindSet {
        self.0.compiled.may
    }

    /// Whether a test uses the field `key`.
    pub fn uses_field(&self, key: &str) -> bool {
        self.0.compiled.tests.iter().any(|test| test.keys().any(|asked| asked == key))
    }

    /// Values, as written, that the field must have for the filter to match.
    pub fn required_values(&self, key: &str) -> Vec<&str> {
        let mut found = Vec::new();
        self.0.written.collect_required(&|name| is_name_of(name, key), &mut found);
        found
    }

    /// Values, as written, that the field is compared with by `==`, `!=` or `in` anywhere in the filter.
    pub fn compared_with(&self, key: &str) -> Vec<&str> {
        let mut found = Vec::new();
        self.0.written.collect_compared(&|name| is_name_of(name, key), &mut found);
        found
    }
}

/// Whether `name` in a filter can refer to the field `key`.
fn is_name_of(name: &str, key: &str) -> bool {
    resolve_name(name).iter().any(|target| target.field.key == key)
}

/// Compares the syntax, not the meaning.
impl PartialEq for Filter {
    fn eq(&self, other: &Self) -> bool {
        self.0.written == other.0.written
    }
}

impl FromStr for Filter {
    type Err = FilterError;

    fn from_str(text: &str) -> Result<Self, FilterError> {
        let written = parse_filter(text)?;
        let compiled = compile_filter(text, &written)?;
        Ok(Self(Arc::new(SharedFilter { written, compiled })))
    }
}

impl fmt::Display for Filter {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.0.written.fmt(f)
    }
}

/// Bit set of the tests that succeeded.
struct TestHits([u64; MAX_TESTS / WORD]);

impl TestHits {
    fn add_test(&mut self, test: usize) {
        if let Some(word) = self.0.get_mut(test / WORD) {
            *word |= 1 << (test % WORD);
        }
    }

    fn has_test(&self, test: usize) -> bool {
        self.0.get(test / WORD).is_some_and(|word| word >> (test % WORD) & 1 == 1)
    }

    /// Result, if tests on fields of every kind decide it; `None` if other tests are needed.
    fn answer_of_common(&self, node: &FilterNode, tests: &[FieldTest]) -> Option<bool> {
        let parts = |parts: &[FilterNode], decides: bool| {
            let mut answers = parts.iter().map(|part| self.answer_of_common(part, tests));
            answers
                .try_fold(Some(!decides), |all, answer| match answer {
                    Some(answer) if answer == decides => Err(()),
                    Some(_) => Ok(all),
                    None => Ok(None),
                })
                .unwrap_or(Some(decides))
        };
        match node {
            FilterNode::And(all) => parts(all, false),
            FilterNode::Or(any) => parts(any, true),
            FilterNode::Not(inner) => self.answer_of_common(inner, tests).map(|answer| !answer),
            FilterNode::Test(test) => tests.get(*test)?.is_common().then(|| self.has_test(*test)),
        }
    }

    fn is_fulfilled(&self, node: &FilterNode) -> bool {
        match node {
            FilterNode::And(parts) => parts.iter().all(|part| self.is_fulfilled(part)),
            FilterNode::Or(parts) => parts.iter().any(|part| self.is_fulfilled(part)),
            FilterNode::Not(inner) => !self.is_fulfilled(inner),
            FilterNode::Test(test) => self.has_test(*test),
        }
    }
}

/// Compares the fields of an event with the tests.
struct FieldSearch<'a> {
    tests: &'a [FieldTest],
    names: NameSet,
    needs_signals: bool,
    hits: TestHits,
    path: [&'static str; MAX_NESTING],
    depth: usize,
}

impl FieldSearch<'_> {
    fn narrow_by(&mut self, key: &'static str, accepts: impl Fn(&FieldTest, &str) -> bool) {
        if !self.names.may_have(key) {
            return;
        }
        let Some(path) = self.path.get(..self.depth) else { return };
        for (number, test) in self.tests.iter().enumerate() {
            if test.keys().any(|wanted| is_at(wanted, path, key) && accepts(test, wanted)) {
                self.hits.add_test(number);
            }
        }
    }

    fn enter_key(&mut self, key: &'static str) {
        self.narrow_by(key, FieldTest::accepts_group);
        if let Some(slot) = self.path.get_mut(self.depth) {
            *slot = key;
        }
        self.depth += 1;
    }
}

/// Whether the dotted key `wanted` is `key` at this path; list items have no name of their own.
fn is_at(wanted: &str, path: &[&'static str], key: &str) -> bool {
    if path.is_empty() {
        return is_same(wanted, key);
    }
    let named = path.iter().copied().chain(std::iter::once(key)).filter(|part| !part.is_empty());
    let mut parts = wanted.split('.');
    named.into_iter().all(|name| parts.next().is_some_and(|part| is_same(part, name)))
        && parts.next().is_none()
}

/// Compares short texts byte by byte: faster here than a call to the block comparison.
#[inline]
fn is_same(one: &str, other: &str) -> bool {
    one.len() == other.len() && one.bytes().zip(other.bytes()).all(|(one, other)| one == other)
}

impl FieldConsumer for FieldSearch<'_> {
    fn add_field(&mut self, key: &'static str, value: FieldValue<'_>) {
        self.narrow_by(key, |test, wanted| test.accepts_value(wanted, &value));
    }

    fn open_group(&mut self, key: &'static str) {
        self.enter_key(key);
    }

    fn close_group(&mut self) {
        self.depth = self.depth.saturating_sub(1);
    }

    fn open_list(&mut self, key: &'static str) {
        self.enter_key(key);
    }

    fn close_list(&mut self) {
        self.depth = self.depth.saturating_sub(1);
    }

    fn wants_signals(&self) -> bool {
        self.needs_signals
    }
}
