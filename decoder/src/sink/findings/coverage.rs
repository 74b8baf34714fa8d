//! Tables of verdict counts per rule and per case of the conformance test plan.

use std::fmt::Write as _;

use super::report::Report;
use crate::finding::{RuleInfo, Tally, Verdict};
use crate::rules::conformance::cases;
use crate::sink::table::{Align, Table};

/// Appends both tables.
pub(super) fn write(report: &Report, out: &mut String) {
    let coverage = report.coverage();
    let mut rules = table("RULE");
    for one in &coverage {
        let RuleInfo { name, title, needs, .. } = one.rule;
        let what = match one.tally.verdict() {
            Verdict::NotExercised => format!("{title}; needs {needs}"),
            _ => title.to_string(),
        };
        rules.row(row(name, one.tally, &what));
    }
    rules.write(0, out);
    let judged = report.cases();
    let mut plan = table("CASE");
    for case in cases().iter() {
        if let Some(tally) = judged.get(case.id.as_str()) {
            plan.row(row(&case.id, *tally, &case.name));
        }
    }
    if !plan.is_empty() {
        let _ = writeln!(
            out,
            "\nCases of the CiA conformance test plan covered by rules; exercised if the capture contains the case"
        );
        plan.write(0, out);
    }
    out.push('\n');
}

fn table(what: &str) -> Table {
    Table::new(&[
        (what, Align::Left),
        ("PASSED", Align::Right),
        ("FAILED", Align::Right),
        ("WAIVED", Align::Right),
        ("VERDICT", Align::Left),
        ("WHAT", Align::Left),
    ])
}

fn row(name: &str, tally: Tally, what: &str) -> [String; 6] {
    let Tally { passed, failed, waived } = tally;
    let verdict = tally.verdict().name().replace('-', " ");
    [name.into(), passed.to_string(), failed.to_string(), waived.to_string(), verdict, what.into()]
}
