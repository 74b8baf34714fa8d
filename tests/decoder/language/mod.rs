//! Word budget of comments, strings, documents and names. `budget.toml` has the limits.

mod budget;
mod ceilings;
mod shares;
mod sources;

use std::collections::BTreeMap;
use std::env;
use std::fmt::Write as _;

use budget::{Budget, Expression};
use ceilings::Ceilings;
use shares::DefinedNames;
use sources::Passage;

const CRATES: [(&str, &str); 7] = [
    ("decoder", "decoder/src"),
    ("tui", "tui/src"),
    ("adapters", "bindings/adapters/src"),
    ("fake", "bindings/fake/src"),
    ("web", "bindings/web/src"),
    ("python", "bindings/python/src"),
    ("tests", "tests"),
];

/// Max files and lines in the report of a rate.
const SHOWN: usize = 8;

/// Occurrences of one expression in one scope.
struct Count {
    scope: String,
    expression: String,
    hits: Vec<Passage>,
    /// Occurrences per 1,000 lines or words, or their number.
    rate: f64,
    limit: f64,
}

impl Count {
    fn rate(scope: &str, expression: &str, hits: Vec<Passage>, units: usize, limit: f64) -> Self {
        let rate = number(hits.len()) * 1_000.0 / number(units.max(1));
        Self { scope: scope.to_owned(), expression: expression.to_owned(), hits, rate, limit }
    }

    fn number(scope: &str, expression: &str, hits: Vec<Passage>) -> Self {
        let rate = number(hits.len());
        Self { scope: scope.to_owned(), expression: expression.to_owned(), hits, rate, limit: 0.0 }
    }

    fn is_above_limit(&self) -> bool {
        self.rate > self.limit
    }

    /// The files with the most occurrences, and the first lines.
    fn report(&self, ceiling: f64) -> String {
        let mut files = BTreeMap::<&str, usize>::new();
        for hit in &self.hits {
            *files.entry(&hit.file).or_default() += 1;
        }
        let mut files: Vec<_> = files.into_iter().collect();
        files.sort_by_key(|(_, count)| std::cmp::Reverse(*count));
        let mut report =
            format!("{}: {}: {:.2} > {ceiling:.2}; worst files:\n", self.scope, self.expression, self.rate);
        for (file, count) in files.iter().take(SHOWN) {
            writeln!(report, "    {count:4}  {file}").unwrap();
        }
        for Passage { file, line, text } in self.hits.iter().take(SHOWN) {
            writeln!(report, "    {file}:{line}: {}", text.trim()).unwrap();
        }
        report
    }
}

fn number(count: usize) -> f64 {
    f64::from(u32::try_from(count).unwrap())
}

/// Passages with the expression, repeated for each occurrence.
fn hits(budget: &Budget, expression: &Expression, texts: &[Passage]) -> Vec<Passage> {
    let count = |text: &&Passage| expression.count(&budget.without_allowed(&text.file, &text.text));
    texts.iter().flat_map(|text| std::iter::repeat_n(text.clone(), count(&text))).collect()
}

fn counts_in_comments(budget: &Budget) -> Vec<Count> {
    let mut counts = Vec::new();
    for (name, folder) in CRATES {
        let (scope, lines) = (format!("comments of {name}"), sources::comment_lines(folder));
        for row in &budget.expressions {
            let hits = hits(budget, row, &lines);
            counts.push(Count::rate(&scope, &row.name, hits, lines.len(), row.limit));
        }
        let start = &budget.doc_comment_start;
        let mut starts = sources::doc_comment_starts(folder);
        starts.retain(|Passage { text, .. }| {
            let first = text.split(|c: char| !c.is_alphabetic()).next().unwrap_or_default();
            start.words.contains(&first.to_lowercase())
        });
        counts.push(Count::rate(&scope, &start.name, starts, lines.len(), start.limit));
    }
    counts
}

fn counts_in_strings(budget: &Budget) -> Vec<Count> {
    let scopes = [
        ("strings of decoder", sources::string_literals("decoder/src")),
        ("strings of tui", sources::string_literals("tui/src")),
        ("strings of adapters", sources::string_literals("bindings/adapters/src")),
        ("profiles", sources::toml_strings("decoder/profiles")),
        ("help", sources::help_lines()),
    ];
    let mut counts = Vec::new();
    for (scope, texts) in scopes {
        for row in budget.expressions.iter().filter(|row| !row.in_strings) {
            counts.push(Count::number(scope, &row.name, hits(budget, row, &texts)));
        }
    }
    counts
}

fn counts_in_documents(budget: &Budget) -> Vec<Count> {
    let mut counts = Vec::new();
    for document in sources::documents() {
        let words = document.text.split_whitespace().count();
        let text = budget.without_allowed(&document.file, &document.text);
        // Expressions may extend over the end of a line: they are counted in the whole text and shown by
        // line.
        let found = budget.expressions.iter().map(|row| row.count(&text)).sum::<usize>();
        let lines = text.lines().enumerate().map(|(at, line)| Passage {
            file: document.file.clone(),
            line: at + 1,
            text: line.to_owned(),
        });
        let lines: Vec<_> = lines.collect();
        let mut hits: Vec<_> = budget.expressions.iter().flat_map(|row| hits(budget, row, &lines)).collect();
        hits.resize(found, document.clone());
        let shown = |hit: Passage| {
            if hit.line == 0 { Passage { text: "across lines".to_owned(), ..hit } } else { hit }
        };
        let hits = hits.into_iter().map(shown).collect();
        counts.push(Count::rate(&document.file, "all expressions", hits, words, budget.document_limit));
    }
    counts
}

fn counts_in_names(budget: &Budget) -> Vec<Count> {
    let mut counts = Vec::new();
    for (name, folder) in CRATES {
        let mut types = sources::defined_names(folder, &["struct", "enum", "union", "trait", "type"]);
        types.retain(|name| budget.names.error_in_type(&name.text).is_some());
        counts.push(Count::number(&format!("names of {name}"), "types", types));
        let mut functions = sources::defined_names(folder, &["fn"]);
        functions.retain(|name| budget.names.error_in_function(&name.text).is_some());
        counts.push(Count::number(&format!("names of {name}"), "functions", functions));
    }
    counts
}

/// Compares rates with the ceilings, or with the limits if there is no ceiling. `COBSCOPE_BLESS=1` lowers the
/// ceilings.
#[test]
fn expressions_stay_within_the_word_budget() {
    let (budget, ceilings) = (Budget::read(), Ceilings::read());
    let counts = [counts_in_comments, counts_in_strings, counts_in_documents, counts_in_names];
    let counts: Vec<_> = counts.iter().flat_map(|counts| counts(&budget)).collect();
    let (mut report, mut lowered) = (String::new(), Ceilings::default());
    for count in &counts {
        let ceiling = ceilings.get(&count.scope, &count.expression).unwrap_or(count.limit);
        let rate = (count.rate * 100.0).ceil() / 100.0;
        if count.is_above_limit() {
            lowered.set(&count.scope, &count.expression, rate.min(ceiling));
        }
        if count.rate > ceiling {
            report.push_str(&count.report(ceiling));
        }
    }
    if env::var_os("COBSCOPE_BLESS").is_some() {
        lowered.write();
    }
    assert!(report.is_empty(), "\n{report}");
}

/// An unused entry would hide the next use of the expression.
#[test]
fn every_allowed_text_is_in_its_file() {
    for entry in Budget::read().allowed {
        let text = std::fs::read_to_string(crate::support::workspace().join(&entry.file)).unwrap();
        assert!(text.contains(&entry.text), "{}: `{}` is not there", entry.file, entry.text);
        assert!(!entry.reason.is_empty(), "{}: `{}` has no reason", entry.file, entry.text);
    }
}

#[test]
fn expressions_are_found_and_their_exceptions_are_not() {
    let budget = Budget::read();
    let count = |name: &str, text: &str| {
        budget.expressions.iter().find(|row| row.name == name).map(|row| row.count(text)).unwrap()
    };
    assert_eq!(count("say, says, said", "It Says what was said; it essays"), 2);
    assert_eq!(count("is/are no, is/are none", "There is no node; it is no node and is no longer one"), 1);
    assert_eq!(count("a X a Y", "a line a value, an object an entry"), 2);
    assert_eq!(count("what is", "what\nis"), 1);
    assert_eq!(count("where it, what it", "## What it checks\nand what it checks"), 1);
}

#[test]
fn names_are_judged_by_their_words() {
    let names = Budget::read().names;
    let types = [
        "ValueUpdate",
        "ProcedureStep",
        "KnownFindings",
        "Kept",
        "SaidOnce",
        "Step",
        "StepName",
        "FindingsKnown",
    ];
    let wrong: Vec<_> = types.into_iter().filter(|name| names.error_in_type(name).is_some()).collect();
    assert_eq!(wrong, ["Kept", "SaidOnce", "Step", "StepName", "FindingsKnown"]);
    let functions = ["emit_node_lost", "essay", "say_lost", "is_sure", "goes_on_for", "going_on"];
    let wrong: Vec<_> =
        functions.into_iter().filter(|name| names.error_in_function(name).is_some()).collect();
    assert_eq!(wrong, ["say_lost", "is_sure", "goes_on_for"]);
}

#[test]
fn names_are_unique_and_have_two_words() {
    let limits = Budget::read().name_limits;
    let (shares, report) = DefinedNames::read().measure();
    let pairs = [
        ("types with a name that is not unique", shares.repeated_types, limits.repeated_types),
        ("types with one word", shares.short_types, limits.short_types),
        ("functions with one word", shares.short_functions, limits.short_functions),
        ("functions named with a bare participle", shares.bare_participles, limits.bare_participles),
    ];
    for (what, share, limit) in pairs {
        assert!(share <= limit, "{what}: {share:.1} % > {limit} %\n{report}");
    }
}

#[test]
fn shares_are_counted_per_definition() {
    let code = "
        pub struct Row;
        mod other { pub(super) enum Row {} trait NodeRow {} }
        impl Row {
            pub const fn new() -> Self { Self }
            fn refused(&self) {}
            pub(crate) async fn is_refused(&self) {}
            fn embed(&self) {}
        }
        #[cfg(test)]
        mod tests { struct Row; fn read() {} }";
    let (shares, _) = DefinedNames::find(&code.replace("{ ", "{\n").replace("} ", "}\n")).measure();
    // Row, Row, NodeRow; refused, is_refused, embed.
    assert!((shares.repeated_types - 200.0 / 3.0).abs() < 1e-9, "{shares:?}");
    assert!((shares.short_types - 200.0 / 3.0).abs() < 1e-9, "{shares:?}");
    assert!((shares.short_functions - 200.0 / 3.0).abs() < 1e-9, "{shares:?}");
    assert!((shares.bare_participles - 100.0 / 3.0).abs() < 1e-9, "{shares:?}");
}
