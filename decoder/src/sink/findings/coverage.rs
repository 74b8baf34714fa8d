//! Tables of verdict counts per rule and per case of the conformance test plan.

use std::fmt::Write as _;

use super::report::FindingsReport;
use crate::finding::{CheckTally, RuleInfo, RuleOutcome};
use crate::rules::conformance::test_cases;
use crate::sink::table::{CellAlignment, TextTable};

/// Appends both tables.
pub(super) fn write_coverage(report: &FindingsReport, out: &mut String) {
    let coverage = report.rule_coverage();
    let mut rules = coverage_table("RULE");
    for one in &coverage {
        let RuleInfo { name, title, needs, .. } = one.rule;
        let what = match one.tally.verdict() {
            RuleOutcome::NotExercised => format!("{title}; needs {needs}"),
            _ => title.to_string(),
        };
        rules.add_row(coverage_row(name, one.tally, &what));
    }
    rules.write_table(0, out);
    let judged = report.case_tallies();
    let mut plan = coverage_table("CASE");
    for case in test_cases().iter() {
        if let Some(tally) = judged.get(case.id.as_str()) {
            plan.add_row(coverage_row(&case.id, *tally, &case.name));
        }
    }
    if !plan.is_empty() {
        let _ = writeln!(
            out,
            "\nCases of the CiA conformance test plan covered by rules; exercised if the capture contains the case"
        );
        plan.write_table(0, out);
    }
    out.push('\n');
}

fn coverage_table(what: &str) -> TextTable {
    TextTable::new(&[
        (what, CellAlignment::Left),
        ("PASSED", CellAlignment::Right),
        ("FAILED", CellAlignment::Right),
        ("WAIVED", CellAlignment::Right),
        ("VERDICT", CellAlignment::Left),
        ("WHAT", CellAlignment::Left),
    ])
}

fn coverage_row(name: &str, tally: CheckTally, what: &str) -> [String; 6] {
    let CheckTally { passed, failed, waived } = tally;
    let verdict = tally.verdict().name().replace('-', " ");
    [name.into(), passed.to_string(), failed.to_string(), waived.to_string(), verdict, what.into()]
}
