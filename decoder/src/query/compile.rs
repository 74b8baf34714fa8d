//! From a filter as written to tests that can be made on events.

use std::ops::Range;

use regex_lite::{Regex, RegexBuilder};

use super::error::FilterError;
use super::expression::{Expression, Operand, Question, Relation};
use super::fields::{FieldType, Part, Target, nearest_name, resolve};
use super::kinds::KindSet;
use super::literal::Literal;
use super::record::FieldValue;
use crate::wire::canopen::ObjectAddress;

/// Questions a filter may ask; a set is one.
pub const MAX_TESTS: usize = 256;

/// Bytes a compiled regular expression may take.
const MAX_REGEX: usize = 256 * 1024;

/// What is left of a filter when all names are resolved.
#[derive(Debug, Clone)]
pub(super) struct Compiled {
    /// How the tests' answers are joined.
    pub(super) tree: Node,
    /// The tests.
    pub(super) tests: Vec<Test>,
    /// Kinds of events the filter can match.
    pub(super) may: KindSet,
    /// Kinds of events it certainly matches.
    pub(super) must: KindSet,
    /// A test is about a field that not all kinds have.
    pub(super) needs_details: bool,
    /// A test is about signals.
    pub(super) needs_signals: bool,
    /// Last parts of the keys the tests are about.
    pub(super) names: NameSet,
}

/// A set of names that may hold more than it was given, but never less.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct NameSet(u64);

impl NameSet {
    /// Most names of fields differ in length, first or last letter.
    fn bit(name: &str) -> u64 {
        let bytes = name.as_bytes();
        let ends = [bytes.first(), bytes.last()].map(|byte| usize::from(byte.copied().unwrap_or(0)));
        let [first, last] = ends;
        1 << ((first * 5 + last * 3 + bytes.len() * 11) % 64)
    }

    fn with(self, name: &str) -> Self {
        Self(self.0 | Self::bit(name))
    }

    /// Whether a name may be in it; items of lists have none of their own.
    #[inline]
    pub(super) fn may_have(self, name: &str) -> bool {
        name.is_empty() || self.0 & Self::bit(name) != 0
    }
}

/// The tests' answers joined.
#[derive(Debug, Clone)]
pub(super) enum Node {
    And(Vec<Node>),
    Or(Vec<Node>),
    Not(Box<Node>),
    /// Number of a test.
    Test(usize),
}

/// One question, of every field that its name can mean.
#[derive(Debug, Clone)]
pub(super) struct Test(Vec<(Target, Check)>);

#[derive(Debug, Clone)]
enum Check {
    Present,
    Compare(Relation, Literal),
    In(Vec<(Literal, Option<Literal>)>),
    Contains(Literal),
    Matches(Regex),
}

impl Test {
    /// Whether it is only about what every kind of event has.
    pub(super) fn is_common(&self) -> bool {
        self.0.iter().all(|(target, _)| target.field.kinds == KindSet::ALL)
    }

    /// Keys it is about.
    pub(super) fn keys(&self) -> impl Iterator<Item = &'static str> {
        self.0.iter().map(|(target, _)| target.field.key.as_str())
    }

    /// Whether a value of the field `key` answers it with yes.
    pub(super) fn accepts(&self, key: &str, value: &FieldValue<'_>) -> bool {
        let mut own = self.0.iter().filter(|(target, _)| target.field.key == key);
        own.any(|(target, check)| match (target.part, value) {
            (Some(part), FieldValue::Object(object)) => check.accepts(&part_of(*object, part)),
            (Some(_), _) => false,
            (None, value) => check.accepts(value),
        })
    }

    /// Whether the presence of the group `key` does.
    pub(super) fn accepts_group(&self, key: &str) -> bool {
        self.0.iter().any(|(target, check)| target.field.key == key && matches!(check, Check::Present))
    }

    /// Kinds it can succeed with, and kinds it always succeeds with.
    fn reach(&self) -> (KindSet, KindSet) {
        let mut may = KindSet::NONE;
        for (target, check) in &self.0 {
            if target.field.key == "kind" {
                let kinds = KindSet::by_name(|name| check.accepts(&FieldValue::Text(name)));
                return (kinds, kinds);
            }
            may = may.or(target.field.kinds);
        }
        (may, KindSet::NONE)
    }
}

fn part_of(object: ObjectAddress, part: Part) -> FieldValue<'static> {
    match part {
        Part::Index => FieldValue::Code(u64::from(object.index), 4),
        Part::Sub => FieldValue::Code(u64::from(object.sub), 2),
    }
}

impl Check {
    fn accepts(&self, value: &FieldValue<'_>) -> bool {
        match self {
            Self::Present => !matches!(value, FieldValue::Null),
            Self::Compare(relation, literal) => literal.order(value).is_some_and(|order| match relation {
                Relation::Equal => order.is_eq(),
                Relation::NotEqual => order.is_ne(),
                Relation::Less => order.is_lt(),
                Relation::LessOrEqual => order.is_le(),
                Relation::Greater => order.is_gt(),
                Relation::GreaterOrEqual => order.is_ge(),
            }),
            Self::In(members) => members.iter().any(|(from, to)| match (from.order(value), to) {
                (Some(order), None) => order.is_eq(),
                (Some(order), Some(to)) => {
                    order.is_ge() && to.order(value).is_some_and(std::cmp::Ordering::is_le)
                }
                (None, _) => false,
            }),
            Self::Contains(literal) => literal.is_within(value),
            Self::Matches(regex) => matches!(value, FieldValue::Text(text) if regex.is_match(text)),
        }
    }
}

/// Resolves the names in a filter. `text` is the filter, for the places of errors.
pub(super) fn compile(text: &str, written: &Expression) -> Result<Compiled, FilterError> {
    let mut compiler = Compiler { text, tests: Vec::new() };
    let (tree, may, must) = compiler.node(written)?;
    let tests = compiler.tests;
    let mut fields = tests.iter().flat_map(|test| test.0.iter().map(|(target, _)| target.field));
    let needs_details = fields.clone().any(|field| field.kinds != KindSet::ALL);
    let needs_signals =
        fields.any(|field| matches!(field.key.split('.').next(), Some("signals" | "missing")));
    let keys = tests.iter().flat_map(Test::keys);
    let names = keys.fold(NameSet::default(), |names, key| names.with(key.rsplit('.').next().unwrap_or(key)));
    Ok(Compiled { tree, tests, may, must, needs_details, needs_signals, names })
}

struct Compiler<'a> {
    text: &'a str,
    tests: Vec<Test>,
}

/// A reason and the place it is about.
type Refusal = (Range<usize>, String);

impl Compiler<'_> {
    /// A part of the filter, the kinds it can match and those it always matches.
    fn node(&mut self, written: &Expression) -> Result<(Node, KindSet, KindSet), FilterError> {
        Ok(match written {
            Expression::And(parts) => {
                let (nodes, may, must) = self.nodes(parts, KindSet::ALL, KindSet::and)?;
                (Node::And(nodes), may, must)
            }
            Expression::Or(parts) => {
                let (nodes, may, must) = self.nodes(parts, KindSet::NONE, KindSet::or)?;
                (Node::Or(nodes), may, must)
            }
            Expression::Not(inner) => {
                let (node, may, must) = self.node(inner)?;
                (Node::Not(Box::new(node)), must.complement(), may.complement())
            }
            Expression::Test { field, question } => {
                let test = self.test(field, question)?;
                let (may, must) = test.reach();
                self.tests.push(test);
                (Node::Test(self.tests.len() - 1), may, must)
            }
        })
    }

    fn nodes(
        &mut self,
        parts: &[Expression],
        start: KindSet,
        join: fn(KindSet, KindSet) -> KindSet,
    ) -> Result<(Vec<Node>, KindSet, KindSet), FilterError> {
        let (mut nodes, mut may, mut must) = (Vec::new(), start, start);
        for part in parts {
            let (node, can, will) = self.node(part)?;
            nodes.push(node);
            (may, must) = (join(may, can), join(must, will));
        }
        Ok((nodes, may, must))
    }

    fn test(&self, name: &Operand, question: &Question) -> Result<Test, FilterError> {
        if self.tests.len() == MAX_TESTS {
            let reason = format!("a filter asks at most {MAX_TESTS} questions");
            return Err(FilterError::new(self.text, name.at.clone(), reason));
        }
        let targets = resolve(&name.text);
        if targets.is_empty() {
            return Err(FilterError::new(self.text, name.at.clone(), unknown(&name.text)));
        }
        let mut checks = Vec::new();
        let mut refusals: Vec<Refusal> = Vec::new();
        for target in targets {
            match check(question, target) {
                Ok(check) => checks.push((target, check)),
                Err((at, reason)) => {
                    let at = if at.is_empty() { name.at.clone() } else { at };
                    refusals.push((at, reason));
                }
            }
        }
        if !checks.is_empty() {
            return Ok(Test(checks));
        }
        // Of several reasons the one that knows better helps most.
        let best = refusals.iter().position(|(_, reason)| reason.contains("did you mean")).unwrap_or(0);
        let (at, reason) = refusals.swap_remove(best);
        Err(FilterError::new(self.text, at, reason))
    }
}

fn unknown(name: &str) -> String {
    match nearest_name(name) {
        Some(nearest) => format!("there is no field '{name}'; did you mean {nearest}?"),
        None => format!("there is no field '{name}'"),
    }
}

/// A question asked of one field. An empty place in the refusal means the field itself.
fn check(question: &Question, target: Target) -> Result<Check, Refusal> {
    let read =
        |operand: &Operand| Literal::read(operand, target).map_err(|reason| (operand.at.clone(), reason));
    match question {
        Question::Present => Ok(Check::Present),
        Question::Compare(relation, operand) => {
            if !matches!(relation, Relation::Equal | Relation::NotEqual) {
                in_order(target)?;
            }
            Ok(Check::Compare(*relation, read(operand)?))
        }
        Question::In(members) => {
            let members = members.iter().map(|member| {
                let to = match &member.to {
                    Some(to) => {
                        in_order(target)?;
                        Some(read(to)?)
                    }
                    None => None,
                };
                Ok((read(&member.from)?, to))
            });
            members.collect::<Result<_, Refusal>>().map(Check::In)
        }
        Question::Contains(operand) => {
            let part = Literal::read_part(operand, target);
            part.map(Check::Contains).map_err(|reason| (operand.at.clone(), reason))
        }
        Question::Matches(operand) => regex(operand, target).map(Check::Matches),
    }
}

/// Refuses a field whose values stand in no order.
fn in_order(target: Target) -> Result<(), Refusal> {
    let is_named = target.field.key == "kind" || !target.field.values.is_empty();
    if is_named || matches!(target.value(), FieldType::Bool | FieldType::Group) {
        return Err((0..0, format!("the values of {} have no order", target.field.key)));
    }
    Ok(())
}

fn regex(operand: &Operand, target: Target) -> Result<Regex, Refusal> {
    if !matches!(target.value(), FieldType::Text | FieldType::Any) {
        let reason = format!("matches wants text; {} is {}", target.field.key, target.value().name());
        return Err((0..0, reason));
    }
    let mut builder = RegexBuilder::new(&operand.text);
    let built = builder.case_insensitive(true).size_limit(MAX_REGEX).build();
    built.map_err(|error| (operand.at.clone(), format!("no regular expression: {error}")))
}
