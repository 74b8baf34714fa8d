//! `cobscope rules`: lists all rules; also the page of one rule for `cobscope explain`.

mod json;
mod listed;
mod markdown;
mod page;

use std::path::PathBuf;

use clap::{Args, ValueEnum};
use cobscope_decoder::sink::table::{CellAlignment, TextTable};

use crate::exit_code::ExitStatus;
use crate::run::input::common_catalogue;
use crate::run::output::print_text;
pub(super) use listed::{ListedRule, find_rule, list_rules, nearest_name};
pub(super) use page::rule_page;

/// List the rules: name, severity, on or off, timing rule, defect
#[derive(Debug, Args)]
pub struct RulesArgs {
    /// Output format
    #[arg(short, long, value_name = "FORMAT", default_value = "text")]
    pub format: RulesFormat,
    /// Add a folder with profiles, whose rules are also listed (repeatable)
    #[arg(long, value_name = "DIR")]
    pub profiles: Vec<PathBuf>,
}

/// Formats of the rule list.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum RulesFormat {
    /// A table
    Text,
    /// One JSON array with all properties of each rule
    Json,
    /// Headings and text for a document
    Markdown,
}

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
