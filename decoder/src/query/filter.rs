//! Filters: which events are meant.
//!
//! The language is that of Wireshark's display filters: `== != < <= > >=`, `in {…}`, `contains`,
//! `matches`, `&& || ! ()`, and the words `and or not eq ne lt le gt ge`. A field alone asks whether the
//! event has it. [`super::fields`] says which fields there are, under which names.
//!
//! * A comparison on a field the event does not have, or has as null, is false; `!=` too.
//! * A field with several values (`frames`, `signals.id`) matches if one of them does, with `!=` too.
//! * `matches` takes a regular expression that may match anywhere; as in Wireshark case does not matter to
//!   it, unless it begins with `(?-i)`. `contains` and `==` are exact.
//! * Numbers are decimal, or hexadecimal with `0x`. Codes and identifiers want the `0x`.

use std::fmt;
use std::str::FromStr;
use std::sync::Arc;

use super::compile::{Compiled, NameSet, Node, Test, compile};
use super::error::FilterError;
use super::expression::Expression;
use super::fields::resolve;
use super::kinds::KindSet;
use super::parser::parse;
use super::record::{self, FieldValue, Fields};
use crate::event::Event;
use crate::session::Bus;

pub use super::compile::MAX_TESTS;

/// Lists and groups within each other that fields are looked for in.
const MAX_NESTING: usize = 4;

/// Tests in a word of [`Hits`].
const WORD: usize = 64;

/// A filter, ready to be asked; cheap to clone. Printed it is one that means the same.
#[derive(Debug, Clone)]
pub struct Filter(Arc<Inner>);

#[derive(Debug)]
struct Inner {
    written: Expression,
    compiled: Compiled,
}

impl Filter {
    /// Whether the event is meant; `capture` is the name output would give it.
    pub fn matches(&self, event: &Event, bus: &Bus, capture: Option<&str>) -> bool {
        let Compiled { tree, tests, may, must, needs_details, needs_signals, names } = &self.0.compiled;
        if !may.contains(&event.kind) || must.contains(&event.kind) {
            return may.contains(&event.kind);
        }
        let hits = Hits([0; MAX_TESTS / WORD]);
        let mut search = Search {
            tests,
            names: *names,
            needs_signals: *needs_signals,
            hits,
            path: [""; MAX_NESTING],
            depth: 0,
        };
        record::envelope(event, bus, capture, &mut search);
        // What depends on the kind is looked at only where it can decide.
        if let Some(answer) = search.hits.answer_of_common(tree, tests).filter(|_| *needs_details) {
            return answer;
        }
        if *needs_details {
            record::details(event, bus, &mut search);
        }
        search.hits.answer(tree)
    }

    /// Whether a frame is meant, by the message it is by itself: that message's event tells its fields, and the frame its
    /// own beside them (`id`, `data`, `size`, `remote` …).
    pub fn matches_frame(&self, message: &Event, frame: &Event, bus: &Bus) -> bool {
        let Compiled { tree, tests, needs_signals, names, .. } = &self.0.compiled;
        let mut search = Search {
            tests,
            names: *names,
            needs_signals: *needs_signals,
            hits: Hits([0; MAX_TESTS / WORD]),
            path: [""; MAX_NESTING],
            depth: 0,
        };
        record::envelope(message, bus, None, &mut search);
        record::details(message, bus, &mut search);
        if message.kind.name() != frame.kind.name() {
            record::details(frame, bus, &mut search);
        }
        search.hits.answer(tree)
    }

    /// The kinds of events it can match; all others it does not.
    pub fn kinds(&self) -> KindSet {
        self.0.compiled.may
    }

    /// Whether it asks for a field.
    pub fn asks(&self, key: &str) -> bool {
        self.0.compiled.tests.iter().any(|test| test.keys().any(|asked| asked == key))
    }

    /// Values a field must have for the filter to match, as they are written.
    pub fn required(&self, key: &str) -> Vec<&str> {
        let mut found = Vec::new();
        self.0.written.required(&|name| is_name_of(name, key), &mut found);
        found
    }

    /// Values a field is compared with by `==`, `!=` or `in`, anywhere in the filter, as they are written.
    pub fn compared(&self, key: &str) -> Vec<&str> {
        let mut found = Vec::new();
        self.0.written.compared(&|name| is_name_of(name, key), &mut found);
        found
    }
}

/// Whether a field that is named so in a filter may be the one with this key.
fn is_name_of(name: &str, key: &str) -> bool {
    resolve(name).iter().any(|target| target.field.key == key)
}

/// By what is written, not by what is meant.
impl PartialEq for Filter {
    fn eq(&self, other: &Self) -> bool {
        self.0.written == other.0.written
    }
}

impl FromStr for Filter {
    type Err = FilterError;

    fn from_str(text: &str) -> Result<Self, FilterError> {
        let written = parse(text)?;
        let compiled = compile(text, &written)?;
        Ok(Self(Arc::new(Inner { written, compiled })))
    }
}

impl fmt::Display for Filter {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.0.written.fmt(f)
    }
}

/// Which tests succeeded, a bit each.
struct Hits([u64; MAX_TESTS / WORD]);

impl Hits {
    fn add(&mut self, test: usize) {
        if let Some(word) = self.0.get_mut(test / WORD) {
            *word |= 1 << (test % WORD);
        }
    }

    fn has(&self, test: usize) -> bool {
        self.0.get(test / WORD).is_some_and(|word| word >> (test % WORD) & 1 == 1)
    }

    /// The answer as far as tests of what every kind has give it: `None` if others decide.
    fn answer_of_common(&self, node: &Node, tests: &[Test]) -> Option<bool> {
        let parts = |parts: &[Node], decides: bool| {
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
            Node::And(all) => parts(all, false),
            Node::Or(any) => parts(any, true),
            Node::Not(inner) => self.answer_of_common(inner, tests).map(|answer| !answer),
            Node::Test(test) => tests.get(*test)?.is_common().then(|| self.has(*test)),
        }
    }

    fn answer(&self, node: &Node) -> bool {
        match node {
            Node::And(parts) => parts.iter().all(|part| self.answer(part)),
            Node::Or(parts) => parts.iter().any(|part| self.answer(part)),
            Node::Not(inner) => !self.answer(inner),
            Node::Test(test) => self.has(*test),
        }
    }
}

/// Looks for the fields of the tests among all that an event tells.
struct Search<'a> {
    tests: &'a [Test],
    names: NameSet,
    needs_signals: bool,
    hits: Hits,
    path: [&'static str; MAX_NESTING],
    depth: usize,
}

impl Search<'_> {
    fn told(&mut self, key: &'static str, accepts: impl Fn(&Test, &str) -> bool) {
        if !self.names.may_have(key) {
            return;
        }
        let Some(path) = self.path.get(..self.depth) else { return };
        for (number, test) in self.tests.iter().enumerate() {
            if test.keys().any(|wanted| is_at(wanted, path, key) && accepts(test, wanted)) {
                self.hits.add(number);
            }
        }
    }

    fn enter(&mut self, key: &'static str) {
        self.told(key, Test::accepts_group);
        if let Some(slot) = self.path.get_mut(self.depth) {
            *slot = key;
        }
        self.depth += 1;
    }
}

/// Whether the dotted key `wanted` is `key` at this path; items of lists have no name of their own.
fn is_at(wanted: &str, path: &[&'static str], key: &str) -> bool {
    if path.is_empty() {
        return is_same(wanted, key);
    }
    let named = path.iter().copied().chain(std::iter::once(key)).filter(|part| !part.is_empty());
    let mut parts = wanted.split('.');
    named.into_iter().all(|name| parts.next().is_some_and(|part| is_same(part, name)))
        && parts.next().is_none()
}

/// Whether short texts are equal, letter by letter: calling the comparison of blocks for each costs more than they
/// have letters.
#[inline]
fn is_same(one: &str, other: &str) -> bool {
    one.len() == other.len() && one.bytes().zip(other.bytes()).all(|(one, other)| one == other)
}

impl Fields for Search<'_> {
    fn field(&mut self, key: &'static str, value: FieldValue<'_>) {
        self.told(key, |test, wanted| test.accepts(wanted, &value));
    }

    fn open(&mut self, key: &'static str) {
        self.enter(key);
    }

    fn close(&mut self) {
        self.depth = self.depth.saturating_sub(1);
    }

    fn open_list(&mut self, key: &'static str) {
        self.enter(key);
    }

    fn close_list(&mut self) {
        self.depth = self.depth.saturating_sub(1);
    }

    fn wants_signals(&self) -> bool {
        self.needs_signals
    }
}
