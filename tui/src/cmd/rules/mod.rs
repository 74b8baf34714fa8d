//! `cobscope rules`: lists all rules; also the page of one rule for `cobscope explain`.

mod json;
mod listed;
mod markdown;
mod page;

use cobscope_decoder::sink::table::{CellAlignment, TextTable};

use super::input::common_catalogue;
use super::output::print_text;
use crate::cli::{RulesArgs, RulesFormat};
use crate::exit_code::ExitStatus;
pub(super) use listed::{ListedRule, find_rule, list_rules, nearest_name};
pub(super) use page::rule_page;

/// Runs the command.
pub fn run(arguments: &RulesArgs) -> ExitStatus {
    let rules = list_rules(&common_catalogue(&arguments.profiles));
    let text = match arguments.format {
        RulesFormat::Text => rules_table(&rules),
        RulesFormat::Json => json::rules_json(&rules),
        RulesFormat::Markdown => markdown::rules_document(&rules),
    };
    print_text(text.as_bytes())
}

fn rules_table(rules: &[ListedRule]) -> String {
    let mut table = TextTable::new(&[
        ("RULE", CellAlignment::Left),
        ("SEVERITY", CellAlignment::Left),
        ("ON", CellAlignment::Left),
        ("TIMING", CellAlignment::Left),
        ("DEFECT", CellAlignment::Left),
    ]);
    for rule in rules {
        let on = if rule.is_on { "on" } else { "off" };
        let timing = if rule.is_timing { "timing" } else { "" };
        table.add_row([
            rule.name.clone(),
            rule.severity.name().to_owned(),
            on.to_owned(),
            timing.to_owned(),
            rule.title.clone(),
        ]);
    }
    let mut text = String::new();
    table.write_table(0, &mut text);
    text
}
