//! Compiles a parsed filter into tests on event fields.

use std::ops::Range;

use regex_lite::{Regex, RegexBuilder};

use super::error::FilterError;
use super::expression::{Expression, FieldCondition, Operand, RelationalOperator};
use super::fields::{FieldTarget, FieldType, ObjectPart, nearest_name, resolve_name};
use super::literal::Literal;
use super::record::FieldValue;
use crate::event::KindSet;
use crate::wire::canopen::ObjectAddress;

/// Max tests per filter; a set counts as one test.
pub const MAX_TESTS: usize = 256;

/// Max size of a compiled regular expression, in bytes.
const MAX_REGEX: usize = 256 * 1024;

/// A filter with all field names resolved.
#[derive(Debug, Clone)]
pub(super) struct CompiledFilter {
    /// Boolean combination of the test results.
    pub(super) tree: FilterNode,
    pub(super) tests: Vec<FieldTest>,
    /// Event kinds that the filter can match.
    pub(super) may: KindSet,
    /// Event kinds that the filter always matches.
    pub(super) must: KindSet,
    /// Whether a test needs a field that not every kind has.
    pub(super) needs_details: bool,
    /// Whether a test needs the signals.
    pub(super) needs_signals: bool,
    /// Last segments of the dotted keys that the tests use.
    pub(super) names: NameSet,
}

/// Set of names that can contain false positives, but no false negatives.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct NameSet(u64);

impl NameSet {
    /// Hash of length, first and last letter, in which most field names differ.
    fn name_bit(name: &str) -> u64 {
        let bytes = name.as_bytes();
        let ends = [bytes.first(), bytes.last()].map(|byte| usize::from(byte.copied().unwrap_or(0)));
        let [first, last] = ends;
        1 << ((first * 5 + last * 3 + bytes.len() * 11) % 64)
    }

    fn with_name(self, name: &str) -> Self {
        Self(self.0 | Self::name_bit(name))
    }

    /// Whether the set may contain `name`; always true for list items, which have no name.
    #[inline]
    pub(super) fn may_have(self, name: &str) -> bool {
        name.is_empty() || self.0 & Self::name_bit(name) != 0
    }
}

/// Boolean combination of test results.
#[derive(Debug, Clone)]
pub(super) enum FilterNode {
    And(Vec<FilterNode>),
    Or(Vec<FilterNode>),
    Not(Box<FilterNode>),
    /// Index of a test.
    Test(usize),
}

/// One condition, checked against every field that the name can refer to.
#[derive(Debug, Clone)]
pub(super) struct FieldTest(Vec<(FieldTarget, ValueCheck)>);

#[derive(Debug, Clone)]
enum ValueCheck {
    Present,
    Compare(RelationalOperator, Literal),
    In(Vec<(Literal, Option<Literal>)>),
    Contains(Literal),
    Matches(Regex),
}

impl FieldTest {
    /// Whether the test uses only fields of every event kind.
    pub(super) fn is_common(&self) -> bool {
        self.0.iter().all(|(target, _)| target.field.kinds == KindSet::ALL)
    }

    /// Keys of the fields that the test uses.
    pub(super) fn keys(&self) -> impl Iterator<Item = &'static str> {
        self.0.iter().map(|(target, _)| target.field.key.as_str())
    }

    /// Whether this value of the field `key` fulfils the test.
    pub(super) fn accepts_value(&self, key: &str, value: &FieldValue<'_>) -> bool {
        let mut own = self.0.iter().filter(|(target, _)| target.field.key == key);
        own.any(|(target, check)| match (target.part, value) {
            (Some(part), FieldValue::Object(object)) => check.accepts_value(&part_of(*object, part)),
            (Some(_), _) => false,
            (None, value) => check.accepts_value(value),
        })
    }

    /// Whether the presence of the group `key` fulfils the test.
    pub(super) fn accepts_group(&self, key: &str) -> bool {
        self.0.iter().any(|(target, check)| target.field.key == key && matches!(check, ValueCheck::Present))
    }

    /// Kinds for which the test can succeed, and kinds for which it always succeeds.
    fn reachable_kinds(&self) -> (KindSet, KindSet) {
        let mut may = KindSet::NONE;
        for (target, check) in &self.0 {
            if target.field.key == "kind" {
                let kinds = KindSet::choose(|kind| check.accepts_value(&FieldValue::Text(kind.name())));
                return (kinds, kinds);
            }
            may = may.or(target.field.kinds);
        }
        (may, KindSet::NONE)
    }
}

fn part_of(object: ObjectAddress, part: ObjectPart) -> FieldValue<'static> {
    match part {
        ObjectPart::Index => FieldValue::Code(u64::from(object.index), 4),
        ObjectPart::Sub => FieldValue::Code(u64::from(object.sub), 2),
    }
}

impl ValueCheck {
    fn accepts_value(&self, value: &FieldValue<'_>) -> bool {
        match self {
            Self::Present => !matches!(value, FieldValue::Null),
            Self::Compare(relation, literal) => {
                literal.compare_field(value).is_some_and(|order| match relation {
                    RelationalOperator::Equal => order.is_eq(),
                    RelationalOperator::NotEqual => order.is_ne(),
                    RelationalOperator::Less => order.is_lt(),
                    RelationalOperator::LessOrEqual => order.is_le(),
                    RelationalOperator::Greater => order.is_gt(),
                    RelationalOperator::GreaterOrEqual => order.is_ge(),
                })
            }
            Self::In(members) => members.iter().any(|(from, to)| match (from.compare_field(value), to) {
                (Some(order), None) => order.is_eq(),
                (Some(order), Some(to)) => {
                    order.is_ge() && to.compare_field(value).is_some_and(std::cmp::Ordering::is_le)
                }
                (None, _) => false,
            }),
            Self::Contains(literal) => literal.is_within(value),
            Self::Matches(regex) => matches!(value, FieldValue::Text(text) if regex.is_match(text)),
        }
    }
}

/// Resolves the names in a filter; `text` is its source, for error positions.
pub(super) fn compile_filter(text: &str, written: &Expression) -> Result<CompiledFilter, FilterError> {
    let mut compiler = FilterCompiler { text, tests: Vec::new() };
    let (tree, may, must) = compiler.compile_node(written)?;
    let tests = compiler.tests;
    let mut fields = tests.iter().flat_map(|test| test.0.iter().map(|(target, _)| target.field));
    let needs_details = fields.clone().any(|field| field.kinds != KindSet::ALL);
    let needs_signals =
        fields.any(|field| matches!(field.key.split('.').next(), Some("signals" | "missing")));
    let keys = tests.iter().flat_map(FieldTest::keys);
    let names =
        keys.fold(NameSet::default(), |names, key| names.with_name(key.rsplit('.').next().unwrap_or(key)));
    Ok(CompiledFilter { tree, tests, may, must, needs_details, needs_signals, names })
}

struct FilterCompiler<'a> {
    text: &'a str,
    tests: Vec<FieldTest>,
}

/// Position in bytes and reason of an error.
type CompileError = (Range<usize>, String);

impl FilterCompiler<'_> {
    /// Compiles a subexpression; also returns the kinds it can match and those it always matches.
    fn compile_node(&mut self, written: &Expression) -> Result<(FilterNode, KindSet, KindSet), FilterError> {
        Ok(match written {
            Expression::And(parts) => {
                let (nodes, may, must) = self.compile_nodes(parts, KindSet::ALL, KindSet::and)?;
                (FilterNode::And(nodes), may, must)
            }
            Expression::Or(parts) => {
                let (nodes, may, must) = self.compile_nodes(parts, KindSet::NONE, KindSet::or)?;
                (FilterNode::Or(nodes), may, must)
            }
            Expression::Not(inner) => {
                let (node, may, must) = self.compile_node(inner)?;
                (FilterNode::Not(Box::new(node)), must.complement(), may.complement())
            }
            Expression::Test { field, question } => {
                let test = self.compile_test(field, question)?;
                let (may, must) = test.reachable_kinds();
                self.tests.push(test);
                (FilterNode::Test(self.tests.len() - 1), may, must)
            }
        })
    }

    fn compile_nodes(
        &mut self,
        parts: &[Expression],
        start: KindSet,
        join: fn(KindSet, KindSet) -> KindSet,
    ) -> Result<(Vec<FilterNode>, KindSet, KindSet), FilterError> {
        let (mut nodes, mut may, mut must) = (Vec::new(), start, start);
        for part in parts {
            let (node, can, will) = self.compile_node(part)?;
            nodes.push(node);
            (may, must) = (join(may, can), join(must, will));
        }
        Ok((nodes, may, must))
    }

    fn compile_test(&self, name: &Operand, question: &FieldCondition) -> Result<FieldTest, FilterError> {
        if self.tests.len() == MAX_TESTS {
            let reason = format!("too many tests in the filter (max {MAX_TESTS})");
            return Err(FilterError::new(self.text, name.at.clone(), reason));
        }
        let targets = resolve_name(&name.text);
        if targets.is_empty() {
            return Err(FilterError::new(self.text, name.at.clone(), unknown_name(&name.text)));
        }
        let mut checks = Vec::new();
        let mut refusals: Vec<CompileError> = Vec::new();
        for target in targets {
            match compile_check(question, target) {
                Ok(check) => checks.push((target, check)),
                Err((at, reason)) => {
                    let at = if at.is_empty() { name.at.clone() } else { at };
                    refusals.push((at, reason));
                }
            }
        }
        if !checks.is_empty() {
            return Ok(FieldTest(checks));
        }
        // The reason with a suggestion is the most useful one.
        let best = refusals.iter().position(|(_, reason)| reason.contains("did you mean")).unwrap_or(0);
        let (at, reason) = refusals.swap_remove(best);
        Err(FilterError::new(self.text, at, reason))
    }
}

fn unknown_name(name: &str) -> String {
    match nearest_name(name) {
        Some(nearest) => format!("unknown field '{name}'; did you mean {nearest}?"),
        None => format!("unknown field '{name}'"),
    }
}

/// Compiles a condition for one field. An empty position in the error refers to the field name.
fn compile_check(question: &FieldCondition, target: FieldTarget) -> Result<ValueCheck, CompileError> {
    let read = |operand: &Operand| {
        Literal::parse_literal(operand, target).map_err(|reason| (operand.at.clone(), reason))
    };
    match question {
        FieldCondition::Present => Ok(ValueCheck::Present),
        FieldCondition::Compare(relation, operand) => {
            if !matches!(relation, RelationalOperator::Equal | RelationalOperator::NotEqual) {
                in_order(target)?;
            }
            Ok(ValueCheck::Compare(*relation, read(operand)?))
        }
        FieldCondition::In(members) => {
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
            members.collect::<Result<_, CompileError>>().map(ValueCheck::In)
        }
        FieldCondition::Contains(operand) => {
            let part = Literal::read_part(operand, target);
            part.map(ValueCheck::Contains).map_err(|reason| (operand.at.clone(), reason))
        }
        FieldCondition::Matches(operand) => compile_regex(operand, target).map(ValueCheck::Matches),
    }
}

/// Rejects a field whose values have no order.
fn in_order(target: FieldTarget) -> Result<(), CompileError> {
    let is_named = target.field.key == "kind" || !target.field.values.is_empty();
    if is_named || matches!(target.value(), FieldType::Bool | FieldType::Group) {
        return Err((0..0, format!("{} has no order; use == or !=", target.field.key)));
    }
    Ok(())
}

fn compile_regex(operand: &Operand, target: FieldTarget) -> Result<Regex, CompileError> {
    if !matches!(target.value(), FieldType::Text | FieldType::Any) {
        let reason = format!("matches requires text; {} is {}", target.field.key, target.value().name());
        return Err((0..0, reason));
    }
    let mut builder = RegexBuilder::new(&operand.text);
    let built = builder.case_insensitive(true).size_limit(MAX_REGEX).build();
    built.map_err(|error| (operand.at.clone(), format!("not a valid regular expression: {error}")))
}
