//! Statements of the device manuals: `<device>.statements.toml` next to each profile of a vendor. Every
//! statement is judged by a rule, shown in the output, or not observable; `docs/statements.md` is generated.

#![expect(clippy::panic, reason = "a test that cannot go on has failed")]

use std::collections::{BTreeMap, BTreeSet};
use std::fmt::Write as _;
use std::fs;
use std::path::PathBuf;
use std::sync::Arc;

use cobscope_decoder::event::Kind;
use cobscope_decoder::profile::{Catalogue, DeviceProfile, ObjectReference};
use cobscope_decoder::rules::all_declarations;
use serde::Deserialize;

use crate::rules::device_rules;
use crate::support::workspace;

/// Statements of one manual.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Manual {
    /// Profile id.
    profile: String,
    statement: Vec<Statement>,
}

/// Requirement of a manual in our own words.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Statement {
    /// Section of the manual.
    source: String,
    kind: StatementKind,
    text: String,
    /// Rules of the profile (without the profile id) or general rules.
    #[serde(default)]
    judged_by: Vec<String>,
    /// Parts of the output, such as `event emcy` or `object 5001:00`.
    #[serde(default)]
    shown_as: Vec<String>,
    /// Reason why a capture cannot show a violation.
    #[serde(default)]
    not_observable: String,
    /// Reason why an observable statement has no rule.
    #[serde(default)]
    not_judged: String,
}

#[derive(Clone, Copy, Deserialize)]
#[serde(rename_all = "kebab-case")]
enum StatementKind {
    Must,
    NotPermitted,
    Only,
    Range,
    Order,
    Time,
    Precondition,
    Recommended,
    Meaning,
}

impl StatementKind {
    const fn name(self) -> &'static str {
        match self {
            Self::Must => "must",
            Self::NotPermitted => "not permitted",
            Self::Only => "only",
            Self::Range => "range",
            Self::Order => "order",
            Self::Time => "time",
            Self::Precondition => "precondition",
            Self::Recommended => "recommended",
            Self::Meaning => "meaning",
        }
    }
}

/// A manual with the variants of its device.
struct Described {
    manual: Manual,
    devices: Vec<Arc<DeviceProfile>>,
}

fn path(id: &str) -> PathBuf {
    workspace().join(format!("decoder/profiles/vendor/{}.statements.toml", id.replacen('-', "/", 1)))
}

fn described() -> Vec<Described> {
    let catalogue = Catalogue::default();
    let ids = catalogue.ids().into_iter().filter(|id| !catalogue.is_generic(id));
    let all = ids.map(|id| {
        let path = path(&id);
        let text = fs::read_to_string(&path).unwrap_or_else(|error| panic!("{}: {error}", path.display()));
        let manual: Manual =
            toml::from_str(&text).unwrap_or_else(|error| panic!("{}: {error}", path.display()));
        assert_eq!(manual.profile, id, "{}", path.display());
        let first = catalogue.device(&id).unwrap();
        let others = first.variants.iter().skip(1);
        let others: Vec<_> = others.map(|it| catalogue.device(&format!("{id}:{}", it.id)).unwrap()).collect();
        Described { manual, devices: [first].into_iter().chain(others).collect() }
    });
    all.collect()
}

/// Whether a variant of the device, or the output, has the named part.
fn is_shown(devices: &[Arc<DeviceProfile>], part: &str) -> bool {
    let Some((sort, name)) = part.split_once(' ') else { return false };
    let any = |test: &dyn Fn(&DeviceProfile) -> bool| devices.iter().any(|device| test(device));
    match sort {
        "event" => Kind::ALL.iter().any(|kind| kind.name() == name),
        "object" => name.parse::<ObjectReference>().is_ok_and(|reference| {
            any(&|device| {
                device.dictionary.find_object(reference.object).is_some_and(|found| found.entry.is_some())
            })
        }),
        "pdo" => any(&|device| device.pdos.iter().any(|pdo| pdo.pdo.to_string() == name)),
        "message" => any(&|device| device.messages.iter().any(|message| message.name == name)),
        "gate" => any(&|device| device.gates.iter().any(|gate| gate.name == name)),
        "procedure" => any(&|device| device.procedures.iter().any(|procedure| procedure.name == name)),
        "machine" => any(&|device| device.machines.iter().any(|machine| machine.name == name)),
        "area" => any(&|device| device.areas.iter().any(|area| area.name == name)),
        "dtc" => any(&|device| device.j1939.dtc.iter().any(|it| format!("{}/{}", it.spn, it.fmi) == name)),
        "emcy" => any(&|device| device.emcy.code.iter().any(|it| format!("{:04X}", it.code) == name)),
        "abort" => any(&|device| device.aborts.iter().any(|it| format!("{:08X}", it.code) == name)),
        "uds" => {
            any(&|device| device.uds.identifier.iter().any(|it| format!("{:04X}", it.get_ref().id) == name))
        }
        _ => false,
    }
}

/// Name of a rule in the output. A rule of the profile takes precedence over a general rule of the same name.
fn full_name(profile: &str, rule: &str, own: &BTreeSet<String>) -> String {
    let full = format!("{profile}:{rule}");
    if own.contains(&full) { full } else { rule.to_owned() }
}

/// Judged statements of a manual, with the full names of the rules that judge them.
pub fn judged_statements(profile: &str) -> BTreeMap<String, BTreeSet<String>> {
    let own = device_rules();
    let full = |rule: &String| full_name(profile, rule, &own);
    let all = described().into_iter().filter(|described| described.manual.profile == profile);
    all.flat_map(|described| described.manual.statement)
        .filter(|statement| !statement.judged_by.is_empty())
        .map(|it| (format!("[{}] {}", it.source, it.text), it.judged_by.iter().map(full).collect()))
        .collect()
}

#[test]
fn every_statement_names_what_there_is() {
    let general: BTreeSet<_> = all_declarations().map(|rule| rule.name.to_owned()).collect();
    let own = device_rules();
    let mut report = String::new();
    for Described { manual, devices } in described() {
        for statement in &manual.statement {
            let place = format!("{}: [{}] {}", manual.profile, statement.source, statement.text);
            for rule in &statement.judged_by {
                if !general.contains(rule) && !own.contains(&format!("{}:{rule}", manual.profile)) {
                    writeln!(report, "{place}: no rule {rule}").unwrap();
                }
            }
            for part in statement.shown_as.iter().filter(|part| !is_shown(&devices, part)) {
                writeln!(report, "{place}: no {part}").unwrap();
            }
            let is_seen = !statement.judged_by.is_empty() || !statement.shown_as.is_empty();
            let reasons = [&statement.not_observable, &statement.not_judged];
            let given = reasons.iter().filter(|reason| !reason.is_empty()).count();
            if usize::from(is_seen) + given != 1 {
                writeln!(report, "{place}: expected judged_by, shown_as or one reason").unwrap();
            }
        }
    }
    assert!(report.is_empty(), "\n{report}");
}

#[test]
fn every_rule_of_a_device_has_its_statement() {
    let mut named = BTreeSet::new();
    for Described { manual, .. } in described() {
        let rules = manual.statement.iter().flat_map(|statement| &statement.judged_by);
        named.extend(rules.map(|rule| format!("{}:{rule}", manual.profile)));
    }
    let missing: Vec<_> = device_rules()
        .into_iter()
        .filter(|rule| !rule.starts_with("cia402:") && !named.contains(rule))
        .collect();
    assert!(missing.is_empty(), "no statement names {missing:?}");
}

/// Rule as a link into `docs/rules.md`.
fn rule_link(profile: &str, rule: &str, own: &BTreeSet<String>) -> String {
    let full = full_name(profile, rule, own);
    format!("[{rule}](rules.md#{})", full.replace(':', ""))
}

/// Last column of a statement.
fn verdict(profile: &str, statement: &Statement, own: &BTreeSet<String>) -> String {
    if !statement.not_observable.is_empty() {
        return format!("not observable: {}", statement.not_observable);
    }
    if !statement.not_judged.is_empty() {
        return format!("not judged: {}", statement.not_judged);
    }
    let rules: Vec<_> = statement.judged_by.iter().map(|rule| rule_link(profile, rule, own)).collect();
    let mut parts = Vec::new();
    if !rules.is_empty() {
        parts.push(rules.join(", "));
    }
    if !statement.shown_as.is_empty() {
        parts.push(format!("shown: {}", statement.shown_as.join(", ")));
    }
    parts.join("; ")
}

/// Number of statements per outcome.
fn counts(manual: &Manual) -> [usize; 5] {
    let count = |test: &dyn Fn(&Statement) -> bool| manual.statement.iter().filter(|it| test(it)).count();
    [
        manual.statement.len(),
        count(&|it| !it.judged_by.is_empty()),
        count(&|it| it.judged_by.is_empty() && !it.shown_as.is_empty()),
        count(&|it| !it.not_observable.is_empty()),
        count(&|it| !it.not_judged.is_empty()),
    ]
}

fn document(all: &[Described]) -> String {
    let own = device_rules();
    let mut text = String::from(
        "# Statements of the device manuals\n\nGenerated from `<device>.statements.toml` next to each profile. Each \
         statement of a manual is listed in our own words with its section. Its last column names the rules that judge it, \
         the output that shows it, or the reason why a capture cannot contain it.\n\n\
         | device | manual | statements | judged | shown | not observable | not judged |\n\
         | --- | --- | --- | --- | --- | --- | --- |\n",
    );
    for Described { manual, devices } in all {
        let [total, judged, shown, hidden, open] = counts(manual);
        let (id, source) = (&manual.profile, &devices[0].source);
        writeln!(text, "| [{id}](#{id}) | {source} | {total} | {judged} | {shown} | {hidden} | {open} |")
            .unwrap();
    }
    for Described { manual, .. } in all {
        writeln!(text, "\n## {}\n", manual.profile).unwrap();
        writeln!(text, "| section | kind | statement | outcome |\n| --- | --- | --- | --- |").unwrap();
        for statement in &manual.statement {
            let outcome = verdict(&manual.profile, statement, &own);
            let Statement { source, text: words, kind, .. } = statement;
            writeln!(text, "| {source} | {} | {words} | {outcome} |", kind.name()).unwrap();
        }
    }
    text
}

#[test]
fn the_table_of_statements_is_current() {
    let made = document(&described());
    let path = workspace().join("docs/statements.md");
    if std::env::var_os("COBSCOPE_BLESS").is_some() {
        fs::write(&path, &made).unwrap();
    }
    let kept = fs::read_to_string(&path).unwrap_or_default();
    assert!(kept == made, "docs/statements.md is stale: COBSCOPE_BLESS=1 cargo test --workspace");
}

#[test]
fn no_statement_is_listed_twice() {
    for Described { manual, .. } in described() {
        let mut seen = BTreeSet::new();
        for statement in &manual.statement {
            let is_new = seen.insert((&statement.source, &statement.text));
            assert!(is_new, "{}: [{}] {}", manual.profile, statement.source, statement.text);
        }
    }
}
